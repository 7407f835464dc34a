"""What the store says: as documents, and in words."""

from __future__ import annotations

from dataclasses import asdict
from datetime import timedelta
from pathlib import Path
from typing import Any

from rsenf.reference.store import (
    Imported,
    SampleFile,
    Series,
    StoredReference,
    coverage,
    facts,
)
from rsenf.timebase import utc_text


def import_document(done: Imported) -> dict[str, Any]:
    """What came in."""
    return {"new": done.new, **_file_document(SampleFile(done.path))}


def import_words(document: dict[str, Any]) -> str:
    """The same in words."""
    to = f"{document['grid']}@{document['step_s']:g}"
    if not document["new"]:
        return f"{document['file']}: in {to} already, since {document['imported_utc']}"
    return (
        f"{document['file']}: {document['samples']} samples to {to}, "
        f"{document['start_utc']} to {document['end_utc']}"
    )


def series_document(series: Series) -> dict[str, Any]:
    """A line of the list."""
    start, end = map(utc_text, series.span_ns)
    return {
        "grid": series.grid,
        "nominal_hz": series.nominal_hz,
        "step_s": series.step_s,
        "start_utc": start,
        "end_utc": end,
        "coverage": round(coverage(series), 6),
        "imports": len(series.files),
        "size_bytes": sum(file.path.stat().st_size for file in series.files),
    }


def list_words(documents: list[dict[str, Any]]) -> str:
    """The list as a table."""
    lines = [f"{'grid':<16} {'Hz':>3} {'step':>6}  {'from':<24} {'to':<24} {'there':>6} {'MB':>6}"]
    lines += [
        f"{d['grid']:<16} {d['nominal_hz']:>3g} {d['step_s']:>4g} s  {d['start_utc']:<24} "
        f"{d['end_utc']:<24} {d['coverage']:>6.1%} {d['size_bytes'] / 1e6:>6.1f}"
        for d in documents
    ]
    return "\n".join(lines)


def info_document(series: Series) -> dict[str, Any]:
    """All that is known of a series."""
    found = facts(series)
    return {
        **series_document(series),
        "samples": found.total,
        "valid": found.valid,
        "gaps": found.gaps,
        "longest_gaps": [
            {
                "start_utc": utc_text(series.raster.time_ns(gap.first)),
                "duration_s": gap.samples * series.step_s,
            }
            for gap in found.longest
        ],
        "duplicates": found.repeated,
        "contradictions": found.contradicted,
        "mean_hz": round(found.mean_hz, 6),
        "std_hz": round(found.std_hz, 6),
        "imports": [_file_document(file) for file in series.files],
    }


def info_words(document: dict[str, Any]) -> str:
    """The same in words."""
    d, step_s = document, document["step_s"]
    missing = d["samples"] - d["valid"]
    lines = [
        f"{d['grid']}@{step_s:g}: {d['nominal_hz']:g} Hz grid, {d['start_utc']} to {d['end_utc']}",
        f"  values          {d['valid']} of {d['samples']} ({d['valid'] / d['samples']:.1%})",
        f"  mean, std       {d['mean_hz']:.4f} Hz, {d['std_hz'] * 1e3:.1f} mHz",
        f"  gaps            {d['gaps']}" + (f", in all {_long(missing * step_s)}" * bool(missing)),
    ]
    lines += [f"    {_long(g['duration_s']):>20} from {g['start_utc']}" for g in d["longest_gaps"]]
    lines += [
        f"  duplicates      {d['duplicates']} samples have several readings",
        f"  contradictions  {d['contradictions']} of them disagree by over 5 mHz: gaps",
        f"  imports         {len(d['imports'])}",
    ]
    for file in d["imports"]:
        lines.append(
            f"    {file['file']}, {file['start_utc']} to {file['end_utc']}, "
            f"sha256 {file['sha256'][:16]}, on {file['imported_utc']}"
        )
        lines += [f"      {note}" for note in file["notes"]]
    return "\n".join(lines)


def export_document(reference: StoredReference, out: Path, written: int) -> dict[str, Any]:
    """What went out."""
    return {
        "out": str(out),
        "grid": reference.grid,
        "step_s": reference.step_s,
        "start_utc": utc_text(reference.t0_ns),
        "end_utc": utc_text(reference.end_ns),
        "values": written,
    }


def export_words(document: dict[str, Any]) -> str:
    """The same in words."""
    d = document
    return (
        f"{d['out']}: {d['values']} values of {d['grid']} at {d['step_s']:g} s, "
        f"{d['start_utc']} to {d['end_utc']}"
    )


def _long(duration_s: float) -> str:
    """Days, hours, minutes and seconds."""
    return str(timedelta(seconds=duration_s))


def _file_document(file: SampleFile) -> dict[str, Any]:
    record = asdict(file.record)
    start, end = map(utc_text, file.span_ns)
    step_s = record.pop("step_ns") / 1e9
    return {
        "file": record.pop("name"),
        "start_utc": start,
        "end_utc": end,
        "step_s": step_s,
        "kept_as": str(file.path),
        **record,
    }

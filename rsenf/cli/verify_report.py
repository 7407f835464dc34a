"""`verify --report`: what the report needs to know of files, parameters and versions."""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rsenf.cli.references import Opened
    from rsenf.match import MatchSettings
    from rsenf.report.recording_time import RecordingFacts, ReferenceFacts
    from rsenf.report.spectrum import ThinRows
    from rsenf.run.inline import Analysis

# Of these only the names are told: where files lie on a machine is nobody's business.
FILES = ("input", "reference", "store")
# These change nothing of the result.
OUTPUTS = ("debug", "json", "picture", "report")
LIBRARIES = ("av", "jinja2", "matplotlib", "numpy", "opencv-python-headless", "scipy")


def begin_report(path: Path) -> str:
    """Refuse early what would fail at the end; return when the report is made."""
    from rsenf.report.recording_time import check_folder, moment_of_report

    check_folder(path)
    return moment_of_report()


def finish_report(
    args: argparse.Namespace,
    references: list[Opened],
    analysis: Analysis,
    spectra: Mapping[int, ThinRows],
    verdict: dict[str, Any],
    made_utc: str,
) -> None:
    """Write the report on an analysis; ``verdict`` is what ``--json`` prints of it."""
    from rsenf.cli.console import note
    from rsenf.cli.options import settings_of
    from rsenf.cli.references import found_in, grids_of, nominal_of
    from rsenf.match import MatchSettings
    from rsenf.report.recording_time import Case, write_report

    epoch, settings = analysis.result.header.epoch, settings_of(args, MatchSettings)
    case = Case(
        result=analysis.result,
        verdict=verdict,
        estimates=[e for e in analysis.estimates if e.header.epoch == epoch],
        spectrum=spectra[epoch],
        grid=grids_of([found_in(analysis.result, references)])[0],
        recording=_recording(args.input, analysis),
        references=[
            _reference(spec, reference)
            for spec, reference in zip(args.reference, references, strict=True)
        ],
        settings=settings,
        parameters={
            **_parameters(args, settings, nominal_of(references)),
            **_calibration(analysis.result.method),
        },
        versions=_versions(),
        idle=analysis.idle_by_epoch.get(epoch),
    )
    write_report(args.report, case, made_utc)
    note(f"report: {args.report / 'report.html'}")


def _recording(path: str, analysis: Analysis) -> RecordingFacts:
    from rsenf.record.provenance import input_facts
    from rsenf.report.recording_time import RecordingFacts

    facts = input_facts(path)
    return RecordingFacts(
        name=facts["input"],
        bytes=int(facts["input_bytes"]),
        sha256=facts["input_sha256"],
        seconds=analysis.seconds,
        stretches=len(analysis.stretches_s),
    )


def _reference(path: str, reference: Opened) -> ReferenceFacts:
    from rsenf.cli.references import coverage
    from rsenf.report.recording_time import ReferenceFacts

    file = Path(path)
    found = coverage(reference)
    return ReferenceFacts(
        name=reference.name,
        bytes=file.stat().st_size if file.is_file() else None,
        sha256=reference.sha256,
        grid=reference.grid,
        nominal_hz=reference.nominal_hz,
        t0_ns=reference.t0_ns,
        step_s=reference.step_s,
        samples=reference.freq_hz.size,
        valid_samples=found.valid,
        gaps=found.gaps,
        longest_gap_s=found.longest_gap * reference.step_s,
        duplicates=found.duplicates,
        notes=reference.notes,
    )


def _parameters(
    args: argparse.Namespace, settings: MatchSettings, nominal_hz: float | None
) -> dict[str, Mapping[str, Any]]:
    """Every parameter in effect, by group."""
    from rsenf.cli.console import row_settings, track_settings

    options = {
        name: _named(value) if name in FILES else value
        for name, value in sorted(vars(args).items())
        if name not in OUTPUTS
    }
    return {
        "command line": options,
        "rows": dataclasses.asdict(row_settings(args)),
        "ENF": dataclasses.asdict(track_settings(args, nominal_hz)),
        "match": dataclasses.asdict(settings),
    }


def _calibration(method: str) -> dict[str, Mapping[str, Any]]:
    """What a method's likelihood ratios were calibrated by, if they are."""
    from rsenf.match.calibration import calibration

    if method != "phase":
        return {}
    facts = dataclasses.asdict(calibration())
    lines = {name: value for name, value in facts.items() if isinstance(value, dict)}
    of_lines = {f"{name}, {k}": v for name, line in lines.items() for k, v in line.items()}
    return {"calibration": {"made": facts["made"], **of_lines}}


def _named(value: Any) -> Any:
    """Leave a path's folder out."""
    if isinstance(value, list):
        return [_named(v) for v in value]
    return Path(value).name if value else value


def _versions() -> dict[str, str]:
    """Versions of the program and of what its results rest on."""
    import av

    from rsenf.record.provenance import program_versions

    # The decoder's own version: what frames look like is its doing.
    codec = ".".join(map(str, av.library_versions["libavcodec"]))
    return {**program_versions(LIBRARIES), "libavcodec": codec}

"""Facts for the report on a recording's time: files, parameters and versions."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rsenf import __version__
from rsenf.api.shared import grids_of
from rsenf.decode.file import container_facts
from rsenf.match.calibration import calibration
from rsenf.record.provenance import input_facts, machine_facts, program_versions
from rsenf.reference import Reference
from rsenf.report.picture import ThinRows
from rsenf.report.recording_time import Basis, RecordingFacts, ReferenceFacts, write_report
from rsenf.report.values import number
from rsenf.version import commit

if TYPE_CHECKING:
    from rsenf.api.verify import VerifyResult

PIECE = 1 << 20  # samples that are counted at a time
LIBRARIES = ("av", "matplotlib", "numpy", "opencv-python-headless", "scipy")


def write_verify_report(
    out: Path,
    found: VerifyResult,
    spectrum: ThinRows,
    references: Sequence[Reference],
    made_utc: str,
    settings: Mapping[str, Any],
    asked: Mapping[str, Any],
    command: str,
) -> None:
    """Write the report on a verdict.

    Parameters
    ----------
    out : Path
        Folder.
    found : VerifyResult
    spectrum : ThinRows
        Of the epoch that the verdict is about.
    references : sequence of Reference
        All that were compared with.
    made_utc : str
        Time of the report.
    settings : mapping of str
        Settings by stage.
    asked : mapping of str
        Other arguments, without folders: where files are is private.
    command : str
        Command that makes the same report; may be empty.
    """
    analysis = found.analysis
    epoch = analysis.result.header.epoch
    groups = {name: dataclasses.asdict(each) for name, each in settings.items()}
    case = Basis(
        result=analysis.result,
        verdict=found.to_dict(),
        estimates=[e for e in analysis.estimates if e.header.epoch == epoch],
        spectrum=spectrum,
        grid=grids_of([found.reference])[0],
        recording=_recording(found),
        references=[_facts(reference) for reference in references],
        settings=settings["match"],
        command=command,
        parameters={"asked for": asked, **groups, **_calibration(analysis.result.method)},
        versions=_versions(),
        idle=analysis.idle_by_epoch.get(epoch),
    )
    write_report(out, case, made_utc)


def _recording(found: VerifyResult) -> RecordingFacts:
    facts, container = input_facts(found.recording), container_facts(Path(found.recording))
    clock = found.analysis.clocks[found.analysis.result.header.epoch]
    return RecordingFacts(
        name=facts["input"],
        bytes=int(facts["input_bytes"]),
        sha256=facts["input_sha256"],
        seconds=found.analysis.seconds,
        stretches=len(found.analysis.stretches_s),
        frame_rate_hz=number(clock.frame_rate_hz),
        container=dataclasses.asdict(container) if container else None,
    )


def _facts(reference: Reference) -> ReferenceFacts:
    return ReferenceFacts(
        name=reference.name,
        bytes=reference.size_bytes,
        sha256=reference.sha256,
        grid=reference.grid,
        nominal_hz=reference.nominal_hz,
        t0_ns=reference.t0_ns,
        step_s=reference.step_s,
        samples=reference.freq_hz.size,
        **_sample_counts(reference),
        notes=reference.notes,
    )


def _sample_counts(reference: Reference) -> dict[str, Any]:
    """Count a reference's samples, those missing and those of several readings, in pieces."""
    valid = gaps = longest = duplicates = run = 0
    for start in range(0, reference.freq_hz.size, PIECE):
        part = slice(start, start + PIECE)
        missing = np.isnan(reference.freq_hz[part])
        valid += int((~missing).sum())
        duplicates += int((reference.readings[part] > 1).sum())
        edges = np.flatnonzero(np.diff(missing, prepend=False, append=False))
        lengths = edges[1::2] - edges[::2]
        joined = bool(run and missing[0])
        gaps += lengths.size - joined
        if joined:
            lengths[0] += run
        longest = max(longest, int(lengths.max(initial=0)))
        run = int(lengths[-1]) if missing[-1] else 0
    return {
        "valid_samples": valid,
        "gaps": gaps,
        "longest_gap_s": longest * reference.step_s,
        "duplicates": duplicates,
    }


def _calibration(method: str) -> dict[str, Mapping[str, Any]]:
    """Calibration of a method's likelihood ratios, if they are calibrated."""
    if method != "phase":
        return {}
    facts = dataclasses.asdict(calibration())
    lines = {name: value for name, value in facts.items() if isinstance(value, dict)}
    of_lines = {f"{name}, {k}": v for name, line in lines.items() for k, v in line.items()}
    return {"calibration": {"made": facts["made"], **of_lines}}


def _versions() -> dict[str, str]:
    """Versions of the program and of the libraries its results depend on, and the machine."""
    import av

    found, is_built = commit()
    # The decoder's own version, which determines what frames look like.
    codec = ".".join(map(str, av.library_versions["libavcodec"]))
    return {
        "rsenf": __version__,
        "commit": found or "not known",
        "installed from": "a wheel of that commit"
        if is_built
        else "source files, which may differ from it",
        **machine_facts(),
        **program_versions(LIBRARIES),
        "libavcodec": codec,
    }

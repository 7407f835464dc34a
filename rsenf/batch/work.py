"""Analyses one recording of a batch and makes its row of the table."""

from __future__ import annotations

import contextlib
import functools
import hashlib
import json
import math
import re
import socket
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rsenf import __version__
from rsenf.api.discover import PAGE, discover
from rsenf.api.idle import idle
from rsenf.api.shared import Result, open_references
from rsenf.api.track import TrackResult, track
from rsenf.api.verify import verify
from rsenf.batch.columns import DONE, NO_SIGNAL, UNUSABLE, Row, make_row
from rsenf.batch.settings import RecordingFile, Settings, recording_of
from rsenf.errors import InputError, NoSignal, RsenfError, SchemaMismatch, UsageError
from rsenf.messages import EnfEstimate
from rsenf.model import load_effects
from rsenf.record.provenance import input_facts
from rsenf.reference import Reference
from rsenf.report.discovery import camera_words, effect_words, kind_words
from rsenf.report.values import number
from rsenf.run.inputs import Input, open_input_file
from rsenf.whole_file import whole_file


def track_figures(estimates: Sequence[EnfEstimate], frame_rate_hz: float) -> dict[str, Any]:
    """Return the number of estimates, and statistics of the usable ones.

    The mean's standard error is the mean of the estimates': their errors may be fully correlated,
    as with overlapping windows, and then averaging doesn't reduce them.

    Parameters
    ----------
    estimates : sequence of EnfEstimate
    frame_rate_hz : float
        Of the camera, over the whole recording.
    """
    usable = [e for e in estimates if e.usable]
    figures: dict[str, Any] = {"values": len(estimates), "usable_values": len(usable)}
    if not usable:
        return figures
    enf_hz = [e.enf_hz for e in usable]
    std_hz = [e.enf_std_hz for e in usable if e.enf_var_hz2 >= 0.0]
    snr_db = [e.snr_db for e in usable if math.isfinite(e.snr_db)]
    last = usable[-1]
    return figures | {
        "enf_mean_hz": statistics.fmean(enf_hz),
        "enf_mean_std_hz": statistics.fmean(std_hz) if std_hz else None,
        "enf_min_hz": min(enf_hz),
        "enf_max_hz": max(enf_hz),
        "enf_std_median_hz": statistics.median(std_hz) if std_hz else None,
        "snr_median_db": statistics.median(snr_db) if snr_db else None,
        "nominal_hz": last.nominal_hz,
        "harmonic": last.harmonic,
        "line_hz": last.line_hz,
        "frame_rate_hz": frame_rate_hz,
    }


TRACKS, DISCOVERIES = "tracks", "discoveries"  # subfolders of a batch


@dataclass(frozen=True)
class Job:
    """A recording and its settings."""

    recording: RecordingFile
    settings: Settings


def work_on(job: Job) -> Row:
    """Return a recording's row.

    Raises
    ------
    RsenfError
        If the recording is not the cause: it changed since it was found, or the worker has another
        version.
    """
    recording, settings = job.recording, job.settings
    if settings.version != __version__:
        raise RsenfError(f"the batch is rsenf {settings.version}'s, this worker has {__version__}")
    _check_same(recording, "when it was looked for")
    # Opened here what all recordings need, so that an error isn't blamed on a recording.
    if settings.references:
        _references(settings)
    if settings.analysis == "discover":
        _discover_start(settings)
    begun_s = time.monotonic()
    try:
        row = _analysed(recording, settings)
    except NoSignal as exc:
        row = {"status": NO_SIGNAL, "reason": _nameless(exc.message, recording)}
    except (UsageError, InputError, SchemaMismatch) as exc:
        row = {"status": UNUSABLE, "reason": _nameless(str(exc), recording)}
    row |= {"sha256": _sha256(recording)}
    _check_same(recording, "before it was read")
    row |= {"took_s": time.monotonic() - begun_s, "host": socket.gethostname()}
    row |= {"rsenf_version": __version__}
    return make_row(recording, settings.analysis, settings.fingerprint, **row)


def _sha256(recording: RecordingFile) -> str | None:
    """Return the hash of a readable file; it takes little time compared with decoding."""
    with contextlib.suppress(InputError):
        if Path(recording.path).is_file():
            return input_facts(recording.path)["input_sha256"]
    return None


def _nameless(reason: str, recording: RecordingFile) -> str:
    """Return a reason without the recording's name, which has its own column."""
    return reason.removeprefix(recording.path).lstrip(": ")


def _check_same(recording: RecordingFile, when: str) -> None:
    there = recording_of(recording.path)
    if (there.size_bytes, there.modified_ns) != (recording.size_bytes, recording.modified_ns):
        raise RsenfError(f"not what it was {when}, or not there, as seen from this host")


def _analysed(recording: RecordingFile, settings: Settings) -> Row:
    """Open and analyse a recording."""
    opened = open_input_file(
        recording.path,
        camera=settings.camera,
        begin=settings.begin,
        threads=settings.threads,
        frame_rate_hz=settings.frame_rate_hz,
        effort=settings.effort,
    )
    return ANALYSES[settings.analysis](opened, settings)


def _verify(opened: Input, settings: Settings) -> Row:
    found = verify(opened, _references(settings), **settings.options)
    row = found.to_dict() | _read(found) | _heard(found.enf)
    return row | {"reason": found.reason or row["reason"]}


def _idle(opened: Input, settings: Settings) -> Row:
    found = idle(opened, **settings.options)
    status = NO_SIGNAL if found.verdict == "no_signal" else DONE
    return found.to_dict() | _read(found) | {"status": status, "reason": found.reason or ""}


def _track(opened: Input, settings: Settings) -> Row:
    found = track(opened, **settings.options)
    name = f"{TRACKS}/{_own_name(opened.called)}.jsonl"
    path = Path(settings.out, name)
    path.parent.mkdir(exist_ok=True)
    with whole_file(path) as part:
        lines = (json.dumps(e, allow_nan=False) for e in found.to_dict()["estimates"])
        part.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")
    figures = track_figures(found.analysis.estimates, found.analysis.frame_rate_hz)
    return figures | _read(found) | _heard(found) | {"enf_file": name}


def _discover(opened: Input, settings: Settings) -> Row:
    name = f"{DISCOVERIES}/{_own_name(opened.called)}"
    seconds = [opened.duration_s]  # updated while reading, unless an earlier run has read it
    _discover_start(settings)
    found = discover(
        opened, _references(settings) or None, out=Path(settings.out, name),
        camera=settings.camera, progress=seconds.append, **settings.options,
    )  # fmt: skip
    gap = found.gap
    return {
        "status": DONE,
        "reason": "",
        "verdict": found.verdict,
        "effects": [effect_words(effect) for effect in found.effects],
        "gap_before": number(gap["before"]),
        "gap_before_stderr": number(gap["before_stderr"]),
        "gap_after": number(gap["after"]),
        "gap_stderr": number(gap["stderr"]),
        "gap_floor": number(gap["floor"]),
        "gap_limit": number(gap["limit"]),
        "shrinkage": gap["shrinkage"],
        "unexplained": kind_words(found.unexplained) if found.unexplained else "",
        "camera": camera_words(found.document["camera"]) if "camera" in found.document else "",
        "report": f"{name}/{PAGE}",
        "model": found.of_camera,
        "warnings": [found.note] if found.note else [],
        "loss": found.loss,
        "recording_s": seconds[-1],
    }


ANALYSES: dict[str, Callable[[Input, Settings], Row]] = {
    "verify": _verify,
    "idle": _idle,
    "track": _track,
    "discover": _discover,
}


def _read(found: Result) -> Row:
    """Return how much of a recording was read, what was lost, and the warnings."""
    return {"recording_s": found.analysis.seconds, "loss": found.loss, "warnings": found.remarks}


def _heard(found: TrackResult) -> Row:
    """Return whether there was a signal, and if not, why."""
    if found.usable.any():
        return {"status": DONE, "reason": ""}
    return {"status": NO_SIGNAL, "reason": found.summary}


@functools.lru_cache(maxsize=1)
def _references(settings: Settings) -> list[Reference]:
    """Open the references, once for all recordings of this process."""
    named = settings.references
    return open_references(named, **settings.reading) if named else []


@functools.lru_cache(maxsize=1)
def _discover_start(settings: Settings) -> None:
    """Load the additional effects, once."""
    for path in settings.effects:
        load_effects(path)


def _own_name(path: str) -> str:
    """Return a unique name for a recording's own results."""
    key = hashlib.sha256(recording_of(path).key.encode("utf-8", "surrogateescape")).hexdigest()[:8]
    return f"{re.sub(r'[^0-9A-Za-z._-]+', '_', Path(path).stem).strip('.')[:60]}-{key}"

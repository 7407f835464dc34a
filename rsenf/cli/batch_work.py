"""What 'rsenf batch' does with one recording: the verb for it, its answer as a row of a table."""

from __future__ import annotations

import argparse
import contextlib
import functools
import hashlib
import json
import re
import socket
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from rsenf import __version__
from rsenf.batch.columns import DONE, NO_SIGNAL, UNUSABLE, Row, make_row
from rsenf.batch.recordings import Recording, recording_of
from rsenf.errors import InputError, NoSignal, RsenfError, SchemaMismatch, UsageError
from rsenf.run.inputs import open_input_file

if TYPE_CHECKING:
    from rsenf.cli.references import Opened
    from rsenf.match.series import Grid
    from rsenf.model import CaptureModel
    from rsenf.run.inline import Analysis
    from rsenf.run.inputs import Input

TRACKS, DISCOVERIES = "tracks", "discoveries"  # folders within a batch's


@dataclass(frozen=True)
class Settings:
    """How every recording of a batch is treated.

    Parameters
    ----------
    analysis : str
        The verb.
    fingerprint : str
        Of all that results depend on besides the recordings; two with the same are the same.
    arguments : Namespace
        Of the verb, its paths absolute.
    out : str
        Folder of the batch.
    threads : int
        That decode a video.
    version : str
        Of rsenf.
    """

    analysis: str
    fingerprint: str
    arguments: argparse.Namespace = field(compare=False)
    out: str
    threads: int
    version: str = __version__


@dataclass(frozen=True)
class Job:
    """A recording, and how it is treated."""

    recording: Recording
    settings: Settings


def work_on(job: Job) -> Row:
    """Return a recording's row.

    Raises
    ------
    RsenfError
        When the recording is not to blame: it isn't as it was found, or this is another version.
    """
    recording, settings = job.recording, job.settings
    if settings.version != __version__:
        raise RsenfError(f"the batch is rsenf {settings.version}'s, this worker has {__version__}")
    _check_same(recording, "when it was looked for")
    _open_shared(settings)
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


def _sha256(recording: Recording) -> str | None:
    """Return the hash of a file that can be read; it costs little beside decoding."""
    from rsenf.record.provenance import input_facts

    with contextlib.suppress(InputError):
        if Path(recording.path).is_file():
            return input_facts(recording.path)["input_sha256"]
    return None


def _nameless(reason: str, recording: Recording) -> str:
    """Return a reason without the name of the recording, which stands beside it."""
    return reason.removeprefix(recording.path).lstrip(": ")


def _check_same(recording: Recording, when: str) -> None:
    there = recording_of(recording.path)
    if (there.size_bytes, there.modified_ns) != (recording.size_bytes, recording.modified_ns):
        raise RsenfError(f"not what it was {when}, or not there, as seen from this host")


def _analysed(recording: Recording, settings: Settings) -> Row:
    """Have the verb's own functions look at a recording."""
    args = argparse.Namespace(**vars(settings.arguments), input=recording.path)
    begin = getattr(args, "begin", "rows")
    opened = open_input_file(
        recording.path, camera=args.camera, begin=begin, threads=settings.threads
    )
    return _ANALYSES[settings.analysis](args, opened, settings)


def _verify(args: argparse.Namespace, opened: Input, settings: Settings) -> Row:
    from rsenf.cli.verify import verdict_of, verified

    references = _references(settings)
    analysis = verified(args, opened, references)
    told = verdict_of(args, analysis, references)
    warnings = [line for line in told.pop("warnings") if line != analysis.loss]
    row = told | _read(analysis) | _heard(analysis) | {"warnings": warnings}
    return row | {"reason": told["reason"] or row["reason"]}


def _idle(args: argparse.Namespace, opened: Input, settings: Settings) -> Row:
    from rsenf.cli.idle import estimate_of, estimated

    analysis = estimated(args, opened)
    told = estimate_of(analysis)
    status = NO_SIGNAL if told["verdict"] == "no_signal" else DONE
    warnings = [line for line in told.pop("warnings") if line != analysis.loss]
    more = {"status": status, "reason": told["reason"] or "", "warnings": warnings}
    return told | _read(analysis) | more


def _track(args: argparse.Namespace, opened: Input, settings: Settings) -> Row:
    from rsenf.batch.track_figures import track_figures
    from rsenf.cli.track import as_json, tracked
    from rsenf.whole_file import whole_file

    analysis = tracked(args, opened)
    name = f"{TRACKS}/{_own_name(args.input)}.jsonl"
    path = Path(settings.out, name)
    path.parent.mkdir(exist_ok=True)
    with whole_file(path) as part:
        lines = (json.dumps(as_json(e), allow_nan=False) for e in analysis.estimates)
        part.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")
    row = track_figures(analysis.estimates) | _read(analysis) | _heard(analysis)
    return row | {"warnings": analysis.warnings, "enf_file": name}


def _discover(args: argparse.Namespace, opened: Input, settings: Settings) -> Row:
    from rsenf.cli.discover import PAGE, discovered
    from rsenf.report.discovery import effect_words
    from rsenf.report.hint_words import kind_words
    from rsenf.report.verdict import number

    name = f"{DISCOVERIES}/{_own_name(args.input)}"
    args.out = Path(settings.out, name)
    seconds = [opened.duration_s]  # told as they are read, unless they were in an earlier run
    reading = contextlib.nullcontext(seconds.append)
    result, loss = discovered(args, opened, *_begun_with(settings), reading)
    told, gap = result.told, result.told["gap"]
    return {
        "status": DONE,
        "reason": "",
        "verdict": told["verdict"],
        "effects": [effect_words(effect) for effect in told["effects"]],
        "gap_before": number(gap["before"]),
        "gap_before_stderr": number(gap["before_stderr"]),
        "gap_after": number(gap["after"]),
        "gap_stderr": number(gap["stderr"]),
        "gap_floor": number(gap["floor"]),
        "gap_limit": number(gap["limit"]),
        "shrinkage": gap["shrinkage"],
        "unexplained": kind_words(told["unexplained"]) if told["unexplained"] else "",
        "report": f"{name}/{PAGE}",
        "warnings": [result.note] if result.note else [],
        "loss": loss,
        "recording_s": seconds[-1],
    }


_ANALYSES: dict[str, Callable[[argparse.Namespace, Input, Settings], Row]] = {
    "verify": _verify,
    "idle": _idle,
    "track": _track,
    "discover": _discover,
}


def _read(analysis: Analysis) -> Row:
    """Return how much of a recording was read, and what wasn't."""
    return {"recording_s": analysis.seconds, "loss": analysis.loss}


def _heard(analysis: Analysis) -> Row:
    """Return whether there was a signal, and if not, why."""
    from rsenf.cli.track import summary

    if any(e.usable for e in analysis.estimates):
        return {"status": DONE, "reason": ""}
    return {"status": NO_SIGNAL, "reason": summary(analysis)}


@functools.lru_cache(maxsize=1)
def _references(settings: Settings) -> list[Opened]:
    """Open the references once for all recordings that this process works on."""
    from rsenf.cli.references import open_references

    return open_references(settings.arguments)


@functools.lru_cache(maxsize=1)
def _begun_with(settings: Settings) -> tuple[CaptureModel, Grid | None]:
    """Open what every discovery begins with, once."""
    from rsenf.cli.discover import begun_with

    return begun_with(settings.arguments)


def _open_shared(settings: Settings) -> None:
    """Open what all recordings need: where that can't be, none of them is to blame."""
    if settings.analysis == "verify":
        _references(settings)
    elif settings.analysis == "discover":
        _begun_with(settings)


def _own_name(path: str) -> str:
    """Return a name for a recording's own results that no other recording has."""
    key = hashlib.sha256(recording_of(path).key.encode("utf-8", "surrogateescape")).hexdigest()[:8]
    return f"{re.sub(r'[^0-9A-Za-z._-]+', '_', Path(path).stem).strip('.')[:60]}-{key}"

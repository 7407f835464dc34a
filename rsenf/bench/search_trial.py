"""One search of a long reference, timed beside a plain FFT correlation of the same sizes."""

from __future__ import annotations

import math
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median
from typing import Any, cast

import numpy as np
import scipy

from rsenf import __version__
from rsenf.batch.journal import Record, read_records
from rsenf.bench.search_days import (
    FIRST_S,
    GRID,
    NOMINAL_HZ,
    Haystack,
    clip_of,
    real_day,
    write_haystack,
)
from rsenf.bench.session import measure_missing
from rsenf.match import MatchSettings
from rsenf.match.phase import match_phase
from rsenf.match.series import Grid, Track
from rsenf.messages.schema import FloatArray
from rsenf.timebase import seconds

VERSION = 2
RIGHT_S = 1.0  # a match is right when its lag is no further from the truth


@dataclass(frozen=True)
class Trial:
    """A search to be timed so many times; ``store`` holds its reference once it is written."""

    haystack: Haystack
    repeats: int
    store: Path = Path()

    @property
    def key(self) -> str:
        """Name that tells it from any other."""
        h = self.haystack
        gaps = "gaps" if h.gaps else "whole"
        return f"{h.days} days {gaps} {h.clip_s}s {h.seed} x{self.repeats} v{VERSION}"


def measure_trials(
    trials: Sequence[Trial], out: Path, progress: Callable[[Trial], None]
) -> list[Record]:
    """Measure what has no record yet, one after the other, each in a process of its own."""
    for trial in trials:
        if trial.key not in read_records(out):
            progress(trial)
            with tempfile.TemporaryDirectory() as folder:
                write_haystack(trial.haystack, Path(folder))
                measure_missing([replace(trial, store=Path(folder))], timed_search, out, 1)
    records = read_records(out)
    return [records[trial.key] for trial in trials]


class _Stopwatch:
    """Times and memory of pieces of work, by their names."""

    def __init__(self) -> None:
        self.seconds: dict[str, list[float]] = {}
        self.cpu_s: dict[str, list[float]] = {}
        self.peak_mb: dict[str, float | None] = {}

    def __call__(self, name: str, work: Callable[..., Any], *given: Any) -> Any:
        """Do some work on what is given, and write down what it took."""
        held_mb = _restarted_peak_mb()
        began_s, began_cpu_s = time.perf_counter(), time.process_time()
        out = work(*given)
        self.cpu_s.setdefault(name, []).append(time.process_time() - began_cpu_s)
        self.seconds.setdefault(name, []).append(time.perf_counter() - began_s)
        peak_mb = _status_mb("VmHWM")
        if held_mb is not None and peak_mb is not None:
            self.peak_mb.setdefault(name, peak_mb - held_mb)
        return out


def timed_search(trial: Trial) -> Record:
    """Search for the clip in the store and in memory, and correlate it, in turn.

    The first search is that of the store, before anything else takes memory. Of each time the
    median counts.
    """
    from scipy.signal import correlate, oaconvolve

    haystack, settings = trial.haystack, MatchSettings()
    track, day = clip_of(haystack), real_day(haystack.folder, haystack.seed)
    hour = Grid("warm up", NOMINAL_HZ, 0, 1.0, day.freq_hz[:7200])
    match_phase(track, [hour], settings)  # imports, and what is worked out once for all
    watch, clip = _Stopwatch(), _away(track.enf_hz)
    found = watch("store", match_phase, track, [_stored(trial.store)], settings)
    held = _stored(trial.store)
    held = replace(held, freq_hz=np.asarray(held.freq_hz))
    away = _away(held.freq_hz)
    for again in range(trial.repeats):
        if again:
            watch("store", match_phase, track, [_stored(trial.store)], settings)
        watch("memory", match_phase, track, [held], settings)
        watch("correlate", correlate, away, clip, "valid", "fft")
        watch("oaconvolve", oaconvolve, away, clip[::-1], "valid")
    # What the store has begins with its first sample that isn't in a gap.
    true_lag_s = haystack.clip_start_s - (seconds(held.t0_ns) - FIRST_S)
    error_s = found.lag_s - true_lag_s
    return {
        "version": VERSION,
        "key": trial.key,
        "days": haystack.days,
        "gaps": haystack.gaps,
        "clip_s": haystack.clip_s,
        "seed": haystack.seed,
        "grid": day.name,
        "samples": held.freq_hz.size,
        "missing_ratio": float(np.isnan(held.freq_hz).mean()),
        "clip_in_reference_ratio": _covered(held, track, true_lag_s),
        "repeats": trial.repeats,
        "decision": found.decision,
        "lag_error_s": None if math.isnan(error_s) else error_s,
        "right": abs(error_s) <= RIGHT_S,
        "seconds": {name: median(all_s) for name, all_s in watch.seconds.items()},
        "cpu_s": {name: median(all_s) for name, all_s in watch.cpu_s.items()},
        "peak_mb": watch.peak_mb,
        "versions": {
            "rsenf": __version__, "numpy": np.__version__, "scipy": scipy.__version__
        },
    }  # fmt: skip


def _stored(store: Path) -> Grid:
    """Open the reference, of which nothing has been read."""
    from rsenf.reference import open_reference

    reference = open_reference(f"store:{GRID}", store=store)
    freq_hz = cast("FloatArray", reference.freq_hz)  # read as it is asked for, in slices
    return Grid(GRID, reference.nominal_hz, reference.t0_ns, reference.step_s, freq_hz)


def _away(freq_hz: FloatArray) -> FloatArray:
    """Deviation from the nominal frequency, none in gaps: what a plain correlation takes."""
    return np.asarray(np.nan_to_num(freq_hz - NOMINAL_HZ, nan=0.0), np.float64)


def _covered(grid: Grid, track: Track, lag_s: float) -> float:
    """Share of the clip's usable seconds that the reference has."""
    at = int(lag_s) + np.flatnonzero(np.isfinite(track.enf_hz))
    return float(np.isfinite(grid.freq_hz[at]).mean())


def _restarted_peak_mb() -> float | None:
    """Begin anew to watch for the most memory held; return what is held now."""
    # The peak of getrusage() can't begin anew, and of a new process it is that of its parent.
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
    return _status_mb("VmRSS")


def _status_mb(name: str) -> float | None:
    """Memory of this process in MB; None where the system doesn't tell."""
    try:
        lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    except OSError:
        return None
    return next(int(line.split()[1]) / 1024 for line in lines if line.startswith(f"{name}:"))

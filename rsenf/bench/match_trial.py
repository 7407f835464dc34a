"""Searches of a long reference for a clip, and the match stage on a stream: time and memory.

A search is timed beside a plain loop over the lags, and beside a correlation by FFT. At the end:
the tables of both.
"""

from __future__ import annotations

import math
import os
import shutil
import tempfile
import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from rsenf.batch.journal import Record
from rsenf.bench import harness
from rsenf.bench import match_days as days_of
from rsenf.bench.match_days import DAY_S, NOMINAL_HZ, Haystack, clip_of, estimates_of, real_day
from rsenf.bench.measure import through, versions
from rsenf.bench.statistics import Row, origin_of
from rsenf.bench.tables import Column, shown, table_of, titled
from rsenf.errors import UsageError
from rsenf.match import Match, MatchSettings
from rsenf.match.phase import match_phase
from rsenf.match.score import LagScorer, survey
from rsenf.match.series import Grid, Track
from rsenf.reference import open_reference
from rsenf.timebase import seconds

VERSION = 3
RIGHT_S = 1.0  # largest error of a correct lag
LONGEST_PLAIN = 400 * DAY_S  # samples, whose spectra take 1.4 GB
STREAM_VERSION = 1
SEARCHES, STREAMS = "match_searches.jsonl", "match_streams.jsonl"
EVERY_S = 60.0
SHORTEST_S = 600
SPANS = {1: "a day", 7: "a week", 30: "a month", 365: "a year", 3653: "ten years"}
LAGS = days_of.RUN * days_of.RUNS
_NOTE = f"""\
search: blind, by the method phase, from a clip's estimates to the verdict, the reference read from
the store as the search goes on; all lags: the part of it that looks at every lag. loop: the same
comparison of every lag by a plain loop in NumPy over a reference in memory (subtract, leave out
gaps, mean, variance), timed on {LAGS:,} lags and scaled; in brackets, all of a day's. ÷ all lags:
loop over that; ÷ search: the search with the loop in it over the search. plain FFT:
scipy.signal.correlate of the whole reference, to no verdict. Seconds of processor time, medians,
the ratios' of each round's own; MB: the most memory that a search took, beyond what the program
held before it. found: clips, of so many; error: the worst; clip there: how much of the clip's time
isn't a gap."""
_STREAM_NOTE = """\
A clip that comes in second by second, searched for in a day of reference: at every minute, later
whenever a quarter more of it is there, and at the end, where the finding is examined, too. Seconds
of processor time of the stage; ms a second: of the clip; MB: the most memory beyond the start's."""


def _timed_searches(haystack: Haystack, repeats: int, store: Path) -> Record:
    """Time searches of one reference, in turn with what they are compared with.

    Each repeat has a clip with independent errors.
    """
    day = real_day(haystack.folder, haystack.seed)
    load, settings = os.getloadavg()[0], MatchSettings()
    hour = replace(day, freq_hz=day.freq_hz[:7200])
    match_phase(clip_of(haystack, repeats), [hour], settings)  # warm-up: imports, caches
    most_mb = harness.watch_memory()
    found, times, peak_mb = [], [], None
    for again in range(repeats):
        track, grid, took = clip_of(haystack, again), _stored(store), {}
        finding, took["search"] = harness.timed(match_phase, track, [grid], settings)
        peak_mb = peak_mb or most_mb()  # of the first search, before the others run
        _, took["lags"] = harness.timed(survey, track, _stored(store), settings)
        times.append(took | _beside(track, grid, haystack.seed, settings))
        found.append(finding)
    # A store begins with the first sample that isn't in a gap.
    true_lag_s = haystack.clip_start_s - (seconds(grid.t0_ns) - days_of.FIRST_S)
    errors_s = [abs(f.lag_s - true_lag_s) for f in found]
    parts = (grid.freq_hz[k : k + DAY_S] for k in range(0, grid.freq_hz.size, DAY_S))
    there = grid.freq_hz[int(true_lag_s) : int(true_lag_s) + track.enf_hz.size]
    return {
        "version": VERSION,
        **{name: getattr(haystack, name) for name in ("days", "gaps", "clip_s", "seed")},
        "grid": day.name,
        "samples": grid.freq_hz.size,
        "missing_ratio": float(sum(np.isnan(part).sum() for part in parts)) / grid.freq_hz.size,
        "clip_in_reference_ratio": float(np.isfinite(there[np.isfinite(track.enf_hz)]).mean()),
        "repeats": repeats,
        "right": sum(error_s <= RIGHT_S for error_s in errors_s),
        "worst_error_s": max((e for e in errors_s if not math.isnan(e)), default=None),
        "cpu_s": {name: median(t[name] for t in times) for name in times[0]},
        "loop_over_lags": median(t["loop"] / t["lags"] for t in times),
        "loop_over_search": median((t["loop"] - t["lags"]) / t["search"] + 1.0 for t in times),
        "peak_mb": peak_mb,
        "load": load,
        "versions": versions(),
    }


def _beside(track: Track, grid: Grid, seed: int, settings: MatchSettings) -> dict[str, float]:
    """Time the loop and the FFT; the whole loop only on a short reference."""
    clip_hz, out = track.enf_hz, {}
    least = LagScorer(track, np.empty(0), settings, track.usable * track.hop_s).min_pairs
    lags = grid.freq_hz.size + clip_hz.size - 1
    out["loop"] = days_of.loop_cpu_s(clip_hz, grid.freq_hz, lags, least, seed)
    if grid.freq_hz.size > LONGEST_PLAIN:
        return out
    from scipy.signal import correlate

    held = np.asarray(grid.freq_hz)
    away = (np.nan_to_num(freq_hz - NOMINAL_HZ, nan=0.0) for freq_hz in (held, clip_hz))
    _, out["correlate"] = harness.timed(correlate, *away, "valid", "fft")
    if grid.freq_hz.size <= DAY_S:
        given = clip_hz, held, 1 - clip_hz.size, lags, least
        _, out["whole_loop"] = harness.timed(days_of.lag_by_lag, *given)
    return out


def _stored(store: Path) -> Grid:
    reference = open_reference(f"store:{days_of.GRID}", store=store)
    # Its samples are read on access, in slices.
    return Grid(
        days_of.GRID, reference.nominal_hz, reference.t0_ns, reference.step_s, reference.freq_hz
    )


def _timed_stream(clip_s: int, seed: int, folder: Path | None) -> Record:
    """Match a clip that arrives second by second with a day of reference, every minute.

    Returns time, memory and number of results.
    """
    grid = real_day(folder, seed)
    track = clip_of(Haystack(1, False, clip_s, seed, folder))
    through(Match(grids=[grid]), estimates_of(track.between(0, 60)))  # warm-up
    most_mb = harness.watch_memory()
    stage, results = Match(grids=[grid], interim_every_s=EVERY_S), []
    began_s = time.process_time()
    for estimate in estimates_of(track):
        results += stage.update(estimate)
    coming_s = time.process_time() - began_s
    last, last_s = harness.timed(stage.flush)
    results, peak_mb = results + last, most_mb()
    return {
        "version": STREAM_VERSION,
        "clip_s": clip_s,
        "results": len(results),
        "matches": sum(result.decision == "match" for result in results),
        "coming_cpu_s": coming_s,
        "cpu_s": coming_s + last_s,
        "peak_mb": peak_mb,
    }


def _tabulated(records: Sequence[Record], streams: Sequence[Record] = ()) -> dict[str, Any]:
    return {
        "table": "match",
        "streams": list(streams),
        "clip_s": sorted({r["clip_s"] for r in records}),
        **origin_of(records),
        "repeats": sorted({r["repeats"] for r in records}),
        "loads": harness.loads_of(records),
        "rows": list(records),
    }


def _text(document: dict[str, Any], *, on_page: bool = False) -> str:
    tables = (
        table_of("Searches", _COLUMNS, document["rows"]),
        table_of("A clip that comes in", _STREAM_COLUMNS, document["streams"]),
    )
    clips, repeats, grids = (
        ", ".join(map(str, document[name])) for name in ("clip_s", "repeats", "grids")
    )
    made = f"clips: {clips} s; grid: {grids}, and days like it; medians of {repeats}; "
    made += harness.load_said(document)
    return titled(tables, [made] if on_page else [_NOTE, _STREAM_NOTE, made], on_page=on_page)


def _loop(row: Row) -> str:
    whole = row["cpu_s"].get("whole_loop")
    return f"{row['cpu_s']['loop']:,.3g} s" + ("" if whole is None else f" ({whole:.2f} s)")


_COLUMNS: tuple[Column, ...] = (
    ("reference", lambda r: SPANS.get(r["days"], f"{r['days']} days")),
    ("samples", "samples", ",d"),
    ("gaps", lambda r: f"{r['missing_ratio']:.0%}" if r["gaps"] else "none"),
    ("clip there", "clip_in_reference_ratio", ".0%"),
    ("found", lambda r: f"{r['right']} of {r['repeats']}"), ("error", "worst_error_s", ".2f s"),
    ("search", lambda r: f"{r['cpu_s']['search']:.2f} s"),
    ("ns a sample", lambda r: f"{r['cpu_s']['search'] / r['samples'] * 1e9:,.0f}"),
    ("MB", "peak_mb", ".0f"), ("all lags", lambda r: f"{r['cpu_s']['lags']:.3g} s"),
    ("loop", _loop), ("÷ all lags", "loop_over_lags", ".0f"),
    ("÷ search", "loop_over_search", ".0f"),
    ("plain FFT", lambda r: shown(r["cpu_s"].get("correlate"), ".2f s")),
)  # fmt: skip
_STREAM_COLUMNS: tuple[Column, ...] = (
    ("clip", lambda r: f"{r['clip_s'] / 60:g} min" if r["clip_s"] < 3600
     else f"{r['clip_s'] / 3600:g} h"),
    ("results", "results"), ("matches", "matches"), ("all results", "cpu_s", ".2f s"),
    ("the last one", lambda r: f"{r['cpu_s'] - r['coming_cpu_s']:.2f} s"),
    ("ms a second", lambda r: f"{r['cpu_s'] / r['clip_s'] * 1e3:.2f}"), ("MB", "peak_mb", ".0f"),
)  # fmt: skip


def measure(run: harness.BenchRun) -> harness.Made:
    """Time the searches and the streams that are missing."""
    options, seed, grids = run.options, run.options.seed, run.options.grids
    clip_s = round(options.duration_s or SHORTEST_S)
    if clip_s > days_of.LONGEST_CLIP_S:
        raise UsageError(f"a clip of {clip_s} s", f"at most {days_of.LONGEST_CLIP_S} s fit a day")
    repeats = options.repeat or (1 if options.quick else 5)
    haystacks = [
        Haystack(days, gaps, clip_s, seed, grids)
        for days in SPANS
        for gaps in (False, True)
        if not (options.quick and days > 7)
    ]
    lengths_s = (SHORTEST_S,) if options.quick else (SHORTEST_S, 3600, 3 * 3600, 10 * 3600)
    streams = {
        f"stream {length_s}s {seed} v{STREAM_VERSION}": (length_s, seed, grids)
        for length_s in lengths_s
    }
    records = _searches(run, haystacks, repeats)
    return harness.Made(_tabulated(records, run.in_turn(streams, _timed_stream, STREAMS)), _text)


def _searches(run: harness.BenchRun, haystacks: Sequence[Haystack], repeats: int) -> list[Record]:
    """Time the searches that are missing; each reference is in a store."""
    trials = {
        f"{of.days} days {'gaps' if of.gaps else 'whole'} {of.clip_s}s {of.seed} x{repeats} "
        f"v{VERSION}": (of, repeats)
        for of in haystacks
    }
    with tempfile.TemporaryDirectory() as folder:
        store = Path(folder) / "store"

        def prepare(haystack: Haystack, _: int) -> None:
            shutil.rmtree(store, ignore_errors=True)
            store.mkdir()
            days_of.write_haystack(haystack, store)

        return run.in_turn(trials, partial(_timed_searches, store=store), SEARCHES, prepare)

"""Films, the pieces they are cut into, and every matcher on every piece and reference.

A film shows a wall in a lamp's light, which follows a day of the grid; moving ones are hand-held,
and an object passes. Every matcher's decision and errors are against the truth.
"""

from __future__ import annotations

import dataclasses
import functools
import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from rsenf.bench import scenes
from rsenf.bench.measure import film as filmed_of
from rsenf.bench.measure import number, through, tried, versions
from rsenf.bench.recording_time import DAY_S, FRAME_RATE, MOVING, NOMINAL_HZ, PlannedFilm
from rsenf.match import Finding, MatchSettings
from rsenf.match.paper import Metric, metric
from rsenf.match.paper_search import Hypotheses, Tally, hypotheses_of, paper_search
from rsenf.match.series import grid_of
from rsenf.match.stage import Match
from rsenf.messages import EnfEstimate, MatchResult, RowBlock
from rsenf.model import GridPath, synthetic_grid
from rsenf.model.noise import generator
from rsenf.reference import Reference, read_reference, reference_blocks
from rsenf.timebase import NS_PER_S, nanoseconds
from rsenf.track import TrackSettings, make_tracker

# 2024-08-18 UTC; data before it is for calibration.
OTHER_FROM_NS = 1_723_939_200 * NS_PER_S
_SEEDS = (50, 51)  # of synthetic days
GAP_S = 600.0  # margin of the gap on either side of the piece
# What is searched: the film's day, the same with a gap at the piece's time, a day of another year.
PRESENT = "present"
SAME_DAY, OTHER_DAY = "same_day", "other_day"
WIDTH_RATIO, HEIGHT_RATIO, TOP_RATIO = (0.1, 0.3), (0.3, 0.7), (0.0, 0.5)
PERIOD_S, LEVEL_RATIO = (4.0, 20.0), (0.5, 1.3)
SHAKE_PX, SHAKE_S = (0.1, 0.6), (0.1, 0.5)
LENGTHS_S = (600.0, 300.0, 120.0, 60.0)
PAPER_METRICS = ("metric1", "metric2", "metric3", "metric4")
METHODS = (*PAPER_METRICS, "ncc", "phase")
VERSION = 2
TRUE_WITHIN_S = 1.0
TRUE, FALSE, NONE = ("true", "false", "none")  # outcomes of a trial

Said = MatchResult | Finding  # of a matcher; of the paper's metrics, the finding alone
Result = dict[str, Any]


@functools.cache
def _lit_day(grids: Path | None) -> Reference:
    """Return the day that the light of the films follows; synthetic without measured grids."""
    path = grids / scenes.MEASURED[NOMINAL_HZ] if grids else None
    return read_reference(path) if path and path.is_file() else _synthetic(_SEEDS[0])


@functools.cache
def _other_day(grids: Path | None) -> Reference:
    """Return 24 h of another year, those with the fewest gaps; none of the data for calibration."""
    path = grids / scenes.CE_2024 if grids else None
    if not path or not path.is_file():
        return _synthetic(_SEEDS[1])
    whole = read_reference(path)
    first = max(-(-(OTHER_FROM_NS - whole.t0_ns) // nanoseconds(whole.step_s)), 0)
    length = round(DAY_S / whole.step_s)
    valid = np.concatenate(([0], np.cumsum(np.isfinite(whole.freq_hz[first:]))))
    return _stretch(whole, first + int(np.argmax(valid[length:] - valid[:-length])), length)


def _stretch(reference: Reference, first: int, samples: int) -> Reference:
    """Return a part of a reference, from sample ``first`` on."""
    part, since_ns = slice(first, first + samples), nanoseconds(first * reference.step_s)
    return replace(
        reference,
        t0_ns=reference.t0_ns + since_ns if reference.t0_ns else 0,
        freq_hz=reference.freq_hz[part],
        readings=reference.readings[part],
    )


def _synthetic(seed: int) -> Reference:
    freq_hz = synthetic_grid(seed, DAY_S, nominal_hz=NOMINAL_HZ).freq_hz[: int(DAY_S)]
    return Reference("synthetic", NOMINAL_HZ, 0, 1.0, freq_hz, np.ones(freq_hz.size, np.uint32))


def references_of(
    film: PlannedFilm, begin_s: float, end_s: float, grids: Path | None
) -> Iterator[tuple[str, Reference]]:
    """Yield the names and references of the trials of a piece of a film, the same of all codings.

    Parameters
    ----------
    begin_s, end_s : float
        Of the piece, from the start of the day.
    """
    both = _lit_day(grids), _other_day(grids)
    day, other = (_stretch(of, 0, round(film.reference_s / of.step_s)) for of in both)
    # The same day with a gap, of all samples that overlap it.
    missing = np.zeros(day.freq_hz.size, bool)
    first, stop = (begin_s - GAP_S) / day.step_s, (end_s + GAP_S) / day.step_s
    missing[max(math.floor(first), 0) : max(math.ceil(stop), 0)] = True
    lacking = replace(
        day,
        freq_hz=np.where(missing, np.nan, day.freq_hz),
        readings=np.where(missing, 0, day.readings).astype(np.uint32),
    )
    for trial, reference in ((PRESENT, day), (SAME_DAY, lacking), (OTHER_DAY, other)):
        rng = generator(film.seed, f"{film.kind} {trial} {begin_s:.3f} {end_s:.3f}")
        freq_hz = scenes.published(reference.freq_hz, scenes.REFERENCE_NOISE_HZ, rng)
        yield trial, replace(reference, freq_hz=freq_hz)


def _setting_of(film: PlannedFilm) -> scenes.Setting:
    """Return the capture of a film, drawn from its camera and its seed."""
    camera, rng = film.camera_generator(), film.generator("scene")
    idle_ratio = float(camera.uniform(*scenes.IDLE_RATIO))
    model = scenes.wall(film.key, film.lamp, film.size, FRAME_RATE, idle_ratio, rng)
    exposure_s = scenes.spread(rng, scenes.EXPOSURE_S)
    seed = int(rng.integers(2**31))
    model = scenes.with_clock_error(model.with_effect("exposure", exposure_s=exposure_s), camera)
    if film.kind == MOVING:
        model = scenes.shaken(model, SHAKE_PX, SHAKE_S, rng).with_effect(
            "moving_object",
            width_ratio=float(rng.uniform(*WIDTH_RATIO)),
            height_ratio=float(rng.uniform(*HEIGHT_RATIO)),
            top_ratio=float(rng.uniform(*TOP_RATIO)),
            period_s=scenes.spread(rng, PERIOD_S),
            level_ratio=float(rng.uniform(*LEVEL_RATIO)),
        )
    return scenes.Setting(model, seed, exposure_s)


def _grid_path(film: PlannedFilm, grids: Path | None) -> GridPath:
    """Return the grid's frequency from the film's start on, which is drawn."""
    day = _lit_day(grids)
    latest_s = film.reference_s - film.duration_s - scenes.MARGIN_S
    start_s = float(film.generator("start").uniform(0, latest_s))
    return GridPath(day.freq_hz, day.step_s, start_s, NOMINAL_HZ)


class FilmPiece(NamedTuple):
    """One piece: number, start in the film (s), and rows, counted from its first frame."""

    number: int
    begin_s: float
    blocks: list[RowBlock]


def _pieces_of(blocks: Sequence[RowBlock], length_s: float) -> Iterator[FilmPiece]:
    """Cut a film's blocks into whole pieces, each from the start of a block, up to 8 frames late.

    Rows are those of the whole film: the codec and the steady-pixel mask had its earlier frames.
    """
    origin_ns = int(blocks[0].frame_pts_ns[0])
    begin_s = np.array([(int(b.frame_pts_ns[0]) - origin_ns) / NS_PER_S for b in blocks])
    last_s = (int(blocks[-1].frame_pts_ns[-1]) - origin_ns) / NS_PER_S
    frame_s = last_s / max(sum(block.frames for block in blocks) - 1, 1)
    end_s = last_s + frame_s
    # The last piece may lack a frame.
    for n in range(int((end_s + frame_s) / length_s)):
        first, stop = np.searchsorted(begin_s, [n * length_s, (n + 1) * length_s])
        part = blocks[first:stop]
        moved = [_moved(block, part[0], seq) for seq, block in enumerate(part)]
        yield FilmPiece(n, float(begin_s[first]), moved)


def _moved(block: RowBlock, first: RowBlock, seq: int) -> RowBlock:
    """Return a block with frame numbers and times relative to the first block of its piece."""
    frame, pts_ns, old = int(first.frame_number[0]), int(first.frame_pts_ns[0]), block.header
    header = replace(
        old, seq=seq, frame_first=old.frame_first - frame, frame_last=old.frame_last - frame,
        pts_ns=old.pts_ns - pts_ns,
    )  # fmt: skip
    numbers, times_ns = block.frame_number - frame, block.frame_pts_ns - pts_ns
    return replace(block, header=header, frame_number=numbers, frame_pts_ns=times_ns)


@dataclass(eq=False)
class ClipEnf:
    """A clip's ENF by the default tracker, and under each of the paper's hypotheses, computed once.

    Its parameter is the clip's blocks of rows.
    """

    blocks: Sequence[RowBlock]

    @cached_property
    def estimates(self) -> list[EnfEstimate]:
        """Estimates of the default tracker."""
        return self._tracked(TrackSettings.method)

    @cached_property
    def hypotheses(self) -> Hypotheses | None:
        """Tracks of the paper's hypotheses; None of a clip shorter than a window."""
        return hypotheses_of(self._tracked(Metric.enf_method))

    def _tracked(self, method: str) -> list[EnfEstimate]:
        settings = TrackSettings(method=method, nominal_hz=NOMINAL_HZ)
        return through(make_tracker(settings), self.blocks)


class ClipSearch:
    """The search for a clip in a reference."""

    def __init__(self, clip: ClipEnf, reference: Reference) -> None:
        self._clip = clip
        self._blocks = list(reference_blocks(reference, source="reference"))

    def by(self, method: str) -> list[Said]:
        """Return the result of a matcher, as of the match stage; the metrics share one search."""
        if method not in PAPER_METRICS:
            return through(Match(method=method), [*self._clip.estimates, *self._blocks])
        if self._tally is None:
            return [Finding(decision="no_decision", reason="no window of ENF")]
        return [metric(self._tally, PAPER_METRICS.index(method) + 1)]

    @cached_property
    def _tally(self) -> Tally | None:
        if self._clip.hypotheses is None:
            return None
        return paper_search(self._clip.hypotheses, grid_of(self._blocks), MatchSettings())


def run_trials(film: PlannedFilm, grids: Path | None) -> dict[str, Any]:
    """Film, and run every method on all pieces of each coding; return the record."""
    begin_s, made_by, setting = time.perf_counter(), versions(), _setting_of(film)
    filmed = filmed_of(setting, _grid_path(film, grids), film.duration_s, film.codings)
    truth = filmed.truth
    return {
        "version": VERSION,
        **dataclasses.asdict(film),
        "noise_mhz": 1e3 * scenes.REFERENCE_NOISE_HZ,
        "grid": _lit_day(grids).grid,
        "flicker_level": setting.flicker_levels(NOMINAL_HZ)[0],
        "idle_percent": 100 * truth["idle_ratio"],
        "clock_ppm": truth["clock_ppm"],
        "trials": [
            {"coding": coding, "length_s": length_s} | result
            for coding, blocks in filmed.blocks.items()
            for length_s in LENGTHS_S
            if length_s <= film.duration_s
            for piece in _pieces_of(blocks, length_s)
            for result in _tried(film, piece, length_s, truth, grids)
        ],
        "wall_s": round(time.perf_counter() - begin_s, 2),
        "versions": made_by,
    }


def _tried(
    film: PlannedFilm, piece: FilmPiece, length_s: float, truth: dict[str, Any], grids: Path | None
) -> Iterator[Result]:
    """Yield a result for each reference and method."""
    ppm = truth["clock_ppm"]
    lag_s = truth["reference_start_s"] + piece.begin_s / (1 + ppm * 1e-6)
    end_s, clip = lag_s + length_s / (1 + ppm * 1e-6), ClipEnf(piece.blocks)
    for trial, reference in references_of(film, lag_s, end_s, grids):
        search = ClipSearch(clip, reference)
        describe = partial(_judged, lag_s if trial == PRESENT else math.nan, ppm)
        for method in METHODS:
            found = tried(partial(search.by, method), describe)
            yield {"piece": piece.number, "trial": trial, "method": method} | found


def _judged(true_lag_s: float, clock_ppm: float, out: list[Said]) -> Result:
    """Return a result with its errors; the true lag is NaN if the reference lacks it."""
    (result,) = out
    error_s = result.lag_s - true_lag_s
    right = abs(error_s) <= TRUE_WITHIN_S
    outcome = NONE if result.decision != "match" else TRUE if right else FALSE
    return {
        "outcome": outcome,
        "decision": result.decision,
        "reason": result.reason,
        "nearest": right,
        "lag_error_s": number(error_s, 4),
        "lag_std_s": number(result.lag_std_s, 4),
        "clock_error_ppm": number(result.clock_ppm - clock_ppm, 3),
        "clock_std_ppm": number(result.clock_std_ppm, 3),
        "log10_lr": number(result.log10_lr, 3),
        "log10_lr_absent": number(result.log10_lr_absent, 3),
        "correlation": number(result.correlation, 5),
        "seconds_used": result.seconds_used,
    }

"""Every matcher on every piece of a film and reference: its decision, and its errors."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

from rsenf.bench.judge import number, tried
from rsenf.bench.measure import film as filmed_of
from rsenf.bench.measure import versions
from rsenf.bench.recording_time import NOMINAL_HZ, Film
from rsenf.bench.recording_time.films import (
    NOISE_HZ,
    PRESENT,
    grid_path,
    lit_day,
    references_of,
    setting_of,
)
from rsenf.match import Finding, MatchSettings
from rsenf.match.paper import Metric, metric
from rsenf.match.paper_search import Hypotheses, Tally, hypotheses_of, paper_search
from rsenf.match.series import grid_of
from rsenf.match.stage import Match
from rsenf.messages import EnfEstimate, MatchResult, RowBlock
from rsenf.reference import Reference, reference_blocks
from rsenf.timebase import NS_PER_S
from rsenf.track import TrackSettings, make_tracker

LENGTHS_S = (600.0, 300.0, 120.0, 60.0)


@dataclass(frozen=True, eq=False)
class Piece:
    """One piece: number, start in the film (s), and rows, counted from its first frame."""

    number: int
    begin_s: float
    blocks: list[RowBlock]


def pieces_of(blocks: Sequence[RowBlock], length_s: float) -> Iterator[Piece]:
    """Cut a film's blocks into whole pieces, each from the start of a block, up to 8 frames late.

    Frame numbers, sequence numbers and time stamps start at 0. Rows are those of the whole film:
    the codec and the steady-pixel mask had its earlier frames.

    Parameters
    ----------
    blocks : sequence of RowBlock
    length_s : float
        By the camera's clock; a rest is left out.
    """
    origin_ns = int(blocks[0].frame_pts_ns[0])
    begin_s = np.array([(int(b.frame_pts_ns[0]) - origin_ns) / NS_PER_S for b in blocks])
    last = blocks[-1]
    frame_s = (int(last.frame_pts_ns[-1]) - origin_ns) / NS_PER_S / max(_frames(blocks) - 1, 1)
    end_s = (int(last.frame_pts_ns[-1]) - origin_ns) / NS_PER_S + frame_s
    # The last piece may lack a frame.
    for n in range(int((end_s + frame_s) / length_s)):
        first, stop = np.searchsorted(begin_s, [n * length_s, (n + 1) * length_s])
        part = blocks[first:stop]
        moved = [_moved(block, part[0], seq) for seq, block in enumerate(part)]
        yield Piece(n, float(begin_s[first]), moved)


def _frames(blocks: Sequence[RowBlock]) -> int:
    return sum(block.frames for block in blocks)


def _moved(block: RowBlock, first: RowBlock, seq: int) -> RowBlock:
    """Return a block with frame numbers and times relative to the first block of its piece."""
    frame, pts_ns = int(first.frame_number[0]), int(first.frame_pts_ns[0])
    header = dataclasses.replace(
        block.header,
        seq=seq,
        frame_first=block.header.frame_first - frame,
        frame_last=block.header.frame_last - frame,
        pts_ns=block.header.pts_ns - pts_ns,
    )
    return dataclasses.replace(
        block,
        header=header,
        frame_number=block.frame_number - frame,
        frame_pts_ns=block.frame_pts_ns - pts_ns,
    )


PAPER_METRICS = ("metric1", "metric2", "metric3", "metric4")

# Result of a matcher; of the paper's metrics, the finding alone.
Said = MatchResult | Finding


class ClipEnf:
    """A clip's ENF by the default tracker, and under each of the paper's hypotheses, computed once.

    Parameters
    ----------
    blocks : sequence of RowBlock
    """

    def __init__(self, blocks: Sequence[RowBlock]) -> None:
        self._blocks = blocks

    @cached_property
    def estimates(self) -> list[EnfEstimate]:
        """Estimates of the default tracker."""
        return list(self._tracked(TrackSettings.method))

    @cached_property
    def hypotheses(self) -> Hypotheses | None:
        """Tracks of the paper's hypotheses; None of a clip shorter than a window."""
        return hypotheses_of(self._tracked(Metric.enf_method))

    def _tracked(self, method: str) -> Iterator[EnfEstimate]:
        stage = make_tracker(TrackSettings(method=method, nominal_hz=NOMINAL_HZ))
        for block in self._blocks:
            yield from stage.update(block)
        yield from stage.flush()


class Search:
    """The search for a clip in a reference.

    Parameters
    ----------
    clip : ClipEnf
    reference : Reference
    """

    def __init__(self, clip: ClipEnf, reference: Reference) -> None:
        self._clip = clip
        self._blocks = list(reference_blocks(reference, source="reference"))

    def by(self, method: str) -> list[Said]:
        """Return the result of a matcher, as of the match stage; the metrics share one search."""
        if method in PAPER_METRICS:
            return [self._metric(PAPER_METRICS.index(method) + 1)]
        stage = Match(method=method)
        for estimate in self._clip.estimates:
            stage.update(estimate)
        for block in self._blocks:
            stage.update(block)
        return stage.flush()

    def _metric(self, number: int) -> Finding:
        if self._tally is None:
            return Finding(decision="no_decision", reason="no window of ENF")
        return metric(self._tally, number)

    @cached_property
    def _tally(self) -> Tally | None:
        if self._clip.hypotheses is None:
            return None
        return paper_search(self._clip.hypotheses, grid_of(self._blocks), MatchSettings())


VERSION = 2
TRUE_WITHIN_S = 1.0
# Outcomes of a trial.
TRUE, FALSE, NONE = ("true", "false", "none")
METHODS = (*PAPER_METRICS, "ncc", "phase")

Result = dict[str, Any]


def run_trials(film: Film, grids: Path | None) -> dict[str, Any]:
    """Film, and run every method on all pieces of each coding; return the record, of plain values.

    Parameters
    ----------
    film : Film
    grids : Path or None
        Folder of measured grids.
    """
    begin_s, made_by, setting = time.perf_counter(), versions(), setting_of(film)
    filmed = filmed_of(setting, grid_path(film, grids), film.duration_s, film.codings)
    truth = filmed.truth
    return {
        "version": VERSION,
        "key": film.key,
        **dataclasses.asdict(film),
        "noise_mhz": 1e3 * NOISE_HZ,
        "grid": lit_day(grids).grid,
        "flicker_level": setting.flicker_levels(NOMINAL_HZ)[0],
        "idle_percent": 100 * truth["idle_ratio"],
        "clock_ppm": truth["clock_ppm"],
        "trials": [
            {"coding": coding, "length_s": length_s} | result
            for coding, blocks in filmed.blocks.items()
            for length_s in LENGTHS_S
            if length_s <= film.duration_s
            for piece in pieces_of(blocks, length_s)
            for result in _tried(film, piece, length_s, truth, grids)
        ],
        "wall_s": round(time.perf_counter() - begin_s, 2),
        "versions": made_by,
    }


def _tried(
    film: Film, piece: Piece, length_s: float, truth: dict[str, Any], grids: Path | None
) -> Iterator[Result]:
    """Yield a result for each reference and method."""
    ppm = truth["clock_ppm"]
    lag_s = truth["reference_start_s"] + piece.begin_s / (1 + ppm * 1e-6)
    end_s, clip = lag_s + length_s / (1 + ppm * 1e-6), ClipEnf(piece.blocks)
    for trial, reference in references_of(film, lag_s, end_s, grids):
        search = Search(clip, reference)
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

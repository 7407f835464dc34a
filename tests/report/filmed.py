"""Rows filmed in the light of a made-up grid, and what comes of analysing them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rsenf.match import Match
from rsenf.messages import EnfEstimate, Header, MatchResult, ReferenceBlock
from rsenf.report.picture import ThinRows
from rsenf.rows.stage import blocks_from_luminance
from rsenf.track import TrackSettings, make_tracker

RATE_HZ = 30.0


def grid_hz(seconds: int) -> np.ndarray:
    rng = np.random.default_rng(4)
    return 50.0 + 0.1 * np.convolve(rng.normal(0, 1, seconds + 39), np.ones(40) / 40, "valid")


def reference(freq_hz: np.ndarray, t0_ns: int) -> list[ReferenceBlock]:
    count = freq_hz.size
    return [ReferenceBlock(
        header=Header(source="reference/test"), grid="test", nominal_hz=50.0, t0_ns=t0_ns,
        step_ns=10**9, first=0, samples=count, total=count, freq_hz=freq_hz,
        readings=np.isfinite(freq_hz).astype(np.uint32),
    )]  # fmt: skip


def analysed(
    level: np.ndarray, blocks: Sequence[ReferenceBlock]
) -> tuple[ThinRows, list[EnfEstimate], MatchResult]:
    rows, match = ThinRows(), Match(method="ncc")
    tracker = make_tracker(TrackSettings(nominal_hz=50.0))
    for reference_block in blocks:
        match.update(reference_block)
    estimates = []
    time_s = np.arange(len(level)) / RATE_HZ
    for block in blocks_from_luminance(level, time_s, Header(source="test/cam1")):
        rows.add(block)
        estimates += tracker.update(block)
    estimates += tracker.flush()
    for estimate in estimates:
        match.update(estimate)
    (result,) = match.flush()
    return rows, estimates, result


def lit(freq_hz: np.ndarray, begin: int, seconds: int, rows: int = 32) -> np.ndarray:
    """Rows filmed in the light of a grid, from one of its seconds on."""
    phase = 4 * np.pi * np.concatenate([[0.0], np.cumsum(freq_hz)])
    frame_s = begin + np.arange(int(seconds * RATE_HZ)) / RATE_HZ
    at_s = frame_s[:, None] + np.arange(rows) * 0.6 / RATE_HZ / rows
    wave = np.cos(np.interp(at_s, np.arange(phase.size), phase))
    return (100.0 + 5.0 * wave)[:, :, None].astype(np.float32)

"""Time of recording without a known frame rate: each rate that fits the light is tried.

A rate is known only as well as the grid is near its nominal frequency, so the prior of the clock's
error is that wide. All rates tried count in the probability of a fit by chance.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from rsenf.match.settings import MatchSettings
from rsenf.messages import Edit, EnfEstimate, MatchResult, RateBasis, RateHypothesis, RowBlock
from rsenf.run.inline import Analysis
from rsenf.run.inputs import Input

MOST_BYTES = 300_000_000  # rows kept in memory: of a longer recording the beginning is compared
SLOWEST_HZ = 12.0  # lowest frame rate at which a grid can be tracked
LIKELIEST = 3  # rates that fit best: at these, edits of the recording are looked for as well
RATE_SCALE_PPM = 400.0  # prior scale: grids are 20 mHz from 50 Hz, mostly


class UntimedRows:
    """Keeps the rows of a recording until an estimate is usable: then its rate is known.

    Attributes
    ----------
    blocks : list of RowBlock
        Of the first epoch, from its beginning.
    rates : tuple of RateHypothesis
        Frame rates that fit the light.
    """

    def __init__(self) -> None:
        self.blocks: list[RowBlock] = []
        self.rates: tuple[RateHypothesis, ...] = ()
        self._bytes, self._is_known = 0, False

    def listen(self, message: Any) -> None:
        """Receive a message between the stages."""
        if self._is_known:
            return
        if isinstance(message, RowBlock) and self._bytes < MOST_BYTES:
            if not self.blocks or message.header.epoch == self.blocks[0].header.epoch:
                self.blocks.append(message)
                self._bytes += message.level.nbytes
        elif isinstance(message, EnfEstimate):
            self.rates = message.rate_hypotheses or self.rates
            if message.usable:
                self._is_known, self.rates = True, ()
                self.blocks.clear()


class Retimed(Input):
    """Rows with frame times recomputed for another rate."""

    name = "rows"

    def __init__(self, blocks: list[RowBlock], rate_hz: float) -> None:
        self._blocks, self._rate_hz = blocks, rate_hz

    def messages(self) -> Iterator[RowBlock]:
        """Yield the rows with their new times."""
        for block in self._blocks:
            pts_ns = np.rint(block.frame_number * (1e9 / self._rate_hz)).astype(np.int64)
            header = dataclasses.replace(
                block.header,
                pts_ns=int(pts_ns[0]) if pts_ns.size else 0,
                rate_basis=RateBasis.GIVEN,
            )
            yield dataclasses.replace(block, header=header, frame_pts_ns=pts_ns)


class AtRate(NamedTuple):
    """Result at the rate that matches, if one does, and a remark."""

    analysis: Analysis | None
    rows: Retimed | None
    said: str


def find_rate(
    rows: UntimedRows,
    nominal_hz: float | None,
    settings: MatchSettings,
    compare: Callable[..., Analysis],
) -> AtRate:
    """Compare a recording with the reference at each frame rate that fits its light.

    The common rates together have half of the prior odds, all others the other half. First all are
    compared as if the recording were whole, then the likeliest of them in full.

    Parameters
    ----------
    rows : UntimedRows
    nominal_hz : float, optional
        Nominal grid frequency.
    settings : MatchSettings
    compare : callable
        From an input, settings, ``alternatives`` and ``edits`` of
        :class:`rsenf.match.stage.Match`, and a tap for messages, to the analysis.
    """
    rates = [
        h
        for h in rows.rates
        if nominal_hz in (None, h.nominal_hz) and h.frame_rate_hz >= SLOWEST_HZ
    ]
    common = sum(h.is_common for h in rates)
    freely = dataclasses.replace(settings, clock_scale_ppm=RATE_SCALE_PPM)

    def at_rate(rate: RateHypothesis, *, edits: bool) -> tuple[RateHypothesis, Retimed, Analysis]:
        alternatives = 2 * (common if rate.is_common else len(rates) - common)
        retimed = Retimed(rows.blocks, rate.frame_rate_hz)
        return (
            rate, retimed, compare(retimed, freely, alternatives, edits, lambda *message: None),
        )  # fmt: skip

    found = [at_rate(rate, edits=False) for rate in rates]
    searched = sum(analysis.result.search_size for *_, analysis in found)
    found.sort(key=lambda one: -_fit(one[2].result))
    likely = [one for n, one in enumerate(found) if n < LIKELIEST or _is_match(one)]
    matches = list(filter(_is_match, [at_rate(rate, edits=True) for rate, *_ in likely]))
    is_assumed = rows.blocks[0].header.rate_basis == RateBasis.ASSUMED
    tried = (
        f"the frame rate {'is not known' if is_assumed else 'seems wrong'}: {len(rates)} rates "
        "that the light goes with were compared"
    )
    if not matches:
        return AtRate(None, None, f"{tried}, and none fits surely")
    matches.sort(key=lambda one: -one[2].result.log10_lr_absent)
    (rate, retimed, best), *others = matches
    result = best.result
    against_other = result.log10_lr
    for *_, other in others:
        away_s = abs(result.lag_s - other.result.lag_s)
        if result.grid != other.result.grid or not away_s <= settings.tolerance_s:
            apart = result.log10_lr_absent - other.result.log10_lr_absent
            against_other = min(against_other, apart)
    if against_other < settings.min_log10_lr:
        return AtRate(None, None, f"{tried}, and times fit at more than one")
    rate_hz = rate.frame_rate_hz * (1.0 + 1e-6 * result.clock_ppm)
    # The estimated error of the clock is that of the rate.
    best.results = [
        dataclasses.replace(
            result,
            log10_lr=against_other,
            search_size=searched,
            clock_ppm=math.nan,
            clock_std_ppm=math.nan,
            edits=() if is_assumed else (_speed(rows.blocks, rate_hz, result.clock_std_ppm),),
        )
    ]
    return AtRate(best, retimed, f"{tried}, and {rate_hz:.3f} frames/s fits")


def _speed(blocks: list[RowBlock], rate_hz: float, rate_std_ppm: float) -> Edit:
    """Describe the playback speed, from the stated frame times and the rate that fits."""
    frame = np.concatenate([block.frame_number for block in blocks])
    time_s = 1e-9 * np.concatenate([block.frame_pts_ns for block in blocks])
    stated_hz = float(frame[-1] - frame[0]) / float(time_s[-1] - time_s[0])
    ratio = stated_hz / rate_hz
    side = "faster" if ratio > 1.0 else "slower"
    percent = f"{100.0 * abs(ratio - 1.0):.3f} % (± {max(1e-4 * rate_std_ppm, 0.001):.3f} %)"
    return Edit(
        kind="speed",
        speed_ratio=ratio,
        speed_ratio_std=1e-6 * rate_std_ppm,
        text=f"played {percent} {side} than it was filmed, or wrong frame times: "
        f"{stated_hz:.3f} frames/s are stated, {rate_hz:.3f} fit",
    )


def _fit(result: MatchResult) -> float:
    """Evidence that the best time is right; least where none could be compared."""
    return -math.inf if math.isnan(result.log10_lr_absent) else result.log10_lr_absent


def _is_match(one: tuple[RateHypothesis, Retimed, Analysis]) -> bool:
    return one[2].result.decision == "match"

"""The workflow beside a reference of the grid's frequency: finds the camera's clock error.

The steps are those for rows: fit the lag to training blocks, judge on held-out blocks, add what
they support, and test whether the remaining gap is consistent with noise.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import gammaincinv, ndtr

from rsenf.discrepancy.clock_offset.aligned_reference import AlignedReference
from rsenf.discrepancy.clock_offset.fit import LagFit, by_all_values, clock_ppm, columns_of, settled
from rsenf.discrepancy.clock_offset.hypotheses import LEAPT, SKEWED, Hypothesis, kinds, weighed
from rsenf.discrepancy.clock_offset.noise import Chance, chance_of, tracked_noise
from rsenf.discrepancy.clock_offset.start import no_match, read_aright
from rsenf.discrepancy.gap import Gap
from rsenf.discrepancy.noise_floor import BEYOND_STDS, NoiseFloor
from rsenf.messages.schema import FloatArray
from rsenf.model import CaptureModel


@dataclass(frozen=True, eq=False)
class ClockOffsetDiscovery:
    """Result of the workflow.

    Attributes
    ----------
    beside : AlignedReference
    first, last : LagFit
        Before anything was added, and after.
    skew : Hypothesis or None
        The clock error, if it is supported.
    rest : list of Hypothesis
        Supported hypotheses on the residual, the likeliest first.
    chance : Chance
        Data that the last model explains.
    tried : int
        Number of hypotheses tested.
    """

    beside: AlignedReference
    first: LagFit
    last: LagFit
    skew: Hypothesis | None
    rest: list[Hypothesis]
    chance: Chance
    tried: int

    def gap(self, fit: LagFit) -> Gap:
        """Return the held-out residual's power beyond chance, over the reference's variance."""
        held = self.beside.held_out & np.isfinite(fit.residual_hz)
        over = (fit.residual_hz[held] ** 2 - self.chance.var_hz2) / self.beside.power_hz2
        block = self.beside.block[held]
        means = np.array([over[block == number].mean() for number in np.unique(block)])
        return Gap(float(over.mean()), float(means.std(ddof=1) / math.sqrt(means.size)), math.nan)

    @cached_property
    def floor(self) -> NoiseFloor:
        """Gaps of data that the last model explains, after fitting lag and clock error to each."""
        known = np.isfinite(self.last.residual_hz)
        training, held = self.beside.training & known, self.beside.held_out & known
        columns = columns_of(self.beside, self.last.said_hz, skewed=self.skew is not None)
        solve = np.linalg.pinv(columns[training])
        sets = self.chance.sets_hz
        residual = sets[:, held] - (sets[:, training] @ solve.T) @ columns[held].T
        squares = (residual**2).mean(axis=1)
        over = squares - self.chance.estimated_hz2
        # A mean of few squares is skewed: approximated by a gamma distribution.
        mean, var = float(squares.mean()), float(over.var(ddof=1))
        most = var / mean * float(gammaincinv(mean**2 / var, ndtr(BEYOND_STDS)))
        median, power = float(np.median(over)), self.beside.power_hz2
        limit = (median + most - mean) / power
        return NoiseFloor(median / power, limit, limit)

    @cached_property
    def final(self) -> tuple[CaptureModel, float, FloatArray]:
        """Model, lag (s), and the standard errors of lag and clock error, from all values."""
        return by_all_values(self.beside, self.last, self.chance, skewed=self.skew is not None)

    @property
    def clock(self) -> tuple[float, float]:
        """Clock error of the model (ppm), and its standard error if it was fitted."""
        model, _, stderr = self.final
        return clock_ppm(model), float(stderr[-1])

    @property
    def verdict(self) -> str:
        """``no_discrepancy``, ``explained`` or ``unexplained``."""
        if self.gap(self.last).value > self.floor.limit or self.rest:
            return "unexplained"
        return "explained" if self.skew else "no_discrepancy"

    @property
    def shrinkage(self) -> float:
        """Share of the gap above the floor that was closed; NaN if there was none."""
        above = self.gap(self.first).value - self.floor.median
        if above <= self.floor.limit - self.floor.median:
            return math.nan
        return 1.0 - (self.gap(self.last).value - self.floor.median) / above


def discover_beside(
    model: CaptureModel,
    beside: AlignedReference,
    progress: Callable[[str], None] = lambda doing: None,
) -> ClockOffsetDiscovery:
    """Find what a model lacks of a clip, given a reference.

    Parameters
    ----------
    model : CaptureModel
        Initial model.
    beside : AlignedReference
    progress : callable, optional
        Called with a text on what is being done.

    Raises
    ------
    InputError
        When the simulated model can't be tracked, the reference covers too little of the clip, or
        the clip turns out not to be in it.
    """
    progress("filming the reference")
    said_hz = beside.said(model, beside.lag_s)
    beside = read_aright(beside, said_hz)
    found = _discovered(
        beside, settled(beside, model, beside.lag_s, said_hz, skewed=False), progress
    )
    if not beside.certain and found.verdict == "unexplained":
        # A wrong lag with a similar course must not be reported as a clock error.
        raise no_match(beside.grid, "what seems to fit leaves more than noise")
    return found


def _discovered(
    beside: AlignedReference, first: LagFit, progress: Callable[[str], None]
) -> ClockOffsetDiscovery:
    noise = tracked_noise(beside, first.model, first.lag_s, first.said_hz)
    chance = chance_of(beside, noise, first.residual_hz)
    progress("weighing the clock")
    last = settled(beside, first.model, first.lag_s, first.said_hz, skewed=True)
    ways, tried = _others(beside, first, chance)
    clock = next(way for way in kinds(beside, last.said_hz) if way.name == SKEWED)
    # Estimate noise from the better fit: a wrong lag would increase it.
    after = chance_of(beside, noise, last.residual_hz)
    skew = weighed(beside, clock, last.said_hz, first.residual_hz, after, tried, last.residual_hz)
    # A step of the lag resembles a clock error, but fits the halves of the clip differently.
    leapt = max((way.nats for way in ways if way.kind.name == LEAPT), default=0.0)
    if not skew.supported or leapt > skew.nats:
        return ClockOffsetDiscovery(beside, first, first, None, _supported(ways), chance, tried)
    progress("added clock_skew, looking at what is left")
    rest, _ = _others(beside, last, after)
    return ClockOffsetDiscovery(beside, first, last, skew, _supported(rest), after, tried)


def _others(beside: AlignedReference, fit: LagFit, chance: Chance) -> tuple[list[Hypothesis], int]:
    """Test all hypotheses but the clock error; also return their number including it."""
    ways = list(kinds(beside, fit.said_hz))
    return [
        weighed(beside, way, fit.said_hz, fit.residual_hz, chance, len(ways))
        for way in ways
        if way.name != SKEWED
    ], len(ways)


def _supported(ways: list[Hypothesis]) -> list[Hypothesis]:
    """The supported hypotheses, the likeliest of each kind."""
    best: dict[str, Hypothesis] = {}
    for way in sorted(ways, key=lambda w: -w.nats):
        if way.supported:
            best.setdefault(way.kind.name, way)
    return list(best.values())

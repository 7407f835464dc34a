"""The workflow beside a reference of the grid's frequency: finds the camera's clock error.

The steps are those for rows: fit the lag to training blocks, judge on held-out blocks, add what
they support, and test whether the remaining gap is consistent with noise. The result is presented
as plain values and as a model, and joined with that on rows.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.special import gammaincinv, ndtr

from rsenf.discrepancy.clock_offset.clip import AlignedReference
from rsenf.discrepancy.clock_offset.fit import (
    LEAPT,
    SKEWED,
    ClockTrial,
    LagFit,
    by_all_values,
    clock_ppm,
    columns_of,
    kinds,
    settled,
    weighed,
)
from rsenf.discrepancy.clock_offset.noise import Chance, chance_of, tracked_noise
from rsenf.discrepancy.clock_offset.start import no_match, read_aright
from rsenf.discrepancy.fit import BEYOND_STDS, NoiseFloor
from rsenf.discrepancy.gap import Gap
from rsenf.discrepancy.residual_breakdown import ResidualShare
from rsenf.discrepancy.residual_classifier import TELLS, ResidualClass, hint_json
from rsenf.messages.schema import FloatArray
from rsenf.model import CATALOGUE, CaptureModel

# A crystal's error is smaller; beyond, the assumed frame rate is more likely wrong.
CRYSTAL_PPM = 200.0
SURE = 3.0  # standard errors from which on a share is reported
BANDS_HZ = (0.0, 0.005, 0.01, 0.02, 0.05, 0.1, 0.5)
OTHER = "other_course"  # class of a residual that no hypothesis explains


@dataclass(frozen=True, eq=False)
class ClockOffsetDiscovery:
    """Result of the workflow."""

    beside: AlignedReference
    first: LagFit  # before anything was added, and after
    last: LagFit
    skew: ClockTrial | None  # the clock error, if it is supported
    rest: list[ClockTrial]  # supported hypotheses on the residual, the likeliest first
    chance: Chance  # data that the last model explains
    tried: int  # number of hypotheses tested

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
    first = settled(beside, model, beside.lag_s, said_hz, skewed=False)
    found = _discovered(beside, first, progress)
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


def _others(beside: AlignedReference, fit: LagFit, chance: Chance) -> tuple[list[ClockTrial], int]:
    """Test all hypotheses but the clock error; also return their number including it."""
    ways = list(kinds(beside, fit.said_hz))
    return [
        weighed(beside, way, fit.said_hz, fit.residual_hz, chance, len(ways))
        for way in ways
        if way.name != SKEWED
    ], len(ways)


def _supported(ways: list[ClockTrial]) -> list[ClockTrial]:
    """The supported hypotheses, the likeliest of each kind."""
    best: dict[str, ClockTrial] = {}
    for way in sorted(ways, key=lambda w: -w.nats):
        if way.supported:
            best.setdefault(way.kind.name, way)
    return list(best.values())


def beside_json(found: ClockOffsetDiscovery, model_out: str) -> dict[str, Any]:
    """Return a comparison as plain values with stable keys.

    Parameters
    ----------
    found : ClockOffsetDiscovery
    model_out : str
        Path of the extended model file.
    """
    before, after, floor = found.gap(found.first), found.gap(found.last), found.floor
    return {
        "version": 1,
        "verdict": found.verdict,
        "effects": [_skew_json(found)] if found.skew else [],
        "gap": {
            "before": before.value,
            "before_stderr": before.stderr,
            "after": after.value,
            "stderr": after.stderr,
            "floor": floor.median,
            "limit": floor.limit,
            "codec": 0.0,  # a codec doesn't change the times of the flicker
            "shrinkage": None if math.isnan(found.shrinkage) else found.shrinkage,
        },
        "where_before": [dataclasses.asdict(share) for share in where_beside(found, found.first)],
        "reference": reference_json(found),
        "unexplained": _unexplained(found),
        "model_out": model_out,
    }


def reference_json(found: ClockOffsetDiscovery) -> dict[str, Any]:
    """Return how clip and reference were aligned, as plain values."""
    beside, (_, lag_s, stderr) = found.beside, found.final
    seconds = beside.averaged_s
    return {
        "name": beside.grid.name,
        "lag_s": beside.begins_s + lag_s,
        "lag_stderr_s": float(stderr[0]),
        "read_as": f"an average over {seconds:.0f} s" if seconds else "the grid's frequency",
        "std_hz": math.sqrt(beside.power_hz2),
        "estimate_noise_hz": found.chance.estimate_std_hz,
        "reference_noise_hz": found.chance.reference_std_hz,
        "block_s": beside.block_s,
    }


def joined(rows: dict[str, Any], beside: dict[str, Any]) -> dict[str, Any]:
    """Join the JSON results of rows and reference on a recording; the gap is that of the rows."""
    verdicts = {rows["verdict"], beside["verdict"]}
    worst = ("unexplained", "explained", "no_discrepancy")
    kept = {name: beside[name] for name in ("verdict", "gap", "where_before", "unexplained")}
    return rows | {
        "verdict": next(verdict for verdict in worst if verdict in verdicts),
        "effects": [*rows["effects"], *beside["effects"]],
        "reference": beside["reference"] | kept,
        "unexplained": rows["unexplained"] or beside["unexplained"],
    }


def beside_model(found: ClockOffsetDiscovery, made_from: str) -> CaptureModel:
    """Return the extended model, with its provenance and the standard error of its clock.

    Parameters
    ----------
    found : ClockOffsetDiscovery
    made_from : str
        Name of the recording, for the provenance.
    """
    model, _, stderr = found.final
    known = dict(model.provenance)
    known.setdefault("made_by", "rsenf discover")
    known["from"] = made_from
    if found.skew:
        errors = {f"{SKEWED}.clock_ppm": float(stderr[1])}
        known["stderr"] = known.get("stderr", {}) | errors
    known["reference"] = reference_json(found) | {
        "verdict": found.verdict,
        "gap": {"before": found.gap(found.first).value, "after": found.gap(found.last).value},
    }
    return dataclasses.replace(model, provenance=known)


def _skew_json(found: ClockOffsetDiscovery) -> dict[str, Any]:
    skew, (model, _, stderr) = found.skew, found.final
    assert skew is not None
    ppm = clock_ppm(model)
    crystal = abs(ppm) < CRYSTAL_PPM
    decides = "which of the two clocks is off, " + CATALOGUE[SKEWED].told_apart_by
    if not crystal:
        decides = "the rate at which the frames were taken: 29.97 for 30 per second is 1000 ppm"
    return {
        "name": SKEWED if crystal else None,
        "class": [] if crystal else [SKEWED, "frame rate"],
        "parameters": {"clock_ppm": ppm},
        "stderr": {"clock_ppm": float(stderr[1])},
        "told_apart_by": decides,
        "gap_before": found.gap(found.first).value,
        "gap_after": found.gap(found.last).value,
        "gain": skew.gain_hz2 / found.beside.power_hz2,
        "evidence": skew.nats,
        "tried": found.tried,
    }


def _unexplained(found: ClockOffsetDiscovery) -> dict[str, Any] | None:
    if found.verdict != "unexplained":
        return None
    places = [place for place in where_beside(found, found.last) if place.sure > SURE]
    kinds = [way.kind.name for way in found.rest] or [OTHER]
    leaps = tuple(w.kind.at_s for w in found.rest if not math.isnan(w.kind.at_s))
    would_tell = dict.fromkeys(text for kind in kinds for text in TELLS[kind])
    return {
        "gap": found.gap(found.last).value,
        "std_hz": math.sqrt(max(found.gap(found.last).value, 0.0) * found.beside.power_hz2),
        "places": [dataclasses.asdict(place) for place in places],
        **hint_json(ResidualClass(kinds[0], tuple(kinds[1:]), tuple(would_tell), at_s=leaps)),
    }


def where_beside(found: ClockOffsetDiscovery, fit: LagFit) -> list[ResidualShare]:
    """Split a fit's residual by time and by frequency of the wander."""
    return [*_by_time(found, fit), *_by_frequency(found, fit)]


def _by_time(found: ClockOffsetDiscovery, fit: LagFit) -> list[ResidualShare]:
    """Share of each held-out block in their residual beyond chance."""
    beside, chance = found.beside, found.chance
    held = beside.held_out & np.isfinite(fit.residual_hz)
    total = float((fit.residual_hz[held] ** 2 - chance.var_hz2).sum())
    out = []
    for number in np.unique(beside.block[held]):
        here = held & (beside.block == number)
        over = float((fit.residual_hz[here] ** 2 - chance.var_hz2).sum())
        spread = float((chance.sets_hz[:, here] ** 2).sum(axis=1).std(ddof=1))
        first_s = float(number) * beside.block_s
        out.append(_share("time_s", first_s, first_s + beside.block_s, over, total, spread))
    return out


def _by_frequency(found: ClockOffsetDiscovery, fit: LagFit) -> list[ResidualShare]:
    """Share of each frequency band of the wander, over all values."""
    known = np.isfinite(fit.residual_hz)
    every = np.vstack([fit.residual_hz[known], found.chance.sets_hz[:, known]])
    power = np.abs(np.fft.rfft(every, axis=1)) ** 2
    hz = np.fft.rfftfreq(int(known.sum()), found.beside.track.hop_s)
    over = power[0] - power[1:].mean(axis=0)
    out = []
    for low, high in pairwise(BANDS_HZ):
        band = (hz >= low) & (hz < high)
        spread = float(power[1:, band].sum(axis=1).std(ddof=1))
        part, total = float(over[band].sum()), float(over.sum())
        out.append(_share("wander_hz", low, high, part, total, spread))
    return out


def _share(
    axis: str, low: float, high: float, over: float, total: float, spread: float
) -> ResidualShare:
    return ResidualShare(axis, low, high, over / (total or 1e-30), over / max(spread, 1e-30))

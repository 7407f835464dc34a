"""The complete workflow on one recording, and the check of its time stamps.

Time stamps are data as rows are, but without noise: a model must agree with them up to the unit
they are stored in. If it doesn't, either frames are late or only their stamps are wrong. The phase
of the flicker decides: only late frames change it.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from rsenf.discrepancy.candidates import CodecBaseline, ScoredEffect, baseline_of, candidates
from rsenf.discrepancy.fit import Fit, NoiseFloor, fit, floor_of
from rsenf.discrepancy.fit_parameters import any_course, series_of
from rsenf.discrepancy.forward_model import ForwardModel, plan
from rsenf.discrepancy.forward_selection import Step, needed, search
from rsenf.discrepancy.grammar import term_of
from rsenf.discrepancy.grammar_search import LEAST_TURNS, ShortestStep, events_of, scored, terms
from rsenf.discrepancy.measured import Float32Array, Measured
from rsenf.discrepancy.residual_breakdown import ResidualShare, where
from rsenf.discrepancy.series import WHITE_STDS
from rsenf.discrepancy.start import first_fit
from rsenf.errors import UsageError
from rsenf.messages.schema import FloatArray
from rsenf.model import CATALOGUE, CaptureModel, Effect
from rsenf.model.effects.search import NOTHING_FITS

Progress = Callable[[str, float], None]
# Time bases: Matroska's milliseconds, MPEG's 90 kHz, µs; else ns.
UNITS_S = (1e-3, 1.0 / 90_000.0, 1e-6)
ROUNDING_S = 2e-9
# Relative change of the held-out misfit that tells late frames from wrong stamps.
TELLS = 0.01
FREE = ("profile", "stripes", "gain_ratios")  # parameters with which an effect fits many a pattern
RATES = ("tone_hz", "flicker_hz", "rate_hz")  # parameters at which effects come again


@dataclass(frozen=True, eq=False)
class TimestampCheck:
    """An effect that the time stamps reveal."""

    effect: Effect
    rivals: tuple[str, ...]  # names of all effects that would do as well, including this one
    fit: Fit  # of the model with the effect
    gap: float  # power of the flicker error due to the stamps' deviation, over the flicker's power
    rms_s: float  # deviation of the stamps from the model without the effect


def off_s(forward: ForwardModel, data: Measured) -> FloatArray:
    """Deviation of the time stamps from a model, (frames,), positive if late.

    Zero if no deviation exceeds the unit of the stamps.
    """
    expected = plan(forward.model, data).stamp_s()[: data.slot[-1] + 1]
    expected = expected[data.slot] - expected[data.slot[0]]
    late_s = data.stamp_s - expected
    return late_s if np.abs(late_s).max() > _unit_s(data.stamp_s) else np.zeros_like(late_s)


def gap_of_stamps(late_s: FloatArray, nominal_hz: float) -> float:
    """Power of the flicker error due to wrong frame times (frames,), over the flicker's power.

    >>> round(gap_of_stamps(np.array([0.0, 1e-3]), 50.0), 3)
    0.098
    """
    turned_rad = 4.0 * math.pi * nominal_hz * (late_s - late_s.mean())
    return float(np.mean(np.abs(np.exp(1j * turned_rad) - 1.0) ** 2))


def stamps_of(first: Fit) -> TimestampCheck | None:
    """Explain time stamps that deviate from the model; None if they don't, or nothing explains it.

    Parameters
    ----------
    first : Fit
        Of the model without an effect on time stamps.
    """
    data = first.data
    late_s = off_s(first.forward, data)
    if not late_s.any():
        return None
    gap, rms_s = gap_of_stamps(late_s, data.nominal_hz), float(late_s.std())
    every_s = np.interp(np.arange(data.slot[-1] + 1), data.slot, late_s)
    late = _late_frames(first.forward, every_s, data)
    # Late frames change the phase of the light; wrong stamps don't.
    better = 1.0 - late.misfit / first.misfit
    if _white(late_s) and better < TELLS:
        error_s = tuple(every_s.tolist())
        error = CATALOGUE["timestamp_jitter"](error_s=error_s, jitter_s=rms_s)  # type: ignore[call-arg]
        same = first.forward.with_model(first.forward.model.plus(error))
        kept = Fit(
            data, first.begun, same, first.rows, first.residual, first.jacobian, first.stderr
        )
        rivals = (error.name,) if better < -TELLS else (error.name, "variable_frame_rate")
        return TimestampCheck(error, rivals, kept, gap, rms_s)
    if better < -TELLS:
        return None  # wandering stamps of regular frames: no effect of the catalogue does that
    varies = next(e for e in late.forward.model.effects if e.name == "variable_frame_rate")
    return TimestampCheck(varies, (varies.name,), late, gap, rms_s)


def _late_frames(forward: ForwardModel, late_s: FloatArray, data: Measured) -> Fit:
    """Fit a model whose frames begin as late as their stamps say."""
    step_s = 1.0 / float(data.frame_rate)
    ratio = float(np.diff(late_s).std() / step_s)
    each_s = tuple(late_s.tolist())
    effect = CATALOGUE["variable_frame_rate"](rate_ratio=min(ratio, 0.2), late_s=each_s)  # type: ignore[call-arg]
    course = forward.course
    at_nodes = np.interp(course.node_s, step_s * np.arange(late_s.size), late_s)
    turned_rad = 4.0 * math.pi * data.nominal_hz * at_nodes
    course = course.through(course.psi_rad - turned_rad)
    return fit(dataclasses.replace(forward, model=forward.model.plus(effect), course=course), data)


def _white(late_s: FloatArray) -> bool:
    values = late_s - late_s.mean()
    stays = float(values[1:] @ values[:-1]) / float(values @ values)
    return abs(stays) < WHITE_STDS / math.sqrt(values.size)


def _unit_s(stamp_s: FloatArray) -> float:
    """Unit of the time stamps, as far as they show it."""
    for unit in UNITS_S:
        if np.abs(stamp_s - unit * np.rint(stamp_s / unit)).max() < ROUNDING_S:
            return unit
    return ROUNDING_S


@dataclass(frozen=True, eq=False)
class Discovery:
    """Result of the workflow."""

    first: Fit  # before any effect was added, and after the last one
    last: Fit
    steps: tuple[Step, ...]  # rounds that added an effect
    stamps: TimestampCheck | None  # effect that the time stamps revealed
    floor: NoiseFloor  # of data simulated from the last fit, with the codec's share
    baseline: CodecBaseline  # zero if there is no codec, or it is unknown
    before: list[ResidualShare]  # where first and last model disagree with the data
    after: list[ResidualShare]
    refused: Step | None = None  # the last round, if it tried effects and added none

    @property
    def gap_before(self) -> float:
        """Gap of the initial model, of rows and time stamps."""
        return self.first.gap.value + stamps_gap(self.first)

    @property
    def gap_after(self) -> float:
        """Gap of the final model, of rows and time stamps."""
        return self.last.gap.value + stamps_gap(self.last)

    @property
    def verdict(self) -> str:
        """``no_discrepancy``, ``explained`` or ``unexplained``."""
        if self.last.gap.most > self.floor.most or stamps_gap(self.last) > self.floor.limit:
            return "unexplained"
        return "explained" if self.steps or self.stamps else "no_discrepancy"

    @property
    def shrinkage(self) -> float:
        """Share of the gap above the floor that was closed; NaN if there was none."""
        above = self.gap_before - self.floor.median
        if abs(above) <= self.floor.limit - self.floor.median:
            return float("nan")
        return 1.0 - (self.gap_after - self.floor.median) / above


def stamps_gap(fit: Fit) -> float:
    """Power of the flicker error due to deviating time stamps, over the flicker's power."""
    return gap_of_stamps(off_s(fit.forward, fit.data), fit.data.nominal_hz)


def discover(
    model: CaptureModel,
    data: Measured,
    progress: Progress = lambda doing, share: None,
    recoded: Callable[[Float32Array], Float32Array] | None = None,
    *,
    beyond_catalogue: bool = False,
) -> Discovery:
    """Find the effects that a model lacks of a recording, and add them.

    Parameters
    ----------
    model : CaptureModel
        Initial model.
    data : Measured
    progress : callable, optional
        Called with what is being done, empty if it goes on, and the share of it that is done.
    recoded : callable, optional
        Encodes and decodes rows (frames, rows, strips) as the recording was.
    beyond_catalogue : bool, optional
        Whether to search the grammar of effects where the catalogue leaves a rest.

    Raises
    ------
    InputError
        When the recording has no flicker to fit a model to.
    """
    progress("fitting the model", 0.0)
    first = first_fit(model, data)
    disagreed = where(first)
    stamps = stamps_of(first)
    begun = stamps.fit if stamps else first
    first = first.released(rows=True)  # a search goes on from a fit with all its arrays
    if recoded:
        progress("coding the fitted model as the recording was", 0.0)
    baseline = baseline_of(begun, recoded)
    progress("looking for what is missing", 0.0)
    searched = _searched(begun, (), baseline, progress, recoded)
    found = Discovery(first=first, stamps=stamps, before=disagreed, **searched)
    return _by_terms(found, progress, recoded) if beyond_catalogue and is_doubtful(found) else found


def is_doubtful(found: Discovery) -> bool:
    """Whether a term may explain what is left, or be what the catalogue's effects stand for.

    A free course over a period or rows, or stripes, may stand for a term that is shorter to
    describe or explains more: mist that drifts over the picture once passes for half a period of
    stripes, and the dips of a missing mains cycle for those of a gain. Of two effects that take on
    nearly any course one may stand for the other's overtones. A series that another effect equals
    may stand for a tone.
    """
    nothing_fits = found.last.gap.most >= NOTHING_FITS
    chosen = ((step, step.chosen.effect) for step in found.steps if step.chosen)
    flexible = [(step, effect) for step, effect in chosen if any_course(effect)]
    fits = [*(step.before for step, _ in flexible), *([found.last] if nothing_fits else [])]
    # A few short events may be far larger than the flicker.
    if any(events_of(fit.restored()) for fit in fits):
        return True
    shaped = any(getattr(e, name, ()) for e in found.last.forward.model.effects for name in FREE)
    several = len(flexible) > 1 or any(series_of(e) and len(s.equivalents) > 1 for s, e in flexible)
    doubtful = bool(found.steps) and (shaped or several or beats_slowly(found.last))
    return (doubtful or found.verdict == "unexplained") and not nothing_fits


def _by_terms(
    found: Discovery,
    progress: Progress,
    recoded: Callable[[Float32Array], Float32Array] | None,
) -> Discovery:
    """Go on in the grammar; the discovery as it was unless all that was left is then explained.

    Where the catalogue has explained it, terms must do so with no more effects.

    An effect of the catalogue that takes on nearly any course may have hidden part of a term, and
    its course is biased by what was found after it. So these are left out at first, and judged anew
    beside the terms.
    """
    progress("looking for what no catalogue has", 0.0)
    begun, model = found.last, found.last.forward.model
    steps = [step for step in found.steps if step.chosen and not any_course(step.chosen.effect)]
    for step in found.steps:
        model = model if step in steps else model.without(step.name)
    try:
        if len(steps) < len(found.steps):
            begun = fit(begun.forward.with_model(model), begun.data)
        baseline = baseline_of(begun, recoded, scored)
        more = dataclasses.replace(
            found, **_searched(begun, steps, baseline, progress, recoded, terms, ShortestStep)
        )
    except (UsageError, np.linalg.LinAlgError):  # steps have led to an invalid model
        return found
    if more.verdict != "explained" or shares_a_rate(more.last):
        return found
    by_terms = any(term_of(effect) for effect in more.last.forward.model.effects)
    shorter = by_terms and len(more.steps) <= len(found.steps)
    return more if shorter or found.verdict == "unexplained" else found


def beats_slowly(fit: Fit) -> bool:
    """Whether an effect is a tone so near the flicker that it stands for the flicker's own course.

    Its beat has fewer turns in the recording than a tone needs to be told from a drift.
    """
    flicker_hz, rate_hz = 2.0 * fit.data.nominal_hz, float(fit.data.frame_rate)
    tones_hz = filter(None, map(_rate_hz, fit.forward.model.effects))
    beats_hz = (math.remainder(math.remainder(hz, flicker_hz), rate_hz) for hz in tones_hz)
    return any(abs(hz) * float(fit.data.time_s[-1]) < LEAST_TURNS for hz in beats_hz)


def _rate_hz(effect: Effect) -> float:
    """Rate at which an effect comes again; 0 if it has none."""
    return next((getattr(effect, name) for name in RATES if hasattr(effect, name)), 0.0)


def shares_a_rate(fit: Fit) -> bool:
    """Whether a term and another effect come again at one rate, as the frames show it.

    It is one cause then that acts at two places, such as a frame now and then that is mixed with
    the one before, and neither effect is what it is.
    """
    rate_hz, rates = float(fit.data.frame_rate), list[tuple[float, bool]]()
    for effect in fit.forward.model.effects:
        hz = _rate_hz(effect) or rate_hz / getattr(effect, "period_frames", math.inf)
        if hz:
            rates.append((abs(math.remainder(hz, rate_hz)), term_of(effect) is not None))
    near_hz = 1.0 / float(fit.data.time_s[-1])
    pairs = itertools.combinations(rates, 2)
    return any(abs(a - b) < near_hz and (mine or its) for (a, mine), (b, its) in pairs)


def _searched(
    begun: Fit,
    before: Sequence[Step],
    baseline: CodecBaseline,
    progress: Progress,
    recoded: Callable[[Float32Array], Float32Array] | None,
    among: Callable[[Fit], list[ScoredEffect]] = candidates,
    kind: type[Step] = Step,
) -> dict[str, Any]:
    """Add effects to a fit that earlier rounds led to; return the result's part of a discovery."""
    last, steps, refused = begun, list(before), None
    for step, last in search(begun, baseline, among, kind, partial(progress, "")):  # noqa: B007 (used)
        if step.chosen is None:
            refused = step
            break
        steps.append(step)
        progress(f"added {' or '.join(step.equivalents)}, looking for what else is missing", 0.0)
    last, steps = needed(last, steps, baseline)
    if steps:
        renewed = baseline_of(last, recoded, None)
        if last.gap.most > NOTHING_FITS + renewed.most:  # the added effects explain nothing
            last, steps = begun, []
        else:
            baseline = renewed
    floor = refused.floor if refused and refused.before.forward is last.forward else floor_of(last)
    floor = floor.raised(baseline.gap, baseline.most)
    return {
        "last": last, "steps": tuple(steps), "refused": refused, "baseline": baseline,
        "floor": floor, "after": where(last),
    }  # fmt: skip

"""The whole workflow on one recording.

What the frames' stamps say beyond what a model lets expect: frames late, or stamps in error.

Stamps are data as rows are, but have no noise: what a model says of them must be so to the unit
that they are written in. Whether the frames themselves are late, or only their stamps in error,
the phase of the flicker tells.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rsenf.discrepancy.codec_baseline import CodecBaseline, usual_of
from rsenf.discrepancy.fit import Fit, fit
from rsenf.discrepancy.forward_model import ForwardModel, plan
from rsenf.discrepancy.forward_selection import Step, needed, search
from rsenf.discrepancy.measured import Float32Array, Measured
from rsenf.discrepancy.noise_floor import NoiseFloor, floor_of
from rsenf.discrepancy.residual_breakdown import ResidualShare, where
from rsenf.discrepancy.series import WHITE_STDS
from rsenf.discrepancy.start import first_fit
from rsenf.messages.schema import FloatArray
from rsenf.model import CATALOGUE, CaptureModel, Effect
from rsenf.model.effects.residue import NOTHING_FITS

# Time bases of files and of protocols: milliseconds of Matroska, MPEG's 90 kHz, µs, ns.
UNITS_S = (1e-3, 1.0 / 90_000.0, 1e-6)
ROUNDING_S = 2e-9
# Held-out residual, relative, by which rows must say that frames are or aren't as late.
TELLS = 0.01


@dataclass(frozen=True, eq=False)
class TimestampCheck:
    """An effect that the stamps show.

    Attributes
    ----------
    effect : Effect
    rivals : tuple of str
        Effects that would do as well, it among them.
    fit : Fit
        Of the model with it.
    gap : float
        Power of the error that somebody who believes the plain stamps makes, over the flicker's.
    rms_s : float
        Of what the stamps say beyond the model.
    """

    effect: Effect
    rivals: tuple[str, ...]
    fit: Fit
    gap: float
    rms_s: float


def off_s(theory: ForwardModel, data: Measured) -> FloatArray:
    """By how much stamps are later than a theory has them; all zero where it has them right."""
    expected = plan(theory.model, data).stamp_s()[: data.slot[-1] + 1]
    expected = expected[data.slot] - expected[data.slot[0]]
    late_s = data.stamp_s - expected
    return late_s if np.abs(late_s).max() > _unit_s(data.stamp_s) else np.zeros_like(late_s)


def gap_of_stamps(late_s: FloatArray, nominal_hz: float) -> float:
    """Power of the error in the flicker that such stamps make, over that of the flicker."""
    turned_rad = 4.0 * math.pi * nominal_hz * (late_s - late_s.mean())
    return float(np.mean(np.abs(np.exp(1j * turned_rad) - 1.0) ** 2))


def stamps_of(first: Fit) -> TimestampCheck | None:
    """Explain stamps that aren't as the model has them; None where they are, or nothing does.

    Parameters
    ----------
    first : Fit
        Of a model whose frames are as regular as it has them.
    """
    data = first.data
    late_s = off_s(first.theory, data)
    if not late_s.any():
        return None
    gap, rms_s = gap_of_stamps(late_s, data.nominal_hz), float(late_s.std())
    every_s = np.interp(np.arange(data.slot[-1] + 1), data.slot, late_s)
    late = _late_frames(first.theory, every_s, data)
    # Frames that are late turn the light; stamps in error don't.
    better = 1.0 - late.misfit / first.misfit
    if _white(late_s) and better < TELLS:
        error = CATALOGUE["timestamp_jitter"](error_s=_values(every_s), jitter_s=rms_s)  # type: ignore[call-arg]
        same = first.theory.with_model(first.theory.model.plus(error))
        kept = Fit(data, first.begun, same, first.rows, first.residual, first.slopes, first.stderr)
        rivals = (error.name,) if better < -TELLS else (error.name, "variable_frame_rate")
        return TimestampCheck(error, rivals, kept, gap, rms_s)
    if better < -TELLS:
        return None  # stamps that wander while the frames don't: no effect of the catalogue
    return TimestampCheck(late.theory.model.effects[-1], ("variable_frame_rate",), late, gap, rms_s)


def _late_frames(theory: ForwardModel, late_s: FloatArray, data: Measured) -> Fit:
    """Fit a theory whose frames begin as late as their stamps say."""
    step_s = 1.0 / float(data.frame_rate)
    ratio = float(np.diff(late_s).std() / step_s)
    effect = CATALOGUE["variable_frame_rate"](rate_ratio=min(ratio, 0.2), late_s=_values(late_s))  # type: ignore[call-arg]
    course = theory.course
    at_nodes = np.interp(course.node_s, step_s * np.arange(late_s.size), late_s)
    turned_rad = 4.0 * math.pi * data.nominal_hz * at_nodes
    course = course.through(course.psi_rad - turned_rad)
    return fit(dataclasses.replace(theory, model=theory.model.plus(effect), course=course), data)


def _white(late_s: FloatArray) -> bool:
    values = late_s - late_s.mean()
    stays = float(values[1:] @ values[:-1]) / float(values @ values)
    return abs(stays) < WHITE_STDS / math.sqrt(values.size)


def _unit_s(stamp_s: FloatArray) -> float:
    """Unit that stamps are written in, as far as it can be seen."""
    for unit in UNITS_S:
        if np.abs(stamp_s - unit * np.rint(stamp_s / unit)).max() < ROUNDING_S:
            return unit
    return ROUNDING_S


def _values(series: FloatArray) -> tuple[float, ...]:
    return tuple(series.tolist())


@dataclass(frozen=True, eq=False)
class Discovery:
    """What was found.

    Attributes
    ----------
    first, last : Fit
        Before any effect was added, and after the last.
    steps : tuple of Step
        Those that added one.
    stamps : Stamps or None
        What the frames' stamps have shown, before any row was looked at.
    floor : NoiseFloor
        Of data that the last theory made.
    usual : CodecBaseline
        What the recording's codec may do by itself; nothing where there is none, or it is unknown.
    before, after : list of ResidualShare
        Where theory and data disagreed, and where they still do.
    refused : Step or None
        The last round, where it tried what it didn't add.
    """

    first: Fit
    last: Fit
    steps: tuple[Step, ...]
    stamps: TimestampCheck | None
    floor: NoiseFloor
    usual: CodecBaseline
    before: list[ResidualShare]
    after: list[ResidualShare]
    refused: Step | None = None

    @property
    def gap_before(self) -> float:
        """Gap of the model to begin with: of rows and of stamps."""
        return self.first.gap.value + stamps_gap(self.first)

    @property
    def gap_after(self) -> float:
        """Gap of the model at last."""
        return self.last.gap.value + stamps_gap(self.last)

    @property
    def verdict(self) -> str:
        """``no_discrepancy``, ``explained`` or ``unexplained``."""
        if self.last.gap.most > self.floor.most or stamps_gap(self.last) > self.floor.limit:
            return "unexplained"
        return "explained" if self.steps or self.stamps else "no_discrepancy"

    @property
    def shrinkage(self) -> float:
        """Share of the gap above the floor that is gone; NaN where there was none."""
        above = self.gap_before - self.floor.median
        if abs(above) <= self.floor.limit - self.floor.median:
            return float("nan")
        return 1.0 - (self.gap_after - self.floor.median) / above


def stamps_gap(fit: Fit) -> float:
    """Share of the flicker's power that a fit's stamps get wrong."""
    return gap_of_stamps(off_s(fit.theory, fit.data), fit.data.nominal_hz)


def discover(
    model: CaptureModel,
    data: Measured,
    progress: Callable[[str], None] = lambda doing: None,
    recoded: Callable[[Float32Array], Float32Array] | None = None,
) -> Discovery:
    """Find what a model lacks of a recording, and add it.

    Parameters
    ----------
    model : CaptureModel
        To begin with.
    data : Measured
    progress : callable, optional
        Told what is being done.
    recoded : callable, optional
        Returns what the recording's codec leaves of rows, (frames, lines, strips).

    Raises
    ------
    InputError
        When the recording has no flicker to fit a model to.
    """
    progress("fitting the model")
    first = first_fit(model, data)
    disagreed = where(first)
    stamps = stamps_of(first)
    begun = last = stamps.fit if stamps else first
    if recoded:
        progress("coding the fitted model as the recording was")
    usual = usual_of(last, recoded)
    steps: list[Step] = []
    refused = None
    progress("looking for what is missing")
    for step, last in search(begun, usual):  # noqa: B007 (what it has led to is used below)
        if step.chosen is None:
            refused = step
            break
        steps.append(step)
        first = first.released(rows=True)
        progress(f"added {' or '.join(steps[-1].kin)}, looking for what else is missing")
    last, steps = needed(last, steps, usual)
    if steps:
        own = usual_of(last, recoded)
        if last.gap.most > NOTHING_FITS + own.most:  # then nothing that was added explains it
            last, steps = begun, []
        else:
            usual = own
    floor = refused.floor if refused and refused.before.theory is last.theory else floor_of(last)
    floor = floor.raised(usual.gap, usual.most)
    return Discovery(
        first, last, tuple(steps), stamps, floor, usual, disagreed, where(last), refused
    )

"""The whole workflow on one recording, and what it comes to."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from rsenf.discrepancy.fit import Fit, fit
from rsenf.discrepancy.floor import Floor, floor_of
from rsenf.discrepancy.gap import NOTHING_FITS
from rsenf.discrepancy.hint import hint_json, hint_of
from rsenf.discrepancy.knobs import series_of
from rsenf.discrepancy.measured import Float32Array, Measured
from rsenf.discrepancy.search import Step, needed, search
from rsenf.discrepancy.stamps import Stamps, gap_of_stamps, off_s, stamps_of
from rsenf.discrepancy.start import first_theory
from rsenf.discrepancy.usual import Usual, usual_of
from rsenf.discrepancy.where import Share, where
from rsenf.model import CaptureModel, Effect
from rsenf.model.sensor import QUANTISATION_VAR

MOST_EVENTS = 100  # that are listed
FEWEST_PIXELS, MOST_PIXELS = 16, 8192  # of a line
SURE = 3.0  # standard errors with which a place is one


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
    floor : Floor
        Of data that the last theory made.
    usual : Usual
        What the recording's codec may do by itself; nothing where there is none, or it is unknown.
    before, after : list of Share
        Where theory and data disagreed, and where they still do.
    refused : Step or None
        The last round, where it tried what it didn't add.
    """

    first: Fit
    last: Fit
    steps: tuple[Step, ...]
    stamps: Stamps | None
    floor: Floor
    usual: Usual
    before: list[Share]
    after: list[Share]
    refused: Step | None = None

    @property
    def gap_before(self) -> float:
        """Gap of the model to begin with: of rows and of stamps."""
        return self.first.gap.value + _stamps_gap(self.first)

    @property
    def gap_after(self) -> float:
        """Gap of the model at last."""
        return self.last.gap.value + _stamps_gap(self.last)

    @property
    def verdict(self) -> str:
        """``no_discrepancy``, ``explained`` or ``unexplained``."""
        if self.last.gap.most > self.floor.most or _stamps_gap(self.last) > self.floor.limit:
            return "unexplained"
        return "explained" if self.steps or self.stamps else "no_discrepancy"

    @property
    def shrinkage(self) -> float:
        """Share of the gap above the floor that is gone; NaN where there was none."""
        above = self.gap_before - self.floor.median
        if abs(above) <= self.floor.limit - self.floor.median:
            return float("nan")
        return 1.0 - (self.gap_after - self.floor.median) / above


def _stamps_gap(fit: Fit) -> float:
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
    first = fit(first_theory(model, data), data)
    stamps = stamps_of(first)
    begun = last = stamps.fit if stamps else first
    if recoded:
        progress("coding the fitted model as the recording was")
    usual = usual_of(last, recoded)
    steps: list[Step] = []
    refused = None
    progress("looking for what is missing")
    for step in search(last, usual):
        if step.chosen is None:
            refused = step
            break
        steps.append(step)
        last = step.chosen.fit
        progress(f"added {' or '.join(step.kin)}, looking for what else is missing")
    last, steps = needed(last, steps, usual)
    if steps:
        own = usual_of(last, recoded)
        if last.gap.most > NOTHING_FITS + own.most:  # then nothing that was added explains it
            last, steps = begun, []
        else:
            usual = own
    floor = refused.floor if refused and refused.before is last else floor_of(last)
    floor = floor.raised(usual.gap, usual.most)
    return Discovery(
        first, last, tuple(steps), stamps, floor, usual, where(first), where(last), refused
    )


def discovery_json(found: Discovery, model_out: str) -> dict[str, Any]:
    """Return the stable keys of what was found, plain values all."""
    first, last, floor = found.first.gap, found.last.gap, found.floor
    return {
        "version": 1,
        "verdict": found.verdict,
        "effects": [
            *([_stamps_json(found)] if found.stamps else []),
            *(_step_json(step) for step in found.steps),
        ],
        "gap": {
            "before": found.gap_before,
            "before_stderr": first.stderr,
            "after": found.gap_after,
            "stderr": last.stderr,
            "floor": floor.median,
            "limit": floor.limit,
            "codec": found.usual.gap,
            "shrinkage": found.shrinkage if found.shrinkage == found.shrinkage else None,
        },
        "held_out_mean_square": {"before": found.first.misfit, "after": found.last.misfit},
        "where_before": [dataclasses.asdict(share) for share in found.before],
        "unexplained": _left(found),
        "model_out": model_out,
    }


def model_of(found: Discovery, made_from: str) -> CaptureModel:
    """Return the extended model, with where it comes from and how sure its parameters are."""
    theory = found.last.theory
    errors = {
        f"{knob.part}.{knob.name}{'.across' if knob.across else ''}": float(error)
        for knob, error in zip(found.last.knobs, found.last.stderr, strict=True)
    }
    provenance = {
        "made_by": "rsenf discover",
        "from": made_from,
        "verdict": found.verdict,
        "stderr": errors,
        "gap": {"before": found.gap_before, "after": found.gap_after},
        "wander": "the light's course is the recording's own and isn't part of the model",
    }
    extended = theory.whole()
    shutter = dataclasses.replace(extended.shutter, columns=_columns(found.last))
    return dataclasses.replace(extended, shutter=shutter, provenance=provenance)


def _columns(last: Fit) -> int:
    """How many pixels a line needs for its means to have as much noise as was measured.

    Whole halves of strips of them, as the wall is described.
    """
    wall, unit = last.theory.wall.astype(np.float32), 2 * last.data.strips
    pixel_var = float(last.theory.model.sensor.variance(wall).mean()) + QUANTISATION_VAR
    wanted = pixel_var / last.noise_var * last.data.strips
    return unit * min(max(round(wanted / unit), -(-FEWEST_PIXELS // unit)), MOST_PIXELS // unit)


def _stamps_json(found: Discovery) -> dict[str, Any]:
    stamps = found.stamps
    assert stamps is not None
    several = len(stamps.rivals) > 1
    return {
        "name": None if several else stamps.effect.name,
        "class": list(stamps.rivals) if several else [],
        "parameters": _numbers(stamps.effect),
        "stderr": {},
        "told_apart_by": stamps.effect.told_apart_by if several else "",
        "gap_before": found.gap_before,
        "gap_after": stamps.fit.gap.value,
        "gain": stamps.gap,
        "evidence": None,  # stamps have no noise
        "tried": len(stamps.rivals),
    }


def _numbers(effect: Effect) -> dict[str, Any]:
    """Parameters of an effect, without those that have a value for each frame or line."""
    told = effect.to_dict().items()
    return {k: v for k, v in told if not (isinstance(v, list) and len(v) > MOST_EVENTS)}


def _step_json(step: Step) -> dict[str, Any]:
    best = step.chosen
    assert best is not None
    kin = step.kin
    errors = {
        (k.name, k.across): float(e)
        for k, e in zip(best.fit.knobs, best.fit.stderr, strict=True)
        if k.part == best.effect.name
    }
    told = series_of(best.effect)
    return {
        "name": best.effect.name if len(kin) == 1 else None,
        "class": list(kin) if len(kin) > 1 else [],
        "parameters": {k: v for k, v in _numbers(best.effect).items() if not told or k != told[0]},
        "stderr": {name: error for (name, across), error in errors.items() if not across},
        "told_apart_by": best.effect.told_apart_by if len(kin) > 1 else "",
        "gap_before": step.before.gap.value,
        "gap_after": best.fit.gap.value,
        "gain": best.gain,
        "evidence": best.nats,
        "tried": step.tried,
    }


def _left(found: Discovery) -> dict[str, Any] | None:
    if found.verdict != "unexplained":
        return None
    places = [share for share in found.after if share.sure > SURE]
    return {
        "gap": found.gap_after,
        "stamps_gap": _stamps_gap(found.last),
        "places": [dataclasses.asdict(share) for share in places],
        **hint_json(hint_of(found.last, found.after)),
    }

"""The whole workflow on one recording, and what it comes to."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from rsenf.discrepancy.fit import Fit, fit
from rsenf.discrepancy.floor import Floor, floor_of
from rsenf.discrepancy.hint import hint_json, hint_of
from rsenf.discrepancy.knobs import series_of
from rsenf.discrepancy.measured import Measured
from rsenf.discrepancy.search import Step, search
from rsenf.discrepancy.start import first_theory
from rsenf.discrepancy.where import Share, where
from rsenf.messages import EnfEstimate
from rsenf.model import CaptureModel

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
    floor : Floor
        Of data that the last theory made.
    before, after : list of Share
        Where theory and data disagreed, and where they still do.
    refused : Step or None
        The last round, where it tried what it didn't add.
    """

    first: Fit
    last: Fit
    steps: tuple[Step, ...]
    floor: Floor
    before: list[Share]
    after: list[Share]
    refused: Step | None = None

    @property
    def verdict(self) -> str:
        """``no_discrepancy``, ``explained`` or ``unexplained``."""
        # Below zero beyond chance: neighbouring rows are wrong in opposite ways.
        if abs(self.last.gap.value) > self.floor.limit:
            return "unexplained"
        return "explained" if self.steps else "no_discrepancy"

    @property
    def shrinkage(self) -> float:
        """Share of the gap above the floor that is gone; NaN where there was none."""
        above = self.first.gap.value - self.floor.median
        if abs(above) <= self.floor.limit - self.floor.median:
            return float("nan")
        return 1.0 - (self.last.gap.value - self.floor.median) / above


def discover(
    model: CaptureModel,
    data: Measured,
    estimates: Sequence[EnfEstimate],
    idle_ratio: float,
    progress: Callable[[str], None] = lambda doing: None,
) -> Discovery:
    """Find what a model lacks of a recording, and add it.

    Parameters
    ----------
    model : CaptureModel
        To begin with.
    data : Measured
    estimates : sequence of EnfEstimate
        Of the same rows.
    idle_ratio : float
        As estimated from them; NaN for unknown.
    progress : callable, optional
        Told what is being done.

    Raises
    ------
    InputError
        When the recording has no flicker to fit a model to.
    """
    progress("fitting the model")
    first = fit(first_theory(model, data, estimates, idle_ratio), data)
    floor = floor_of(first)
    steps: list[Step] = []
    refused = None
    progress("looking for what is missing")
    for step in search(first, floor.limit - floor.median):
        if step.chosen is None:
            refused = step
            break
        steps.append(step)
        progress(f"added {' or '.join(step.kin)}, looking for what else is missing")
    last = steps[-1].chosen.fit if steps and steps[-1].chosen else first
    floor = floor_of(last) if steps else floor
    return Discovery(first, last, tuple(steps), floor, where(first), where(last), refused)


def discovery_json(found: Discovery, model_out: str) -> dict[str, Any]:
    """Return the stable keys of what was found, plain values all."""
    first, last, floor = found.first.gap, found.last.gap, found.floor
    return {
        "version": 1,
        "verdict": found.verdict,
        "effects": [_step_json(step) for step in found.steps],
        "gap": {
            "before": first.value,
            "before_stderr": first.stderr,
            "after": last.value,
            "stderr": last.stderr,
            "floor": floor.median,
            "limit": floor.limit,
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
        "gap": {"before": found.first.gap.value, "after": found.last.gap.value},
        "wander": "the light's course is the recording's own and isn't part of the model",
    }
    return dataclasses.replace(theory.whole(), provenance=provenance)


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
        "parameters": {k: v for k, v in best.effect.to_dict().items() if not told or k != told[0]},
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
        "gap": found.last.gap.value,
        "places": [dataclasses.asdict(share) for share in places],
        **hint_json(hint_of(found.last, found.after)),
    }

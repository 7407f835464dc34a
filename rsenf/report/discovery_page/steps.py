"""The rounds of forward selection: the effects tried, the one added, and the gap that is left.

Where model and data disagree is told as the share of the first gap of each part.
"""

from __future__ import annotations

import inspect
from collections.abc import Sequence
from typing import Any

import numpy as np

from rsenf.discrepancy.fit_parameters import series_of
from rsenf.discrepancy.forward_selection import WORST, Step
from rsenf.discrepancy.residual_breakdown import ResidualShare
from rsenf.discrepancy.trial import Trial
from rsenf.discrepancy.verdict import Discovery
from rsenf.model import Effect
from rsenf.model.parameters import fittings
from rsenf.report.pages import setting

MOST = 10  # parts listed for each axis, those with the largest shares
DIGITS = {"time_s": 1, "row": 0, "level": 1, "alias_hz": 2, "wander_hz": 3}
Pair = tuple[ResidualShare | None, ResidualShare | None]
NAMES = {
    "time_s": "time (s)",
    "row": "rows",
    "level": "level of the wall",
    "strip": "strip",
    "step": "from one frame to the next",
    "alias_hz": "frequency (alias, Hz)",
    "wander_hz": "how fast it wanders (Hz)",
}


def places_table(
    before: Sequence[ResidualShare], after: Sequence[ResidualShare], smaller: float
) -> list[dict[str, Any]]:
    """Return a group of table lines for each axis.

    Parameters
    ----------
    before, after : sequence of ResidualShare
    smaller : float
        Ratio of the gap after to the gap before.
    """
    groups = []
    for axis, name in NAMES.items():
        old, new = ([s for s in shares if s.axis == axis] for shares in (before, after))
        pairs = _lines(old, new) if axis == "alias_hz" else list(zip(old, new, strict=True))
        if not pairs or (len(pairs) < 2 and axis != "step"):
            continue
        most = sorted(pairs, key=lambda pair: -max(abs(s.share) for s in pair if s))[:MOST]
        lines = [_line(*pair, smaller) for pair in pairs if pair in most]
        groups.append({"name": name, "lines": lines, "left_out": len(pairs) - len(most)})
    return groups


def _lines(before: list[ResidualShare], after: list[ResidualShare]) -> list[Pair]:
    """Pair spectral lines, which may differ before and after."""
    old, new = ({(share.low, share.high): share for share in shares} for shares in (before, after))
    return [(old.get(at), new.get(at)) for at in sorted({**old, **new})]


def _line(old: ResidualShare | None, new: ResidualShare | None, smaller: float) -> dict[str, str]:
    place = old or new
    assert place is not None
    return {
        "place": _place(place),
        "before": _percent(old, 1.0),
        "before_sure": _sure(old),
        "after": _percent(new, smaller),
        "after_sure": _sure(new),
    }


def _place(share: ResidualShare) -> str:
    if share.axis == "step":
        return "all"
    if share.axis == "strip":
        return f"{share.low + 1:.0f}"
    digits = DIGITS[share.axis]
    return f"{share.low:.{digits}f} to {share.high:.{digits}f}"


def _percent(share: ResidualShare | None, of: float) -> str:
    return f"{100.0 * share.share * of:.2f} %" if share else "no line"


def _sure(share: ResidualShare | None) -> str:
    return f"{share.sure:.{1 if abs(share.sure) < 100.0 else 0}f}" if share else ""


def step_of(step: Step, number: int) -> dict[str, Any]:
    """Return the template's values for a step that added an effect.

    Parameters
    ----------
    step : Step
    number : int
        Number of the step, from 1.
    """
    best = step.chosen
    assert best is not None
    effect = best.effect
    return {
        **round_of(step),
        "number": number,
        "name": " or ".join(step.kin),
        "is_class": len(step.kin) > 1,
        "told_apart_by": effect.told_apart_by,
        "about": [summary(t.effect) for t in step.trials if t.effect.name in step.kin],
        "source": effect.source,
        "parameters": _parameters(best),
        "before": gap_words(step.before.gap),
        "after": gap_words(best.fit.gap),
    }


def round_of(step: Step) -> dict[str, Any]:
    """Return the template's values for a round: the effects tried, and the limits."""
    return {
        "tried": step.tried,
        "limit": f"{step.limit:.1f}",
        "least": f"{step.least:.1e}",
        "trials": [
            {
                "name": trial.effect.name,
                "gain": f"{trial.gain:.1e}",
                "nats": f"{trial.nats:.4g}",
                "worst": f"{trial.worst:.1f}",
                "gap": f"{trial.fit.gap.value:.1e}",
                "outcome": _outcome(step, trial),
            }
            for trial in step.trials
        ],
    }


def names_of(found: Discovery) -> list[str]:
    """Return the name of the effect, or class of effects, that each step added."""
    return [" or ".join(step.kin) for step in found.steps]


def summary(effect: Effect) -> str:
    """Return the first line of an effect's description."""
    text = inspect.getdoc(type(effect)) or effect.name
    return f"{effect.name}: {text.splitlines()[0].replace('``', '')}"


def gap_words(gap: Any) -> str:
    """Return a gap and its standard error as text."""
    return f"{gap.value:.2e} ± {gap.stderr:.1e}"


def _outcome(step: Step, trial: Trial) -> str:
    if step.chosen is trial:
        return "added"
    if trial.effect.name in step.kin:
        return "does as well: the same class"
    if trial.nats <= step.limit:
        return "too little evidence"
    if trial.gain <= step.least:
        return "too small to matter"
    if trial.worst <= WORST:
        return "makes a part of the recording worse"
    return "explains less"


def _parameters(trial: Trial) -> list[dict[str, str]]:
    """Return parameters with errors if they were fitted; of a series only the number of values."""
    effect, spec = trial.effect, series_of(trial.effect)
    errors = trial.fit.stderr_of(effect.name)
    turned = {fitting.turn for fitting in fittings(effect).values() if fitting.turn}
    out = []
    for name, value in effect.to_dict().items():
        meta = effect.__dataclass_fields__[name].metadata if name in vars(effect) else {}
        if spec and name == spec[0]:
            values = np.array(getattr(effect, name))
            text = f"a value for each {spec[1].each}, {values.size} in all, {values.std():.2g} rms"
        elif name in errors:
            text = _with_error(value, errors[name])
        else:
            text = "drawn" if value is None else setting(value)
            text += "" if name in turned else " (not fitted)"
        out.append({"name": name, "value": text, "about": str(meta.get("doc", ""))})
    return out


def _with_error(value: Any, error: float | list[float]) -> str:
    if isinstance(error, list):
        return ", ".join(_with_error(v, e) for v, e in zip(value, error, strict=True))
    return f"{value:.6g} ± {error:.2g}"

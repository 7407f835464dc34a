"""The rounds of forward selection as blocks: what was tried, what was added, and what is left.

Where model and data disagree is told as the share of the first gap of each part.
"""

from __future__ import annotations

import inspect
from collections.abc import Sequence
from typing import Any

import numpy as np
from markupsafe import Markup

from rsenf.discrepancy.fit_parameters import series_of
from rsenf.discrepancy.forward_selection import WORST, Step
from rsenf.discrepancy.residual_breakdown import ResidualShare
from rsenf.discrepancy.trial import Trial
from rsenf.model import Effect
from rsenf.model.parameters import fittings
from rsenf.report.page import explained, facts, heading, note, paragraph, table, whole
from rsenf.report.values import setting, texts

MOST = 10  # parts listed for each axis, those with the largest shares
DIGITS = {"time_s": 1, "row": 0, "level": 1, "alias_hz": 2, "wander_hz": 3}
NAMES = {
    "time_s": "time (s)",
    "row": "rows",
    "level": "level of the wall",
    "strip": "strip",
    "step": "from one frame to the next",
    "alias_hz": "frequency (alias, Hz)",
    "wander_hz": "how fast it wanders (Hz)",
}


def shares_table(
    before: Sequence[ResidualShare], after: Sequence[ResidualShare], smaller: float, added: bool
) -> Markup:
    """Return a table with a group of lines for each axis.

    Parameters
    ----------
    before, after : sequence of ResidualShare
    smaller : float
        Ratio of the gap after to the gap before.
    added : bool
        Whether an effect was added; else there is no after.
    """
    rows: list[str | list[object]] = []
    for axis, name in NAMES.items():
        old, new = ([s for s in shares if s.axis == axis] for shares in (before, after))
        # Spectral lines may differ before and after.
        pairs = _by_place(old, new) if axis == "alias_hz" else list(zip(old, new, strict=True))
        if not pairs or (len(pairs) < 2 and axis != "step"):
            continue
        most = sorted(pairs, key=lambda pair: -max(abs(s.share) for s in pair if s))[:MOST]
        without = f" (without {len(pairs) - len(most)} with less)" * (len(pairs) > len(most))
        rows.append(f"{name}{without}")
        for was, now in (pair for pair in pairs if pair in most):
            then = [_percent(now, smaller), _sure(now)] if added else []
            rows.append([whole(_place(was or now)), _percent(was, 1.0), _sure(was), *then])
    heads = (
        ["where", "#before", "#sure", "#after", "#sure"] if added else ["where", "#share", "#sure"]
    )
    return table(heads, rows, "Shares of the gap" + " at first, before and after" * added)


Pair = tuple[ResidualShare | None, ResidualShare | None]


def _by_place(before: list[ResidualShare], after: list[ResidualShare]) -> list[Pair]:
    old, new = ({(share.low, share.high): share for share in shares} for shares in (before, after))
    return [(old.get(at), new.get(at)) for at in sorted({**old, **new})]


def _place(share: ResidualShare | None) -> str:
    assert share is not None
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


def step_blocks(step: Step, number: int) -> list[Markup]:
    """Return what is told of a step that added an effect; ``number``: from 1."""
    best = step.chosen
    assert best is not None
    blocks = [
        heading(f"Step {number}: {' or '.join(step.kin)} added"),
        *(paragraph(summary(t.effect)) for t in step.trials if t.effect.name in step.kin),
    ]
    if len(step.kin) > 1:
        blocks.append(paragraph(Markup(
            "<strong>These can't be told apart from this recording.</strong> The class is what was "
            "found; the figures are of the one that fits best. What would decide: {}."
        ).format(best.effect.told_apart_by)))  # fmt: skip
    needed = f"{step.limit:.1f} were needed, {step.tried} candidates having been looked at"
    table_of = [
        *_parameters(best),
        ("gap before", gap_text(step.before.gap)),
        ("gap after", gap_text(best.fit.gap)),
        ("evidence", explained(f"{step.trials[0].nats:.4g} nats", needed)),
        ("known from", best.effect.source),
    ]
    return [*blocks, facts(table_of), *round_blocks(step)]


def round_blocks(step: Step) -> list[Markup]:
    """Return what is told of a round: the effects tried, and the limits."""
    if not step.trials:
        return [paragraph(
            f"Of {step.tried} candidates looked at, none promised enough to be fitted."
        )]  # fmt: skip
    return [
        table(
            ["effect", "#gain", "#evidence", "#worst", "#gap", "outcome"],
            ([t.effect.name, f"{t.gain:.1e}", f"{t.nats:.4g}", f"{t.worst:.1f}",
              f"{t.fit.gap.value:.1e}", _outcome(step, t)] for t in step.trials),
            f"What was fitted, of {step.tried} looked at",
        ),
        note(texts("discovery")["round"].format(least=step.least, limit=step.limit)),
    ]  # fmt: skip


def summary(effect: Effect) -> str:
    """Return the first line of an effect's description."""
    text = inspect.getdoc(type(effect)) or effect.name
    return f"{effect.name}: {text.splitlines()[0].replace('``', '')}"


def gap_text(gap: Any) -> str:
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


def _parameters(trial: Trial) -> list[tuple[str, Markup]]:
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
        out.append((name, explained(text, meta.get("doc", ""))))
    return out


def _with_error(value: Any, error: float | list[float]) -> str:
    if isinstance(error, list):
        return ", ".join(map(_with_error, value, error))
    return f"{value:.6g} ± {error:.2g}"

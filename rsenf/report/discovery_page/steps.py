"""The rounds of forward selection as blocks: what was tried, what was added, and what is left.

Where model and data disagree is told as the share of the first gap of each part. Beside a reference
there are pictures and blocks of the clock offset and of the measured and simulated ENF, too.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Sequence
from itertools import groupby
from typing import Any

import numpy as np
from markupsafe import Markup

from rsenf.discrepancy.clock_offset import (
    AlignedReference,
    ClockOffsetDiscovery,
    LagFit,
    where_beside,
)
from rsenf.discrepancy.effect_file import file_of
from rsenf.discrepancy.fit_parameters import series_of
from rsenf.discrepancy.forward_selection import WORST, Step
from rsenf.discrepancy.grammar import term_of, words_of
from rsenf.discrepancy.residual_breakdown import ResidualShare
from rsenf.discrepancy.trial import Trial
from rsenf.model import CATALOGUE, Effect
from rsenf.model.parameters import fittings
from rsenf.report import page as html
from rsenf.report.discovery import kind_words, tone_words
from rsenf.report.discovery_page.pictures import WIDTH_IN, gap_picture
from rsenf.report.panels import GRID, HEIGHT_IN, MARK, SIGNAL, Panel, fixed_style, picture_of
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
            rows.append([html.whole(_place(was or now)), _percent(was, 1.0), _sure(was), *then])
    heads = (
        ["where", "#before", "#sure", "#after", "#sure"] if added else ["where", "#share", "#sure"]
    )
    return html.table(heads, rows, "Shares of the gap" + " at first, before and after" * added)


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
    added = [trial for trial in step.trials if trial.effect.name in step.equivalents]
    blocks = [
        html.heading(f"Step {number}: {' or '.join(step.equivalents)} added"),
        *(html.paragraph(_trial_words(trial)) for trial in added),
    ]
    if len(step.equivalents) > 1:
        blocks.append(html.paragraph(Markup(
            "<strong>These can't be told apart from this recording.</strong> The class is what was "
            "found; the figures are of the one that fits best. What would decide: {}."
        ).format(best.effect.told_apart_by)))  # fmt: skip
    needed = f"{step.limit:.1f} were needed, {step.scored} candidates having been looked at"
    table_of = [
        *_parameters(best),
        ("gap before", gap_text(step.before.gap)),
        ("gap after", gap_text(best.fit.gap)),
        ("evidence", html.explained(f"{best.nats:.4g} nats", needed)),
        ("known from", best.effect.source),
    ]
    return [*blocks, html.facts(table_of), *round_blocks(step)]


def round_blocks(step: Step) -> list[Markup]:
    """Return what is told of a round: the effects tried, and the limits."""
    if not step.trials:
        return [html.paragraph(
            f"Of {step.scored} candidates looked at, none promised enough to be fitted."
        )]  # fmt: skip
    return [
        html.table(
            ["effect", "#gain", "#evidence", "#worst", "#gap", "outcome"],
            ([t.effect.name, f"{t.gain:.1e}", f"{t.nats:.4g}", f"{t.worst:.1f}",
              f"{t.fit.gap.value:.1e}", _outcome(step, t)] for t in step.trials),
            f"What was fitted, of {step.scored} looked at",
        ),
        html.note(texts("discovery")["round"].format(least=step.least, limit=step.limit)),
    ]  # fmt: skip


def summary(effect: Effect) -> str:
    """Return the first line of an effect's description."""
    text = inspect.getdoc(type(effect)) or effect.name
    return f"{effect.name}: {text.splitlines()[0].replace('``', '')}"


def _trial_words(trial: Trial) -> str:
    """Return what a trial's effect is: of a term what was found, of others their description."""
    effect, rate_hz = trial.effect, float(trial.fit.data.frame_rate)
    if term_of(effect) is None:
        return summary(effect)
    return f"{effect.name}: {words_of(effect, rate_hz)} ({file_of(effect)})"


def gap_text(gap: Any) -> str:
    """Return a gap and its standard error as text."""
    return f"{gap.value:.2e} ± {gap.stderr:.1e}"


def _outcome(step: Step, trial: Trial) -> str:
    if step.chosen is trial:
        return "added"
    if trial.effect.name in step.equivalents:
        return "does as well: the same class"
    if step.chosen and step.equals(trial, step.chosen):
        return "a longer description"
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
        out.append((name, html.explained(text, meta.get("doc", ""))))
    return out


def _with_error(value: Any, error: float | list[float]) -> str:
    if isinstance(error, list):
        return ", ".join(map(_with_error, value, error))
    return f"{value:.6g} ± {error:.2g}"


def _draw_enf(
    figure: Any, beside: AlignedReference, fits: Sequence[tuple[str, LagFit]], noise_hz: float
) -> None:
    """Draw measured and simulated ENF, and their difference below, with a column for each fit."""
    drawn = figure.subplots(2, len(fits), sharex=True, sharey="row", squeeze=False)
    for column, (name, fit) in enumerate(fits):
        above, below = drawn[:, column]
        above.set_title(name)
        above.plot(beside.t_s, fit.said_hz, color=GRID, lw=3.0, label="simulated")
        above.plot(beside.t_s, beside.enf_hz, color=SIGNAL, lw=1.2, label="measured")
        above.ticklabel_format(axis="y", useOffset=False)
        below.axhspan(-2e3 * noise_hz, 2e3 * noise_hz, color=SIGNAL, alpha=0.12, lw=0)
        below.axhline(0.0, color=GRID, lw=0.8)
        below.plot(beside.t_s, 1e3 * fit.residual_hz, color=MARK, lw=1.0)
        for begin_s, end_s in _held_out(beside):
            below.axvspan(begin_s, end_s, ymax=0.04, color=GRID, lw=0)
        below.set_xlabel("time in the recording (s)")
    drawn[0, 0].set_ylabel("ENF (Hz)")
    drawn[1, 0].set_ylabel("difference (mHz)")
    low_hz, high_hz = drawn[0, 0].get_ylim()
    drawn[0, 0].set_ylim(low_hz, high_hz + 0.15 * (high_hz - low_hz))  # room for the legend
    drawn[0, 0].legend(
        loc="upper center", frameon=False, ncols=2, fontsize="small", handlelength=1.2,
        columnspacing=1.0,
    )  # fmt: skip


def _held_out(beside: AlignedReference) -> list[tuple[float, float]]:
    """Return start and end (s) of each held-out block."""
    numbers = np.where(beside.held_out, beside.block, np.nan)
    blocks = groupby(zip(numbers.tolist(), beside.t_s.tolist(), strict=True), key=lambda at: at[0])
    spans = [(number, [t_s for _, t_s in values]) for number, values in blocks]
    return [(t_s[0], t_s[-1]) for number, t_s in spans if number == number]


def draw_beside(found: ClockOffsetDiscovery) -> list[Panel]:
    """Draw the gap, and the ENF before and after an addition, or once if nothing was added."""
    fits = [("before", found.first), ("after", found.last)]
    if not found.skew:
        fits = [("measured and simulated", found.last)]
    gaps = [found.gap(fit) for _, fit in fits]
    names = ["at first", "+ clock_skew"][: len(fits)]
    residual_text = ", ".join(f"{1e3 * np.nanstd(fit.residual_hz):.3g} mHz" for _, fit in fits)
    captions = texts("discovery")["captions"]
    with fixed_style():
        return [
            gap_picture(
                "beside_gap.png", names, gaps, found.floor, captions["reference_gap"],
                "the reference's variance",
            ),
            picture_of(
                "beside_enf.png", "ENF, measured and simulated",
                lambda f: _draw_enf(f, found.beside, fits, math.sqrt(found.chance.var_hz2)),
                captions["enf"],
                f"ENF over time, and what is left of it, which varies by {residual_text}.",
                width_in=WIDTH_IN, height_in=1.4 * HEIGHT_IN,
            ),
        ]  # fmt: skip


def reference_blocks(
    found: ClockOffsetDiscovery, doc: dict[str, Any], pictures: Sequence[Panel]
) -> list[Markup]:
    """Return what is told of a recording beside a reference."""
    blocks = [
        html.paragraph(texts("discovery")["reference"]),
        *(html.figure(picture, narrow=True) for picture in pictures),
        html.facts(
            (name, html.explained(value, about)) for name, value, about in _values(found, doc)
        ),
    ]
    if found.skew:
        blocks.append(html.paragraph(
            f"{summary(CATALOGUE['clock_skew']())} A reference says how far apart two clocks are; "
            "that the reference's is right is taken from whoever made it."
        ))  # fmt: skip
    before, after = (where_beside(found, fit) for fit in (found.first, found.last))
    smaller = doc["gap"]["after"] / (doc["gap"]["before"] or 1e-30)
    if found.verdict != "no_discrepancy" and (before or after):
        blocks += [
            shares_table(before, after, smaller, bool(found.skew)),
            html.note(texts("discovery")["reference_shares"]),
        ]
    return [*blocks, *guess_blocks(doc["unexplained"], found.verdict)]


def guess_blocks(residual: dict[str, Any] | None, verdict: str) -> list[Markup]:
    """Return what a residual looks like, and what would tell; nothing if there is none."""
    if not residual:
        return []
    looks = Markup("{} What is left looks like this: {}.")
    tone = tone_words(residual)
    return [
        html.paragraph(looks.format(html.badge(verdict, "a guess"), kind_words(residual))),
        html.paragraph(f"Its frequency: {tone}." if tone else ""),
        html.paragraph("What would tell:"),
        html.listed(residual["would_tell"]),
    ]


def headline(found: ClockOffsetDiscovery, doc: dict[str, Any]) -> str:
    """Return the result against the reference in one sentence."""
    clock, kind = _clock(found), doc["unexplained"]
    shrinks = f"the gap shrinks by {100.0 * min(found.shrinkage, 1.0):.1f} %"
    chance = "no more than the noise of recording and reference makes"
    if found.verdict == "no_discrepancy":
        return f"The recording follows the reference: what is left between them is {chance}."
    if found.verdict == "explained":
        return f"{clock}: with that {shrinks}, and what is left is {chance}."
    looks = f"what is left looks like this: {kind_words(kind)}."
    if not found.skew:
        return f"Recording and reference differ, and not by a clock's error; {looks}"
    return f"{clock}, and with that {shrinks}, but still more is left than noise; {looks}"


def _clock(found: ClockOffsetDiscovery) -> str:
    if not found.skew:
        return ""
    ppm, error = found.clock
    return f"The camera's clock is off by {ppm:+.1f} ± {error:.1g} ppm against the reference"


def _values(found: ClockOffsetDiscovery, doc: dict[str, Any]) -> list[tuple[str, str, str]]:
    out, gap, how = [], doc["gap"], doc["reference"]
    if found.skew:
        ppm, error = found.clock
        out.append(("clock_ppm", f"{ppm:+.2f} ± {error:.2g}", "fast above 0; by all the recording"))
    out += [
        ("lag", f"{how['lag_s']:.2f} ± {how['lag_stderr_s']:.2f} s", "from the reference's start"),
        ("reference", how["read_as"], "what its values are taken for"),
        ("gap before", gap_text(found.gap(found.first)), "share of the reference's variance"),
        ("gap after", gap_text(found.gap(found.last)), "on held-out stretches"),
        ("chance", f"{gap['floor']:.1e}, at most {gap['limit']:.1e}", "of data without any gap"),
        ("noise", f"{1e3 * how['estimate_noise_hz']:.2g} and {1e3 * how['reference_noise_hz']:.2g} "
         "mHz", "of a value of the recording, and of the reference"),
    ]  # fmt: skip
    if found.skew:
        evidence = f"{found.skew.nats:.4g} nats"
        out.append(("evidence", evidence, f"on held-out stretches, of {found.tried} ways tried"))
    return out

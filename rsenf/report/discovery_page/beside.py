"""A recording beside a reference: its pictures (the gap, measured and simulated ENF) and blocks."""

from __future__ import annotations

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
from rsenf.model import CATALOGUE
from rsenf.report.discovery import kind_words, tone_words
from rsenf.report.discovery_page.pictures import WIDTH_IN, gap_picture
from rsenf.report.discovery_page.steps import gap_text, shares_table, summary
from rsenf.report.page import badge, explained, facts, figure, listed, note, paragraph
from rsenf.report.panels import GRID, HEIGHT_IN, MARK, SIGNAL, Picture, fixed_style, picture_of
from rsenf.report.values import texts


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


def draw_beside(found: ClockOffsetDiscovery) -> list[Picture]:
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
    found: ClockOffsetDiscovery, doc: dict[str, Any], pictures: Sequence[Picture]
) -> list[Markup]:
    """Return what is told of a recording beside a reference."""
    blocks = [
        paragraph(texts("discovery")["reference"]),
        *(figure(picture, narrow=True) for picture in pictures),
        facts((name, explained(value, about)) for name, value, about in _values(found, doc)),
    ]
    if found.skew:
        blocks.append(paragraph(
            f"{summary(CATALOGUE['clock_skew']())} A reference says how far apart two clocks are; "
            "that the reference's is right is taken from whoever made it."
        ))  # fmt: skip
    before, after = (where_beside(found, fit) for fit in (found.first, found.last))
    smaller = doc["gap"]["after"] / (doc["gap"]["before"] or 1e-30)
    if found.verdict != "no_discrepancy" and (before or after):
        blocks += [
            shares_table(before, after, smaller, bool(found.skew)),
            note(texts("discovery")["reference_shares"]),
        ]
    return [*blocks, *guess_blocks(doc["unexplained"], found.verdict)]


def guess_blocks(residual: dict[str, Any] | None, verdict: str) -> list[Markup]:
    """Return what a residual looks like, and what would tell; nothing if there is none."""
    if not residual:
        return []
    looks = Markup("{} What is left looks like this: {}.")
    tone = tone_words(residual)
    return [
        paragraph(looks.format(badge(verdict, "a guess"), kind_words(residual))),
        paragraph(f"Its frequency: {tone}." if tone else ""),
        paragraph("What would tell:"),
        listed(residual["would_tell"]),
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
    """Return names, values and explanations."""
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

"""Discovery against a reference: a page by itself, or a section on the page of the rows.

With its pictures (the gap, measured and simulated ENF), and the extended model as readable YAML.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from rsenf import __version__
from rsenf.discrepancy.clock_offset import (
    AlignedReference,
    ClockOffsetDiscovery,
    LagFit,
    where_beside,
)
from rsenf.model import CATALOGUE, CaptureModel
from rsenf.report.discovery import kind_words
from rsenf.report.discovery_page.pictures import draw_gap_steps
from rsenf.report.discovery_page.steps import gap_words, places_table, summary
from rsenf.report.pages import HEIGHT_IN, Picture, fill, picture_of
from rsenf.report.panels import GRID, MARK, SIGNAL, fixed_style

DIGITS = 7
FEW = 6  # longest list that is printed in full


def model_text(model: CaptureModel) -> str:
    """Return a model as YAML; of long lists only the first values and the length."""
    return yaml.safe_dump(_short(model.to_dict()), sort_keys=False, width=90, allow_unicode=True)


def _short(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _short(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        first = [_short(item) for item in value[:FEW]]
        return first if len(value) <= FEW else [*first[:2], f"… {len(value)} in all"]
    return float(f"{value:.{DIGITS}g}") if isinstance(value, float) else value


def draw_enf_beside(
    figure: Any, beside: AlignedReference, fits: Sequence[tuple[str, LagFit]], noise_hz: float
) -> None:
    """Draw measured and simulated ENF, and their difference below, with a column for each fit.

    Parameters
    ----------
    figure : matplotlib figure
    beside : AlignedReference
    fits : sequence of (str, LagFit)
        Fits with their names.
    noise_hz : float
        Standard deviation of a difference due to noise.
    """
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


WIDTH_IN = 5.2
_GAP = (
    "The gap is what the model gets wrong of the ENF, as a share of the reference's variance. Red "
    "is more than chance makes, blue is not; the bar is the standard error, and a hollow diamond "
    "is a gap below zero, drawn by its size. The shaded range is what recordings have that the "
    "model explains. The scale is logarithmic."
)
_ENF = (
    "Above, the ENF as the recording has it and as the model, filming the reference's grid, says "
    "it would be; below, the one less the other. A clock that is off shifts all of it by a "
    "constant share. The shaded range is twice the standard deviation that noise alone would "
    "make; the grey bars at the foot mark the stretches that nothing was fitted to."
)


def draw_beside(found: ClockOffsetDiscovery) -> list[Picture]:
    """Draw the gap, and the ENF before and after an addition, or once if nothing was added."""
    fits = [("before", found.first), ("after", found.last)]
    if not found.skew:
        fits = [("measured and simulated", found.last)]
    gaps = [found.gap(fit) for _, fit in fits]
    names = ["at first", "+ clock_skew"][: len(fits)]
    gap_text = ", ".join(f"{n} {g.value:.1e}" for n, g in zip(names, gaps, strict=True))
    residual_text = ", ".join(f"{1e3 * np.nanstd(fit.residual_hz):.3g} mHz" for _, fit in fits)
    with fixed_style():
        return [
            picture_of(
                "beside_gap.png", "The gap, step by step",
                lambda f: draw_gap_steps(
                    f.subplots(), names, gaps, found.floor, of="the reference's variance"
                ),
                _GAP, f"Chart of the gap on a logarithmic scale: {gap_text}.",
                width_in=WIDTH_IN, height_in=1.2 + 0.55 * len(names),
            ),
            picture_of(
                "beside_enf.png", "ENF, measured and simulated",
                lambda f: draw_enf_beside(f, found.beside, fits, math.sqrt(found.chance.var_hz2)),
                _ENF, f"ENF over time, and what is left of it, which varies by {residual_text}.",
                width_in=WIDTH_IN, height_in=1.4 * HEIGHT_IN,
            ),
        ]  # fmt: skip


DEFINITIONS = (
    "The capture model films a lamp on the grid that the reference tells of, and the very tracker "
    "that read the recording reads the film: so what is compared has passed the same windows. "
    "Where the reference is itself an average, the recording's ENF is averaged alike.",
    "The lag, and the clock's error where it is added, are fitted to every other stretch of time; "
    "the gap is of the stretches between. It is the mean square of measured less simulated ENF, a "
    "constant offset and all, less what estimates and reference would differ by through their "
    "noise, over the variance of the reference meanwhile; its standard error is that of the mean "
    "over the stretches.",
    "Chance alone is the gap of 60 recordings of the same noise that the last model explains, "
    "fitted alike: their median is the floor, and four of their standard deviations above it is "
    "the limit.",
    "The values given are of a last fit to all stretches; their standard errors are by chance, or "
    "larger where more than that is left.",
)


def beside_page(
    found: ClockOffsetDiscovery, doc: dict[str, Any], recording: str, extended: CaptureModel
) -> str:
    """Return the page of a recording with one mean per frame; its text is deterministic.

    Parameters
    ----------
    found : ClockOffsetDiscovery
    doc : dict
        Of :func:`rsenf.discrepancy.clock_offset.beside_json`.
    recording : str
        Name of the recording.
    extended : CaptureModel
        Of :func:`rsenf.discrepancy.clock_offset.beside_model`.
    """
    clip = found.beside.clip
    return fill(
        Path(__file__).parent / "beside.html.j2",
        draw_beside(found),
        recording=recording,
        verdict=found.verdict,
        facts=(
            f"{clip.duration_s:.0f} s of one mean a frame, at {float(clip.frame_rate):.3f} frames "
            f"a second, beside the reference {found.beside.grid.name}"
        ),
        reference=section(found, doc, first_picture=0),
        model=model_text(extended),
        definitions=DEFINITIONS,
        version=__version__,
    )


def section(found: ClockOffsetDiscovery, doc: dict[str, Any], first_picture: int) -> dict[str, Any]:
    """Return the template's values for the section on a reference.

    Parameters
    ----------
    found : ClockOffsetDiscovery
    doc : dict
        Of :func:`rsenf.discrepancy.clock_offset.beside_json`.
    first_picture : int
        Index of its first picture on the page.
    """
    gap, residual = doc["gap"], doc["unexplained"]
    before, after = (where_beside(found, fit) for fit in (found.first, found.last))
    smaller = gap["after"] / (gap["before"] or 1e-30)
    return {
        "first": first_picture,
        "verdict": found.verdict,
        "headline": headline(found, doc),
        "added": bool(found.skew),
        "about": summary(CATALOGUE["clock_skew"]()),
        "values": _values(found, gap, doc["reference"]),
        "kind": kind_words(residual) if residual else "",
        "would_tell": residual["would_tell"] if residual else [],
        "places": [] if found.verdict == "no_discrepancy" else places_table(before, after, smaller),
    }


def headline(found: ClockOffsetDiscovery, doc: dict[str, Any]) -> str:
    """Return the result against the reference in one sentence; parameters as for ``section``."""
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


def _values(
    found: ClockOffsetDiscovery, gap: dict[str, Any], how: dict[str, Any]
) -> list[tuple[str, str, str]]:
    """Return names, values and explanations."""
    out = []
    if found.skew:
        ppm, error = found.clock
        out.append(("clock_ppm", f"{ppm:+.2f} ± {error:.2g}", "fast above 0; by all the recording"))
    out += [
        ("lag", f"{how['lag_s']:.2f} ± {how['lag_stderr_s']:.2f} s", "from the reference's start"),
        ("reference", how["read_as"], "what its values are taken for"),
        ("gap before", gap_words(found.gap(found.first)), "share of the reference's variance"),
        ("gap after", gap_words(found.gap(found.last)), "on held-out stretches"),
        ("chance", f"{gap['floor']:.1e}, at most {gap['limit']:.1e}", "of data without any gap"),
        ("noise", f"{1e3 * how['estimate_noise_hz']:.2g} and {1e3 * how['reference_noise_hz']:.2g} "
         "mHz", "of a value of the recording, and of the reference"),
    ]  # fmt: skip
    if found.skew:
        evidence = f"{found.skew.nats:.4g} nats"
        out.append(("evidence", evidence, f"on held-out stretches, of {found.tried} ways tried"))
    return out

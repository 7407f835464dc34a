"""The page's pictures, and what is said of each."""

from __future__ import annotations

from typing import Any

import numpy as np

from rsenf.discrepancy.verdict import Discovery
from rsenf.report.discovery_page.steps import names_of
from rsenf.report.pages import HEIGHT_IN, Picture, picture_of
from rsenf.report.panels import fixed_style
from rsenf.report.panels.alias_spectrum import draw_alias_spectrum
from rsenf.report.panels.gap_places import axes_of, draw_gap_places
from rsenf.report.panels.gap_steps import draw_gap_steps
from rsenf.report.panels.row_images import SHOWN_S, draw_row_images, most_left

WIDTH_IN = 5.2
_STEPS = (
    "The gap is the share of the flicker's power that the model gets wrong. Red is more than "
    "chance makes, blue is not; the bar is the standard error, and a hollow diamond is a gap "
    "below zero, drawn by its size. The shaded range is what recordings have that the model itself "
    "has made; the dotted line is their median. The scale is logarithmic: each mark is ten times "
    "the one before."
)
_SPECTRUM = (
    "How much of the flicker's power is left at each frequency. A camera shows a fast light only "
    "at its alias: the frequency less the nearest multiple of the frame rate. The marks at the top "
    "are the flicker's alias (f) and those of its harmonics (2f, 3f). Peaks are what is "
    "systematically left; the even ground is noise, of which only the size is drawn."
)
_PLACES = (
    "The gap of each part of the picture and of the recording by itself. Where all parts are "
    "alike, what is wrong is wrong everywhere; a part that stands out is where to look. Thin bars "
    "are standard errors; pale parts are not sure (less than three of them). The shaded range is "
    "that of a whole gap by chance alone."
)


def draw_pictures(found: Discovery) -> list[Picture]:
    """Draw the story; where nothing was added, there is no before and after."""
    fits = [("before", found.first), ("after", found.last)] if found.steps else [("", found.last)]
    strip = _worst_strip(found)
    begin = most_left(found.first, strip)
    gaps = [found.first.gap, *(s.chosen.fit.gap for s in found.steps if s.chosen)]
    names = ["at first", *("+ " + name.replace(" or ", "\nor ") for name in names_of(found))]
    axes = axes_of(found.before)
    with fixed_style():
        return [
            picture_of(
                "gap.png", "The gap, step by step",
                lambda f: draw_gap_steps(f.subplots(), names, gaps, found.floor),
                _STEPS, _steps_alt(names, [gap.value for gap in gaps]),
                width_in=WIDTH_IN, height_in=1.2 + 0.55 * len(names),
            ),
            picture_of(
                "rows.png", "Measured, simulated and the difference",
                lambda f: draw_row_images(f, fits, strip, begin),
                _images_caption(found, strip), _images_alt(found),
                width_in=WIDTH_IN, height_in=1.35 + 1.45 * len(fits),
            ),
            picture_of(
                "spectrum.png", "What is left, by frequency",
                lambda f: draw_alias_spectrum(f.subplots(), fits),
                _SPECTRUM, "Line chart of what is left against frequency.",
                width_in=WIDTH_IN,
            ),
            picture_of(
                "places.png", "What is left, by place and time",
                lambda f: _draw_places(f, found, axes),
                _PLACES + (" Grey is before, blue is after." if found.steps else ""),
                f"Charts of the gap {', '.join(axes)}.",
                width_in=WIDTH_IN, height_in=0.85 * HEIGHT_IN * ((len(axes) + 1) // 2),
            ),
        ]  # fmt: skip


def _draw_places(figure: Any, found: Discovery, axes: list[str]) -> None:
    sides = [(found.before, found.first.gap.value)] if found.steps else []
    sides += [(found.after, found.last.gap.value)]
    drawn = figure.subplots((len(axes) + 1) // 2, 2, squeeze=False, sharey=True)
    for own, axis in zip(drawn.flat, axes, strict=False):
        draw_gap_places(own, axis, sides, found.floor.limit)
    for own in list(drawn.flat)[len(axes) :]:
        own.axis("off")
    for own in drawn[:, 0]:
        own.set_ylabel("gap")


def _worst_strip(found: Discovery) -> int:
    strips = [share for share in found.before if share.axis == "strip"]
    return int(np.argmax([abs(share.share) for share in strips])) if strips else 0


def _images_caption(found: Discovery, strip: int) -> str:
    data = found.last.data
    where = f", in strip {strip + 1} of {data.strips}" if data.strips > 1 else ""
    own = "Both differences have the same colours"
    if not found.steps:
        own = "The difference has colours of its own"
    return (
        f"The brightness of each of the picture's {data.axis}, from top to bottom, over the "
        f"{SHOWN_S:.0f} held-out seconds in which most was left{where}, with each one's steady "
        "level taken off. The bands are the flicker, which a camera that reads row by row sees "
        f"pass through the picture. {own}, with far fewer levels from blue to red than the "
        "others have from black to white. What has a pattern there is what the model doesn't "
        "explain; what looks like grain is noise."
    )


def _images_alt(found: Discovery) -> str:
    was, now = float(found.first.residual.std()), float(found.last.residual.std())
    after = f", {now:.3g} after" if found.steps else ""
    return (
        "Images of row brightness over time: measured, simulated and the difference, which is "
        f"{was:.3g} levels rms{' before' if found.steps else ''}{after}."
    )


def _steps_alt(names: list[str], gaps: list[float]) -> str:
    told = ", ".join(f"{n.replace(chr(10), ' ')} {g:.1e}" for n, g in zip(names, gaps, strict=True))
    return f"Chart of the gap on a logarithmic scale: {told}."

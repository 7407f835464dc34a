"""The page's pictures, with their captions and alternative texts.

Gap by step of the forward selection, images of rows over frames (measured, simulated, and their
difference), spectrum of the residual (in alias frequency), and the gap of each part of the picture
and of the recording.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsenf.discrepancy.fit import Fit, NoiseFloor
from rsenf.discrepancy.gap import Gap
from rsenf.discrepancy.residual_breakdown import ResidualShare, alias_spectrum, flicker_hz
from rsenf.discrepancy.verdict import Discovery
from rsenf.report import panels
from rsenf.report.values import texts

FAR = 30.0  # the scale begins at the limit divided by this


def _draw_gap_steps(
    axes: Any, names: Sequence[str], gaps: Sequence[Gap], floor: NoiseFloor, of: str
) -> None:
    """Draw the gap after each step, the first on top, with the range of the noise floor."""
    axes.set_title("The gap on held-out data, step by step")
    axes.set_xscale("log")
    axes.minorticks_off()
    lowest = floor.limit / FAR
    axes.axvspan(lowest, floor.limit, color=panels.SIGNAL, alpha=0.12, lw=0)
    axes.axvline(floor.limit, color=panels.SIGNAL, lw=1)
    if floor.median > lowest:
        axes.axvline(floor.median, color=panels.SIGNAL, lw=1, ls=":")
    panels.annotate(
        axes, "chance alone", (lowest, 1.0), (4, -3), panels.SIGNAL, xycoords=panels.ALONG, va="top"
    )
    for n, gap in enumerate(gaps):
        size, away = abs(gap.value), gap.stderr if math.isfinite(gap.stderr) else 0.0
        shown = max(size, 1.15 * lowest)
        colour = panels.MARK if size > floor.limit else panels.SIGNAL
        ends = [max(size - away, lowest), max(size + away, shown)]
        axes.plot(ends, [n, n], color=colour, lw=2, solid_capstyle="butt")
        axes.plot(
            [shown], [n], "o" if gap.value > 0 else "D", color=colour, ms=7,
            mfc=colour if gap.value > 0 else "white",
        )  # fmt: skip
        panels.annotate(axes, f"{gap.value:.1e}", (shown, n), (0, 8), panels.INK, ha="center")
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(len(names) - 0.5, -0.7)
    axes.set_xlim(lowest, 4.0 * max(floor.limit, *(abs(g.value) for g in gaps)))
    axes.tick_params(axis="y", length=0)
    axes.set_xlabel(f"gap, as a share of {of}")


SHOWN_S = 2.0
BANDS = 60  # largest number of bands of rows; means over bands have less noise than rows
FLICKER, LEFT = "gray", "RdBu_r"
BRIGHT = 99.5  # percentile of the values that gets the full colour

Image = NDArray[np.float64]


def _draw_row_images(figure: Any, fits: Sequence[tuple[str, Fit]], strip: int, begin: int) -> None:
    """Draw measurement, simulation and residual of each fit, without the rows' static levels."""
    from matplotlib.ticker import MaxNLocator

    drawn = [_images(fit, strip, begin) for _, fit in fits]
    bright = float(np.percentile(np.abs(drawn[0][1]), BRIGHT)) or 1.0
    far = float(np.percentile(np.abs(drawn[0][2]), BRIGHT)) or 1.0
    data = fits[0][1].data
    rate_hz = float(data.frame_rate)
    extent = (begin / rate_hz, (begin + drawn[0][0].shape[0]) / rate_hz, data.lines, 0)
    axes = figure.subplots(len(fits), 3, sharex=True, sharey=True, squeeze=False)
    titles = ("measured", "simulated", "difference")
    for row, (name, _), images in zip(axes, fits, drawn, strict=True):
        for ax, image, (colours, most) in zip(
            row, images, ((FLICKER, bright), (FLICKER, bright), (LEFT, far)), strict=True
        ):
            ax.imshow(
                image.T, aspect="auto", interpolation="nearest", cmap=colours,
                vmin=-most, vmax=most, extent=extent,
            )  # fmt: skip
        row[0].set_ylabel(f"{name}\n{data.axis}" if name else data.axis, color=panels.INK)
    for ax, title in zip(axes[0], titles, strict=True):
        ax.set_title(title)
    for ax in axes[-1]:
        ax.set_xlabel("time (s)")
    for columns, aspect in ((slice(0, 2), 40), (slice(2, 3), 20)):
        group = list(axes[:, columns].flat)
        figure.colorbar(
            group[0].images[0], ax=group, label="levels", orientation="horizontal", fraction=0.06,
            aspect=aspect, ticks=MaxNLocator(2 if aspect == 20 else 5),
        )  # fmt: skip


def most_left(fit: Fit, strip: int) -> int:
    """Return the first frame of the held-out block with the largest residual."""
    data, held = fit.data, ~fit.data.training
    power = (fit.residual[:, :, strip] ** 2).mean(axis=1, dtype=np.float64)
    blocks = np.unique(data.block[held])
    whole = [b for b in blocks if (data.block == b).sum() >= SHOWN_S * float(data.frame_rate)]
    worst = max(whole or blocks, key=lambda b: power[data.block == b].mean())
    return int(np.argmax(data.block == worst))


def _images(fit: Fit, strip: int, begin: int) -> tuple[Image, Image, Image]:
    frames = slice(begin, begin + round(SHOWN_S * float(fit.data.frame_rate)))
    wall = fit.forward.wall[:, strip]
    edges = np.unique(np.linspace(0, wall.size, BANDS + 1).astype(int))[:-1]
    size = np.diff([*edges, wall.size])
    measured, simulated = (
        np.add.reduceat(level[frames, :, strip] - wall, edges, axis=1) / size
        for level in (fit.data.level, fit.rows)
    )
    return measured, simulated, measured - simulated


AXES = {
    "row": ("by row", "row, from the top"),
    "time_s": ("by time", "time in the recording (s)"),
    "level": ("by level", "level of the wall"),
    "strip": ("by strip", "strip, from the left"),
}
SURE = 3.0  # standard errors above which a part is drawn in full colour


def _draw_gap_places(
    axes: Any, axis: str, sides: Sequence[tuple[Sequence[ResidualShare], float]], limit: float
) -> None:
    """Draw the gap of each part along an axis with its standard error, before and after."""
    title, label = AXES[axis]
    axes.set_title(title)
    axes.set_yscale("log")
    axes.minorticks_off()
    lowest = limit / FAR
    axes.axhspan(lowest, limit, color=panels.SIGNAL, alpha=0.12, lw=0)
    for (shares, whole), colour, width in zip(
        reversed(sides), (panels.SIGNAL, panels.GRID), (3.0, 7.0), strict=False
    ):
        parts = [share for share in shares if share.axis == axis]
        for share in parts:
            # Parts are of equal size: the gap of one is its share times their number.
            value = max(abs(share.share * whole) * len(parts), 1.1 * lowest)
            error = value / max(abs(share.sure), 1e-9)
            look = {"color": colour, "alpha": 1.0 if abs(share.sure) > SURE else 0.4}
            look |= {"zorder": 2.0 if colour == panels.GRID else 3.0}
            axes.hlines(value, share.low, share.high, lw=width, **look)
            middle = (share.low + share.high) / 2.0
            axes.vlines(middle, max(value - error, lowest), value + error, lw=1, **look)
        axes.set_xlim(parts[0].low, parts[-1].high)
    axes.set_ylim(bottom=lowest)
    axes.set_xlabel(label)
    if axis == "strip":
        axes.set_xticks([share.low + 0.5 for share in parts], [f"{s.low + 1:.0f}" for s in parts])


WIDTH_PX = 500  # resolution of the picture; finer frequencies are reduced to their maximum
MULTIPLES = 3  # harmonics of the flicker that are marked


def _draw_alias_spectrum(axes: Any, fits: Sequence[tuple[str, Fit]]) -> None:
    """Draw the spectrum of the residual of fits, by alias frequency."""
    axes.set_title("What is left, by frequency")
    axes.set_yscale("log")
    axes.minorticks_off()
    floors, tops = [], []
    looks = ((panels.SIGNAL, 1.0, 3.0), (panels.GRID, 2.2, 2.0))
    for (name, fit), (colour, width, above) in zip(reversed(fits), looks, strict=False):
        freq_hz, power = alias_spectrum(fit)
        floor = float(np.median(np.abs(power))) or 1e-30
        # The power of noise alone is as often negative: smaller values are set to the median size.
        shown = panels.extremes(np.maximum(power, floor), WIDTH_PX)[1]
        at_hz = panels.extremes(freq_hz, WIDTH_PX)[0]
        axes.plot(at_hz, shown, color=colour, lw=width, label=name, zorder=above)
        floors.append(floor)
        tops.append(float(shown.max()))
    axes.set_ylim(min(floors) / 2.0, max(tops) * 30.0)
    for n, (alias_hz, _) in enumerate(flicker_hz(fits[0][1], range(1, MULTIPLES + 1)), 1):
        axes.axvline(alias_hz, 0.78, 1.0, color=panels.INK, lw=1)
        name = "flicker" if n == 1 else f"{n}f"
        # Aliases may be close together: labels go to either side, one below the other.
        side, ha = (-3, "right") if n % 2 == 0 and alias_hz > 1.0 else (3, "left")
        at = (alias_hz, 1.05 - 0.07 * n)
        panels.annotate(
            axes, name, at, (side, 0), panels.INK, xycoords=panels.ALONG, va="top", ha=ha
        )
    axes.set_xlim(0.0, float(fits[0][1].data.frame_rate) / 2.0)
    axes.set_xlabel("frequency, as an alias between 0 and half the frame rate (Hz)")
    axes.set_ylabel("share of the flicker's power")
    if len(fits) > 1:
        axes.legend(
            frameon=False, fontsize="small", loc="upper right", ncols=2, reverse=True,
            bbox_to_anchor=(1.0, 1.14),
        )  # fmt: skip


WIDTH_IN = 5.2


def gap_picture(
    file: str, names: Sequence[str], gaps: Sequence[Gap], floor: NoiseFloor, caption: str, of: str
) -> panels.Panel:
    """Draw the gap after each step; ``of``: what it is a share of."""
    steps = zip(names, gaps, strict=True)
    text = ", ".join(f"{name.replace(chr(10), ' ')} {gap.value:.1e}" for name, gap in steps)
    return panels.picture_of(
        file, "The gap, step by step",
        lambda f: _draw_gap_steps(f.subplots(), names, gaps, floor, of),
        caption, f"Chart of the gap on a logarithmic scale: {text}.",
        width_in=WIDTH_IN, height_in=1.2 + 0.55 * len(names),
    )  # fmt: skip


def names_of(found: Discovery) -> list[str]:
    """Return the name of the effect, or class of effects, that each step added."""
    return [" or ".join(step.equivalents) for step in found.steps]


def draw_pictures(found: Discovery) -> list[panels.Panel]:
    """Draw all pictures; before and after only if an effect was added."""
    fits = [("before", found.first), ("after", found.last)] if found.steps else [("", found.last)]
    strips = [abs(share.share) for share in found.before if share.axis == "strip"]
    strip = int(np.argmax(strips)) if strips else 0  # that with the largest gap
    begin = most_left(found.first, strip)
    gaps = [found.first.gap, *(s.chosen.fit.gap for s in found.steps if s.chosen)]
    names = ["at first", *("+ " + name.replace(" or ", "\nor ") for name in names_of(found))]
    parts = Counter(share.axis for share in found.before)
    axes = [axis for axis in AXES if parts[axis] > 1]
    captions = texts("discovery")["captions"]
    with panels.fixed_style():
        return [
            gap_picture(
                "gap.png", names, gaps, found.floor, captions["gap"], "the flicker's power"
            ),
            panels.picture_of(
                "rows.png", "Measured, simulated and the difference",
                lambda f: _draw_row_images(f, fits, strip, begin),
                _images_caption(found, strip), _images_alt(found),
                width_in=WIDTH_IN, height_in=1.35 + 1.45 * len(fits),
            ),
            panels.picture_of(
                "spectrum.png", "What is left, by frequency",
                lambda f: _draw_alias_spectrum(f.subplots(), fits),
                captions["spectrum"], "Line chart of what is left against frequency.",
                width_in=WIDTH_IN,
            ),
            panels.picture_of(
                "places.png", "What is left, by place and time",
                lambda f: _draw_places(f, found, axes),
                captions["places"] + (" Grey is before, blue is after." if found.steps else ""),
                f"Charts of the gap {', '.join(axes)}.",
                width_in=WIDTH_IN, height_in=0.85 * panels.HEIGHT_IN * ((len(axes) + 1) // 2),
            ),
        ]  # fmt: skip


def _draw_places(figure: Any, found: Discovery, axes: list[str]) -> None:
    sides = [(found.before, found.first.gap.value)] if found.steps else []
    sides += [(found.after, found.last.gap.value)]
    drawn = figure.subplots((len(axes) + 1) // 2, 2, squeeze=False, sharey=True)
    for ax, axis in zip(drawn.flat, axes, strict=False):
        _draw_gap_places(ax, axis, sides, found.floor.limit)
    for ax in list(drawn.flat)[len(axes) :]:
        ax.axis("off")
    for ax in drawn[:, 0]:
        ax.set_ylabel("gap")


def _images_caption(found: Discovery, strip: int) -> str:
    data = found.last.data
    where = f", in strip {strip + 1} of {data.strips}" if data.strips > 1 else ""
    colours = "Both differences have the same colours"
    if not found.steps:
        colours = "The difference has colours of its own"
    return str(texts("discovery")["captions"]["images"]).format(
        axis=data.axis, seconds=SHOWN_S, where=where, colours=colours
    )


def _images_alt(found: Discovery) -> str:
    was, now = float(found.first.residual.std()), float(found.last.residual.std())
    after = f", {now:.3g} after" if found.steps else ""
    return (
        "Images of row brightness over time: measured, simulated and the difference, which is "
        f"{was:.3g} levels rms{' before' if found.steps else ''}{after}."
    )

"""Images of rows over frames: measured, simulated, and their difference."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsenf.discrepancy.fit import Fit
from rsenf.report.panels import INK

SHOWN_S = 2.0
BANDS = 60  # largest number of bands of rows; means over bands have less noise than rows
FLICKER, LEFT = "gray", "RdBu_r"
BRIGHT = 99.5  # percentile of the values that gets the full colour

Image = NDArray[np.float64]


def draw_row_images(figure: Any, fits: Sequence[tuple[str, Fit]], strip: int, begin: int) -> None:
    """Draw measurement, simulation and residual of each fit, without the rows' static levels.

    Parameters
    ----------
    figure : matplotlib figure
    fits : sequence of (str, Fit)
        Fits with their names.
    strip : int
        Index of the strip.
    begin : int
        First frame.
    """
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
        row[0].set_ylabel(f"{name}\n{data.axis}" if name else data.axis, color=INK)
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
    """Return the first frame of the held-out block with the largest residual.

    Parameters
    ----------
    fit : Fit
    strip : int
        Index of the strip.
    """
    data, held = fit.data, ~fit.data.training
    power = (fit.residual[:, :, strip] ** 2).mean(axis=1, dtype=np.float64)
    blocks = np.unique(data.block[held])
    whole = [b for b in blocks if (data.block == b).sum() >= SHOWN_S * float(data.frame_rate)]
    worst = max(whole or blocks, key=lambda b: power[data.block == b].mean())
    return int(np.argmax(data.block == worst))


def _images(fit: Fit, strip: int, begin: int) -> tuple[Image, Image, Image]:
    frames = slice(begin, begin + round(SHOWN_S * float(fit.data.frame_rate)))
    wall = fit.theory.wall[:, strip]
    edges = np.unique(np.linspace(0, wall.size, BANDS + 1).astype(int))[:-1]
    size = np.diff([*edges, wall.size])
    measured, simulated = (
        np.add.reduceat(level[frames, :, strip] - wall, edges, axis=1) / size
        for level in (fit.data.level, fit.rows)
    )
    return measured, simulated, measured - simulated

"""A picture of a page: PNG with title, caption and alternative text."""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from rsenf.report.panels import new_figure

WIDTH_IN, HEIGHT_IN, DPI = 6.4, 3.0, 175


@dataclass(frozen=True, kw_only=True)
class Picture:
    """A picture with its texts."""

    file: str
    title: str
    caption: str
    alt: str
    png: bytes
    width_px: int
    height_px: int


def picture_of(
    file: str,
    title: str,
    draw: Callable[[Any], None],
    caption: str,
    alt: str,
    *,
    width_in: float = WIDTH_IN,
    height_in: float = HEIGHT_IN,
) -> Picture:
    """Draw a picture; to be called within :func:`rsenf.report.panels.fixed_style`.

    Parameters
    ----------
    file, title, caption, alt : str
    draw : callable
        Draws onto the figure given.
    width_in, height_in : float, optional
        Size in inches. Text is 10 points high: the narrower the picture, the larger on a phone.
    """
    figure = new_figure(width_in, height_in)
    draw(figure)
    held = io.BytesIO()
    # Without matplotlib's version in the file, which the page lists elsewhere.
    figure.savefig(held, format="png", dpi=DPI, metadata={"Software": None})
    return Picture(
        file=file, title=title, caption=caption, alt=alt, png=held.getvalue(),
        width_px=round(width_in * DPI), height_px=round(height_in * DPI),
    )  # fmt: skip

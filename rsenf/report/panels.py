"""Pictures of reports: their style, a picture with its texts, and what plots have in common."""

from __future__ import annotations

import io
import logging
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

# Each has a contrast ratio of at least 3 to white, and they differ in lightness, not only in hue.
INK, SIGNAL, GRID, MARK, CLAIM = "#222222", "#0b62a4", "#868686", "#c23b22", "#6a3d9a"
STYLE = {
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlesize": "medium",
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.grid": False,
    "date.epoch": "1970-01-01T00:00:00",
    "font.family": "DejaVu Sans",
    "timezone": "UTC",
}


@contextmanager
def fixed_style() -> Iterator[None]:
    """Use a fixed style, whatever the user's matplotlib settings."""
    # Suppresses messages on matplotlib's font cache.
    logging.getLogger("matplotlib").setLevel(logging.ERROR)
    import matplotlib

    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(STYLE)
        yield


def new_figure(width_in: float, height_in: float) -> Any:
    """Return an empty figure; to be called within :func:`fixed_style`."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_in, height_in), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


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
    """Draw a picture; to be called within :func:`fixed_style`.

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


ALONG = ("data", "axes fraction")  # coordinates: along the x axis, and up the height of the plot


def annotate(
    axes: Any, text: str, at: Any, offset: tuple[int, int], colour: str, **look: Any
) -> None:
    """Write beside a place of a plot, in small letters; ``offset``: in points."""
    axes.annotate(
        text, at, offset, textcoords="offset points", color=colour, fontsize="small", **look
    )  # fmt: skip


def say_nothing(axes: Any, text: str) -> None:
    """Write on the axes why there is no plot."""
    axes.text(0.5, 0.5, text, ha="center", va="center", wrap=True, transform=axes.transAxes,
              color=INK)  # fmt: skip
    axes.set_xticks([])
    axes.set_yticks([])


def extremes(
    values: NDArray[np.float64], most: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return minimum and maximum over at most ``most`` bins of consecutive rows.

    NaN where all values of a bin are.
    """
    each = max(math.ceil(len(values) / most), 1)
    edges = np.arange(0, len(values), each)
    return np.fmin.reduceat(values, edges, axis=0), np.fmax.reduceat(values, edges, axis=0)

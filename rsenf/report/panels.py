"""Pictures of reports: their style, a picture with its texts, what plots have in common.

At the end those of ``rsenf tables``, which no report has: the idle tables, and the strongest line.
"""

from __future__ import annotations

import io
import itertools
import logging
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsenf.whole_file import whole_file

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


def save(figure: Any, path: Path) -> None:
    """Write a figure to a PNG file, which appears only once it is complete."""
    with whole_file(path) as temporary:
        figure.savefig(temporary, format="png", dpi=110)


WIDTH_IN, HEIGHT_IN, DPI = 6.4, 3.0, 175


@dataclass(frozen=True, kw_only=True)
class Panel:
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
) -> Panel:
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
    figure.set_dpi(DPI)
    draw(figure)
    # Laid out here, savefig needn't draw it all a first time for the layout alone.
    figure.get_layout_engine().execute(figure)
    figure.set_layout_engine("none")
    held = io.BytesIO()
    # Without matplotlib's version in the file, which the page lists elsewhere.
    figure.savefig(held, format="png", dpi=DPI, metadata={"Software": None})
    return Panel(
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


LINE_COLOURS = ("#0b62a4", "#c77700", "#2c8a4b", "#8a3b8f", "#5b5b5b")
BAND = "its range over the light's phase"
TOP_RATIO = 4000.0  # infinite ratios are drawn here
TOP_HZ = 135.0


def draw_idle_tables(path: Path, document: dict[str, Any]) -> None:
    """Draw the ratio of the two strongest lines against the idle period, and the printed values."""
    figure, panels = _figure(len(document["tables"]), 1, (13, 5.4))
    wrong = {
        (entry["frame_rate_hz"], entry["idle_percent"])
        for erratum in document["errata"]
        if erratum["name"] != "second_harmonic"  # that one is about another waveform
        for entry in erratum["entries"]
    }
    for axes, table in zip(panels[0], document["tables"], strict=True):
        _draw_ratio(axes, table, wrong)
    panels[0][0].set_ylabel("strongest line over the second, amplitudes")
    _legend(figure, panels[0][1])
    save(figure, path)


def draw_strongest(path: Path, document: dict[str, Any]) -> None:
    """Draw frequency and amplitude of the strongest line against the idle period."""
    figures = document["figures"]
    figure, panels = _figure(len(figures), 2, (16, 7.6))
    for n, part in enumerate(figures):
        _draw_frequency(panels[0][n], part)
        _draw_amplitude(panels[1][n], part["points"])
    panels[0][0].set_ylabel("strongest line (Hz)")
    panels[1][0].set_ylabel("its amplitude (harmonic 1 of the light = 1)")
    _legend(figure, panels[1][1])
    save(figure, path)


def _figure(columns: int, rows: int, size: tuple[float, float]) -> tuple[Any, Any]:
    figure = new_figure(*size)
    panels = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey="row")
    for axes in panels[-1]:
        axes.set_xlabel("idle period (% of the frame period)")
        axes.set_xlim(-3, 100)
        axes.set_xticks(range(0, 100, 15))
    return figure, panels


def _legend(figure: Any, axes: Any) -> None:
    """Add the legend of one panel below all of them."""
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), frameon=False)


def _title(axes: Any, part: dict[str, Any]) -> None:
    text = f"{part['frame_rate_hz']:g} fps on a {part['nominal_hz']:g} Hz grid"
    axes.set_title(text, loc="left", color=INK)
    axes.grid(color="#e6e6e6", lw=0.7)
    axes.set_axisbelow(True)


def _draw_ratio(axes: Any, table: dict[str, Any], wrong: set[tuple[float, int]]) -> None:
    _title(axes, table)
    idle = [row["idle_percent"] for row in table["rows"]]
    ratio = [_shown(row["amplitude_ratio"]) for row in table["rows"]]
    low, high = (
        [_shown((row["amplitude_ratio_range"] or [row["amplitude_ratio"]] * 2)[end])
         for row in table["rows"]]
        for end in (0, 1)
    )  # fmt: skip
    axes.plot(idle, ratio, color=SIGNAL, lw=1.2, label="model")
    axes.fill_between(idle, low, high, color=SIGNAL, alpha=0.2, lw=0, label=BAND)
    for right, colour, label in ((True, INK, "printed"), (False, MARK, "printed, an erratum")):
        rows = [
            row for row in table["printed"]
            if ((table["frame_rate_hz"], row["idle_percent"]) not in wrong) == right
        ]  # fmt: skip
        axes.plot(
            [row["idle_percent"] for row in rows],
            [_shown(row["amplitude_ratio"]) for row in rows],
            "o", color=colour, ms=5, mfc="none", label=label,
        )  # fmt: skip
    axes.set_yscale("log")
    axes.set_ylim(0.8, TOP_RATIO * 1.3)
    axes.set_yticks([1, 2, 5, 10, 100, 1000, TOP_RATIO], ["1", "2", "5", "10", "100", "1000", "∞"])


def _shown(ratio: float | None) -> float:
    """Return the ratio as drawn: infinity at the top of the picture."""
    return TOP_RATIO if ratio is None else min(ratio, TOP_RATIO)


def _draw_frequency(axes: Any, part: dict[str, Any]) -> None:
    _title(axes, part)
    for colour, points in _by_line(part["points"]):
        idle = [point["idle_percent"] for point in points]
        hz = points[0]["model_hz"]
        axes.plot([idle[0] - 0.5, idle[-1] + 0.5], [hz, hz], color=colour, lw=5, alpha=0.35)
        axes.annotate(
            f"{hz:.4g} Hz", ((idle[0] + idle[-1]) / 2, hz), (0, 7),
            textcoords="offset points", ha="center", color=colour,
        )  # fmt: skip
    _dots(axes, part["points"], "simulated_hz")
    axes.set_ylim(0, TOP_HZ)


def _draw_amplitude(axes: Any, points: Sequence[dict[str, Any]]) -> None:
    axes.grid(color="#e6e6e6", lw=0.7)
    axes.set_axisbelow(True)
    for colour, run in _by_line(points):
        first = run[0] is points[0]
        idle = [point["idle_percent"] for point in run]
        low, high = ([point["model_amplitude_range"][end] for point in run] for end in (0, 1))
        size = [point["model_amplitude"] for point in run]
        axes.plot(idle, size, color=colour, lw=1.4, label="model" if first else None)
        axes.fill_between(idle, low, high, color=colour, alpha=0.2, lw=0,
                          label=BAND if first else None)  # fmt: skip
    _dots(axes, points, "simulated_amplitude")
    axes.set_ylim(0, 1.15)


def _dots(axes: Any, points: Sequence[dict[str, Any]], key: str) -> None:
    axes.plot(
        [point["idle_percent"] for point in points], [point[key] for point in points],
        "o", color=INK, ms=2.2, label="simulation, each with a phase of its own",
    )  # fmt: skip


def _by_line(points: Sequence[dict[str, Any]]) -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """Split the points where the model's strongest line changes; yield a colour for each run."""
    runs = itertools.groupby(points, key=lambda point: point["model_hz"])
    for n, (_, run) in enumerate(runs):
        yield LINE_COLOURS[n % len(LINE_COLOURS)], list(run)

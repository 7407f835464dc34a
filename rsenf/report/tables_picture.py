"""Pictures of the document of ``rsenf tables``: the idle tables, and the strongest line."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from rsenf.report.panels import new_figure
from rsenf.whole_file import whole_file

INK, MODEL, MARK = "#222222", "#0b62a4", "#c23b22"
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
    _save(figure, path)


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
    _save(figure, path)


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


def _save(figure: Any, path: Path) -> None:
    with whole_file(path) as temporary:
        figure.savefig(temporary, format="png", dpi=110)


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
    axes.plot(idle, ratio, color=MODEL, lw=1.2, label="model")
    axes.fill_between(idle, low, high, color=MODEL, alpha=0.2, lw=0, label=BAND)
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

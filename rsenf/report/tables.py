"""The paper's idle tables, its figure of the strongest line, and its errata, as plain values."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from rsenf.model.analytic import COSINE, RECTIFIED
from rsenf.model.analytic_errata import Erratum, errata
from rsenf.model.analytic_figure import CASES, DURATION_S, ROWS, Point, strongest_against_idle
from rsenf.model.analytic_tables import (
    AS_PUBLISHED,
    PUBLISHED_TABLES,
    Entry,
    Reading,
    idle_table,
    printed_table,
)

STEP_PERCENT, FINE_STEP_PERCENT = 5, 1  # step of idle periods in text, and in pictures


def tables_document(
    *,
    as_published: bool = False,
    light: str = "cosine",
    step_percent: int = STEP_PERCENT,
    progress: Callable[[float], None] = lambda simulated_s: None,
) -> dict[str, Any]:
    """Return the paper's tables and figures, and its errata, as plain values.

    Parameters
    ----------
    as_published : bool
        Whether to compute the paper's printed numbers instead of the corrected ones.
    light : {'cosine', 'rectified'}
        Waveform of the light in the tables; the figures always use ``rectified``, |cos|.
    step_percent : int
        Step of the idle period, in per cent of the frame period.
    progress : callable, optional
        Called with the number of seconds simulated, of :func:`simulated_s` in total.
    """
    percents = _percents(step_percent)
    if as_published:
        tabulate, reading, figure_reading = printed_table, AS_PUBLISHED, AS_PUBLISHED
    else:
        tabulate, figure_reading = idle_table, Reading(harmonics=RECTIFIED, rows=ROWS)
        reading = Reading(harmonics=COSINE if light == "cosine" else RECTIFIED)
    return {
        "as_published": as_published,
        "light": light,
        "tables": [
            {
                "frame_rate_hz": table.frame_rate_hz,
                "nominal_hz": table.nominal_hz,
                "rows": [
                    _row(entry)
                    for entry in tabulate(table.frame_rate_hz, table.nominal_hz, reading, percents)
                ],
                "printed": [_row(entry) for entry in table.entries],
            }
            for table in PUBLISHED_TABLES
        ],
        "figures": _figures(figure_reading, percents, progress),
        "errata": [_erratum(erratum) for erratum in errata()],
    }


def _figures(
    reading: Reading, percents: range, progress: Callable[[float], None]
) -> list[dict[str, Any]]:
    """Simulate all cases of the figure."""
    figures: list[dict[str, Any]] = []
    for frame_rate, nominal_hz in CASES:
        points = []
        for point in strongest_against_idle(frame_rate, nominal_hz, reading, percents):
            points.append(_point(point))
            progress((len(figures) * len(percents) + len(points)) * DURATION_S)
        figures.append(
            {"frame_rate_hz": float(frame_rate), "nominal_hz": nominal_hz, "points": points}
        )
    return figures


def thinned(document: dict[str, Any]) -> dict[str, Any]:
    """Return a document reduced to the idle periods that are printed, in steps of 5 %."""

    def thin(parts: list[dict[str, Any]], key: str) -> list[dict[str, Any]]:
        return [
            part | {key: [r for r in part[key] if r["idle_percent"] % STEP_PERCENT == 0]}
            for part in parts
        ]

    tables, figures = document["tables"], document["figures"]
    return document | {"tables": thin(tables, "rows"), "figures": thin(figures, "points")}


def _row(entry: Entry) -> dict[str, Any]:
    spread = entry.ratio_range
    return {
        "idle_percent": entry.idle_percent,
        "h1_hz": _one_or_list(entry.h1_hz),
        "h2_hz": _one_or_list(entry.h2_hz),
        "amplitude_ratio": entry.amplitude_ratio,
        "amplitude_ratio_range": spread and [r if math.isfinite(r) else None for r in spread],
    }


def _one_or_list(freq_hz: tuple[float, ...]) -> float | list[float] | None:
    """Return a number; a list if lines tie; None without a line."""
    rounded = [round(hz, 6) for hz in freq_hz]
    return rounded if len(rounded) > 1 else rounded[0] if rounded else None


def _point(point: Point) -> dict[str, Any]:
    low, high = point.model.amplitude_range()
    return {
        "idle_percent": point.idle_percent,
        "model_hz": round(point.model.freq_hz, 6),
        "model_amplitude": point.model.amplitude,
        "model_amplitude_range": [low, high],
        "light_phase_rad": point.phase_rad,
        "model_at_phase_hz": round(point.model_there.freq_hz, 6),
        "model_at_phase_amplitude": point.model_there.amplitude,
        "simulated_hz": point.simulated.freq_hz,
        "simulated_amplitude": point.simulated.amplitude,
    }


def _erratum(erratum: Erratum) -> dict[str, Any]:
    return {
        "name": erratum.name,
        "where": erratum.where,
        "published": erratum.published,
        "right": erratum.right,
        "entries": [
            {
                "frame_rate_hz": difference.frame_rate_hz,
                "nominal_hz": difference.nominal_hz,
                "idle_percent": difference.published.idle_percent,
                "published": _row(difference.published),
                "right": _row(difference.right),
            }
            for difference in erratum.entries
        ],
    }


def _percents(step_percent: int) -> range:
    return range(0, 96, step_percent)


def simulated_s(step_percent: int) -> float:
    """Return how many seconds :func:`tables_document` simulates."""
    return len(CASES) * len(_percents(step_percent)) * DURATION_S

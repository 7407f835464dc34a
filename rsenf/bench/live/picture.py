"""False alarms against delay, as the limit is moved: of the verdict and of the correlation."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

from rsenf.whole_file import whole_file

_SHOWN = {
    "nats": ("the verdict, by its limit in nats", "#0b62a4", "o"),
    "correlation": ("sliding correlation, by its limit", "#c23b22", "s"),
}


def draw(path: Path, document: dict[str, Any]) -> None:
    """Draw the trade-off into a PNG file; the upper bound stands for no false alarm at all.

    Raises
    ------
    RecordingError
        When the file can't be written.
    """
    logging.getLogger("matplotlib").setLevel(logging.ERROR)
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 5), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    for name, (label, colour, marker) in _SHOWN.items():
        rows = [r for r in document["trade_off"][name] if r["delay_median_s"] is not None]
        delay = [r["delay_median_s"] for r in rows]
        shown = [r["per_hour"] or r["bound_per_hour"] for r in rows]
        axes.plot(delay, shown, color=colour, linewidth=1, label=label)
        for row, x, y in zip(rows, delay, shown, strict=True):
            some = row["false"] > 0
            axes.plot(x, y, marker if some else "v", color=colour, mfc=colour if some else "none")
            note = f"{row['limit']:g} ({row['found']}/{row['attacks']})"
            axes.annotate(note, (x, y), (4, 4), textcoords="offset points", fontsize="x-small")
    axes.set_yscale("log")
    axes.set_xlabel("median delay of the attacks found (s)")
    axes.set_ylabel("false alarms an hour (open: below, 95 %)")
    axes.set_title(f"{document['feeds']} feeds; limit (attacks found)", loc="left")
    axes.legend(frameon=False)
    with whole_file(path) as temporary:
        figure.savefig(temporary, format="png", dpi=110)

"""Reliability in a picture: of the cases given some ratio, the share in which it was so."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

from rsenf.whole_file import whole_file

_COLOURS = {"other": "#0b62a4", "absent": "#c23b22", "claim": "#3a7d44"}
_SAID = {
    "other": "this time or another in the reference",
    "absent": "this time or one outside the reference",
    "claim": "a claimed time or another",
}


def draw(path: Path, document: dict[str, Any]) -> None:
    """Draw the shares said and come into a PNG file.

    Raises
    ------
    RecordingError
        When the file can't be written.
    """
    logging.getLogger("matplotlib").setLevel(logging.ERROR)
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 6), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    axes.plot([0, 1], [0, 1], color="#9a9a9a", linewidth=1, zorder=0)
    for found in document["questions"]:
        rows = found["rows"]
        said, came = [r["said"] for r in rows], [r["came"] for r in rows]
        low, high = [r["low"] for r in rows], [r["high"] for r in rows]
        below = [max(c - a, 0.0) for c, a in zip(came, low, strict=True)]
        above = [max(b - c, 0.0) for c, b in zip(came, high, strict=True)]
        axes.errorbar(
            said, came, yerr=[below, above], fmt="o", capsize=3,
            color=_COLOURS[found["question"]], label=_SAID[found["question"]],
        )  # fmt: skip
    axes.set_xlabel("share of cases that the likelihood ratios mean")
    axes.set_ylabel("share that came, with its 95 % interval")
    axes.set_title(f"{document['searches']} searches", loc="left")
    axes.legend(loc="upper left", frameon=False)
    with whole_file(path) as temporary:
        figure.savefig(temporary, format="png", dpi=110)

"""What was hidden against what was named: a picture of the confusions."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

import numpy as np

from rsenf.whole_file import whole_file


def draw(path: Path, document: dict[str, Any]) -> None:
    """Draw the counts into a PNG file.

    Raises
    ------
    RecordingError
        When the file can't be written.
    """
    logging.getLogger("matplotlib").setLevel(logging.ERROR)
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    counts = document["named"]
    hidden = sorted(counts)
    said = sorted({name for told in counts.values() for name in told})
    table = np.array([[counts[h].get(s, 0) for s in said] for h in hidden], float)
    size = (2.5 + 0.42 * len(said), 2.5 + 0.32 * len(hidden))
    figure = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    share = table / np.maximum(table.sum(axis=1, keepdims=True), 1.0)
    axes.imshow(share, cmap="Blues", vmin=0.0, vmax=1.0, aspect="auto")
    for row, column in zip(*np.nonzero(table), strict=True):
        dark = share[row, column] > 0.5
        axes.text(
            column, row, f"{table[row, column]:.0f}", ha="center", va="center",
            color="white" if dark else "black", fontsize="small",
        )  # fmt: skip
    axes.set_xticks(range(len(said)), said, rotation=60, ha="right", fontsize="small")
    axes.set_yticks(range(len(hidden)), hidden, fontsize="small")
    axes.set_xlabel("named")
    axes.set_ylabel("hidden")
    with whole_file(path) as temporary:
        figure.savefig(temporary, format="png", dpi=110)

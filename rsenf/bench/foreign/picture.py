"""Errors over stated standard errors in every cell: a picture with a panel for each method."""

from __future__ import annotations

import logging
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from rsenf.whole_file import whole_file

LEAST_Z, MOST_Z = 0.1, 10.0


def draw(path: Path, document: dict[str, Any]) -> None:
    """Draw z of the first ENF and the first idle method into a PNG file.

    Rows are kinds and codings, columns frame rates and grids; white is honest, red too sure, blue
    too modest; a dash stands where nothing was said, and a cross for a false claim.

    Raises
    ------
    RecordingError
        When the file can't be written.
    """
    logging.getLogger("matplotlib").setLevel(logging.ERROR)
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    rows = document["rows"]
    first = {of: next((r["method"] for r in rows if r["of"] == of), "") for of in ("enf", "idle")}
    shown = {of: method for of, method in first.items() if method}
    kinds = list(dict.fromkeys((r["kind"], r["coding"]) for r in rows))
    places = sorted(
        {(r["frame_rate"], r["nominal_hz"]) for r in rows}, key=lambda p: (p[1], Fraction(p[0]))
    )
    size = (2.5 + 0.42 * len(places) * max(len(shown), 1), 2.0 + 0.26 * len(kinds))
    figure = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(1, max(len(shown), 1), sharey=True, squeeze=False)[0]
    for axes, (of, method) in zip(panels, shown.items(), strict=False):
        square, count = np.zeros((len(kinds), len(places))), np.zeros((len(kinds), len(places)))
        for row in rows:
            if (row["of"], row["method"]) != (of, method):
                continue
            at = (
                kinds.index((row["kind"], row["coding"])),
                places.index((row["frame_rate"], row["nominal_hz"])),
            )
            if row["z"] is not None:
                square[at] += row["z"] ** 2
                count[at] += 1
            else:
                mark = "×" if row["false_claims"] else "–"
                axes.text(at[1], at[0], mark, ha="center", va="center", color="#c23b22")
        z = np.sqrt(np.divide(square, count, out=np.full_like(square, np.nan), where=count > 0))
        axes.set_facecolor("#d8d8d8")
        image = axes.imshow(
            np.log10(np.clip(z, LEAST_Z, MOST_Z)), cmap="RdBu_r", vmin=np.log10(LEAST_Z),
            vmax=np.log10(MOST_Z), aspect="auto",
        )  # fmt: skip
        for at_row, at_column in zip(*np.nonzero(z > MOST_Z), strict=True):
            axes.text(
                at_column, at_row, f"{z[at_row, at_column]:.0f}", ha="center", va="center",
                color="white", fontsize="x-small",
            )  # fmt: skip
        axes.set_title(f"{of}, {method}", loc="left", fontsize="medium")
        names = [f"{rate} fps, {hz:g} Hz" for rate, hz in places]
        axes.set_xticks(range(len(places)), names, rotation=70, ha="right", fontsize="x-small")
        labels = [kind if coding == "raw" else f"{kind}, {coding}" for kind, coding in kinds]
        axes.set_yticks(range(len(kinds)), labels, fontsize="x-small")
    if shown:
        bar = figure.colorbar(image, ax=panels.tolist(), label="rms of errors over stated errors")
        ticks = [0.1, 0.3, 0.6, 1.0, 1.7, 3.0, 10.0]
        bar.set_ticks(np.log10(ticks).tolist(), labels=[f"{tick:g}" for tick in ticks])
    with whole_file(path) as temporary:
        figure.savefig(temporary, format="png", dpi=110)

"""Tables of every benchmark: rows aligned for a terminal or in Markdown, and their statistics."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

Row = dict[str, Any]
Table = tuple[str, Sequence[str], list[list[str]]]  # title, head, lines


def aligned(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return columns aligned to the right, all but those with nothing in them."""
    lines = [head, *rows]
    kept = [c for c in range(len(head)) if any(line[c] for line in lines[1:])]
    wide = [max(len(line[c]) for line in lines) for c in kept]
    return "\n".join(
        "  ".join(line[c].rjust(w) for c, w in zip(kept, wide, strict=True)).rstrip()
        for line in lines
    )


def markdown(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table in Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def titled(tables: Iterable[Table], notes: Sequence[str], *, on_page: bool) -> str:
    """Return tables with something in them under their titles, and notes, in text or Markdown."""
    written, heading = (markdown, "**{}**") if on_page else (aligned, "{}")
    parts = [
        f"{heading.format(title)}\n\n{written(head, lines)}"
        for title, head, lines in tables
        if lines
    ]
    return "\n\n".join([*parts, *notes])


def median(values: Sequence[float]) -> float | None:
    """Median; None of nothing."""
    return float(np.median(values)) if len(values) else None


def worst(values: Sequence[float]) -> float | None:
    """Largest; None of nothing."""
    return float(np.max(values)) if len(values) else None


def rms(values: Sequence[float]) -> float | None:
    """Root of the mean square; None of nothing."""
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else None

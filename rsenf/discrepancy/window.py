"""The workflow on one window: prepares its rows, and chooses the initial model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rsenf.discrepancy.measured import Measured, measured_of
from rsenf.discrepancy.verdict import Discovery, discover
from rsenf.errors import InputError, UsageError
from rsenf.messages import RowBlock
from rsenf.model import CaptureModel

FEWEST_THERE = 2.0 / 3.0  # of a window's frames


@dataclass(frozen=True, eq=False)
class Look:
    """Result of one window.

    Attributes
    ----------
    found : Discovery
    gap_before : float
        With the first of the initial models.
    """

    found: Discovery
    gap_before: float


def look(
    blocks: Sequence[RowBlock], models: Sequence[CaptureModel], nominal_hz: float | None
) -> Look:
    """Run the workflow on a window, from each initial model in turn until nothing is unexplained.

    Parameters
    ----------
    blocks : sequence of RowBlock
        With time stamps from the window's start.
    models : sequence of CaptureModel
        Initial models, the likeliest first.
    nominal_hz : float, optional
        50 or 60; by default found from the rows.

    Raises
    ------
    InputError
        When there is too little data, or no flicker.
    """
    data = measured_of(blocks, nominal_hz)
    if data.frames < FEWEST_THERE * (missing_in(data) + data.frames):
        problem = f"{missing_in(data)} frames never came or are of no use, {data.frames} did"
        raise InputError(problem)
    tries: list[Discovery] = []
    for model in models:
        try:
            tries.append(discover(model, data))
        except (UsageError, np.linalg.LinAlgError):  # steps have led to an invalid model
            continue
        if tries[-1].verdict != "unexplained":
            break
    if not tries:
        raise InputError("no fit of the model to these rows is found")
    best = min(tries, key=lambda t: (t.verdict == "unexplained", abs(t.last.gap.value)))
    return Look(best, tries[0].gap_before)


def missing_in(data: Measured) -> int:
    """Number of frames missing between the first and the last."""
    return int(data.slot[-1]) + 1 - data.frames

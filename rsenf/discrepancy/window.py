"""The workflow on one window alone: measured rows, and which model to begin with."""

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
    """What one window comes to.

    Attributes
    ----------
    found : Discovery
    gap_before : float
        With the first of the models to begin with.
    """

    found: Discovery
    gap_before: float


def look(
    blocks: Sequence[RowBlock], models: Sequence[CaptureModel], nominal_hz: float | None
) -> Look:
    """Find what a window lacks, beginning with each model in turn until nothing is unexplained.

    Parameters
    ----------
    blocks : sequence of RowBlock
        On a clock that begins with the window.
    models : sequence of CaptureModel
        The likeliest first.
    nominal_hz : float, optional
        50 or 60; found from the rows when not given.

    Raises
    ------
    InputError
        When there is too little to judge, or no flicker.
    """
    data = measured_of(blocks, nominal_hz)
    if data.frames < FEWEST_THERE * (missing_in(data) + data.frames):
        problem = f"{missing_in(data)} frames never came or are of no use, {data.frames} did"
        raise InputError(problem)
    tries: list[Discovery] = []
    for model in models:
        try:
            tries.append(discover(model, data))
        except (UsageError, np.linalg.LinAlgError):  # steps from there have led to what can't be
            continue
        if tries[-1].verdict != "unexplained":
            break
    if not tries:
        raise InputError("no fit of the model to these rows is found")
    best = min(tries, key=lambda t: (t.verdict == "unexplained", abs(t.last.gap.value)))
    return Look(best, tries[0].gap_before)


def missing_in(data: Measured) -> int:
    """How many frames there would be besides, if they came without a hole."""
    return int(data.slot[-1]) + 1 - data.frames

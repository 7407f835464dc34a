"""Row luminance in which an effect is hidden, and the workflow run on it."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from rsenf.discrepancy.measured import Measured, measured_of
from rsenf.discrepancy.start import PLAIN
from rsenf.discrepancy.verdict import Discovery, discover
from rsenf.messages import Header
from rsenf.model import CaptureModel, Light, RowData, Shutter, simulate_rows, synthetic_grid
from rsenf.rows.stage import blocks_from_luminance

SECONDS, LINES = 27.0, 160


@dataclass(frozen=True, eq=False)
class Hidden:
    """A simulated recording, as the workflow gets it, and its truth."""

    made: RowData
    data: Measured

    def discover(self, model: CaptureModel = PLAIN) -> Discovery:
        return discover(model, self.data)


def hidden(
    effect: str = "",
    *,
    seed: int,
    strips: int = 1,
    rate: Fraction = Fraction(30000, 1001),
    lines: int = LINES,
    **values: Any,
) -> Hidden:
    """Film a wall under a pure tone, with one effect or none."""
    shutter = Shutter(frame_rate=rate, rows=lines, idle_ratio=0.38)
    model = CaptureModel(light=Light(lamp="tone"), shutter=shutter)
    model = model.with_effect("exposure", exposure_s=0.002)
    if effect:
        model = model.with_effect(effect, **values)
    grid = synthetic_grid(seed, SECONDS + 10.0, start_s=4.0)
    made = simulate_rows(model, grid, SECONDS, seed, strips=strips)
    blocks = blocks_from_luminance(made.level, made.frame_time_s, Header())
    return Hidden(made, measured_of(list(blocks)))

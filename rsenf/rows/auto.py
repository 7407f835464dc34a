"""Detects the read-out axis: samples rows and columns until the flicker shows which it is."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

from rsenf.messages import Frame, RowBlock
from rsenf.rows.settings import AXES, RowsSettings
from rsenf.rows.stage import Rows
from rsenf.timebase import nanoseconds

# Takes the blocks by rows and by columns; returns 'rows', 'columns', or '' if undecided.
Choose = Callable[[Sequence[RowBlock], Sequence[RowBlock]], str]

# Times of the decision. Ten seconds are enough for flicker that survives a good codec; faint
# flicker gets twice that, after which 'rows' is assumed, as in nearly every video.
LOOK_AFTER_S = (10.0, 20.0)
# Limit of frames held, whatever their time stamps: 10 s at 240 frames/s.
MAX_FRAMES = 2400


class AutoRows:
    """Row means along a read-out axis that is detected from the data.

    Implements :class:`rsenf.stage.Stage`, from frames to row blocks. Nothing is sent until the axis
    is decided; then everything, exactly as :class:`~rsenf.rows.stage.Rows` would have sent it.

    Parameters
    ----------
    settings : RowsSettings
        For both samplers; its axis is ignored.
    choose : callable
        Decides on the axis from the blocks of both samplers, see ``Choose``.
    """

    def __init__(self, settings: RowsSettings, choose: Choose) -> None:
        self._choose = choose
        self._samplers: dict[str, Rows] = {
            axis: Rows(dataclasses.replace(settings, read_out_axis=axis)) for axis in AXES
        }
        self._held: dict[str, list[RowBlock]] = {axis: [] for axis in AXES}
        self._chosen: Rows | None = None
        self._frames = self._looks = 0
        self._first_ns = 0

    def update(self, message: Frame) -> list[Any]:
        """Take a frame; return the blocks that it completes, once the axis is decided."""
        if self._chosen:
            return self._chosen.update(message)
        self._first_ns = self._first_ns if self._frames else message.header.pts_ns
        self._frames += 1
        for axis, sampler in self._samplers.items():
            self._held[axis] += sampler.update(message)
        elapsed_ns = message.header.pts_ns - self._first_ns
        full = self._frames >= MAX_FRAMES
        if not full and elapsed_ns < nanoseconds(LOOK_AFTER_S[self._looks]):
            return []
        self._looks += 1
        return self._decide(final=full or self._looks == len(LOOK_AFTER_S))

    def flush(self) -> list[Any]:
        """Return the last block, or all blocks of a stream too short for an earlier decision."""
        if self._chosen:
            return self._chosen.flush()
        for axis, sampler in self._samplers.items():
            self._held[axis] += sampler.flush()
        return self._decide(final=True)

    def _decide(self, *, final: bool) -> list[Any]:
        axis = self._choose(self._held["rows"], self._held["columns"])
        if not axis and not final:
            return []
        axis = axis or "rows"
        blocks = self._held[axis]
        self._chosen = self._samplers[axis]
        self._samplers, self._held = {}, {}
        return blocks

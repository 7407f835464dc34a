"""A camera's ENF estimates, or another node's live reference, as a reference of this node."""

from __future__ import annotations

import numpy as np

from rsenf.messages import EnfEstimate, ReferenceBlock, RowBlock
from rsenf.reference.live.growing import Growing, OnTheClock
from rsenf.reference.plausible import NOMINALS_HZ, without_outliers
from rsenf.reference.reference import Notes
from rsenf.reference.wav import MAX_STD_HZ
from rsenf.timebase import NS_PER_S


class CameraReference:
    """Makes a reference from a camera's row blocks and estimates. A :class:`rsenf.stage.Stage`.

    Row blocks only supply the arrival times of their frames. Without them those of the estimates
    are used, which are later.

    Parameters
    ----------
    grid : str
        Name of the reference.
    step_s : float
        Time between samples; the hop of the camera's estimates.
    run_id : str
        Identity of the run.
    """

    def __init__(self, grid: str, step_s: float = 1.0, run_id: str = "") -> None:
        self._growing = Growing(grid, step_s, run_id)
        self._placed = OnTheClock(self._growing)
        self._stream: tuple[str, int] | None = None

    def update(self, message: EnfEstimate | RowBlock) -> list[ReferenceBlock]:
        """Take a message of the camera; return the samples that it completes."""
        header = message.header
        if (header.run_id, header.epoch) != self._stream:
            self._stream = header.run_id, header.epoch
            self._placed.new_stream()
        if isinstance(message, RowBlock):
            self._placed.note(header.pts_ns, header.arrival_time_ns)
            return []
        if message.rank != 0 or not message.nominal_hz > 0:
            return []
        self._placed.note(message.end_pts_ns, header.arrival_time_ns)
        # A sample has the same centre as its estimate, whatever the window.
        start_ns = (message.start_pts_ns + message.end_pts_ns - self._growing.step_ns) // 2
        return self._placed.sample(start_ns, _frequency_hz(message), message.nominal_hz)

    def flush(self) -> list[ReferenceBlock]:
        """Return nothing: each sample is sent as soon as it is known."""
        return []


def _frequency_hz(estimate: EnfEstimate) -> float:
    good = estimate.usable and estimate.enf_var_hz2 <= MAX_STD_HZ**2
    return estimate.enf_hz if good else float("nan")


MAX_SAMPLES = 1_000_000  # of a message
# A gap of up to a day is filled sample by sample: a finer step would fill the memory.
MIN_STEP_NS, MAX_STEP_NS = NS_PER_S // 100, 60 * NS_PER_S


class RelayedReference:
    """Makes a reference from another one's blocks. A :class:`rsenf.stage.Stage`.

    Blocks that can't be a grid's frequency, have no time, or have another step than the first are
    dropped and counted.

    Parameters
    ----------
    grid : str
        Name of the new reference.
    run_id : str
        Identity of the run.
    nominal_hz : float, optional
        Required nominal frequency; that of the first block (50 or 60) if None.

    Attributes
    ----------
    notes : Notes
        Number of dropped blocks by reason, and of outliers.
    """

    def __init__(self, grid: str, run_id: str = "", nominal_hz: float | None = None) -> None:
        self._grid, self._run_id, self._nominal_hz = grid, run_id, nominal_hz
        self._growing: Growing | None = None
        self.notes = Notes()

    def update(self, message: ReferenceBlock) -> list[ReferenceBlock]:
        """Take a block; return it as blocks of this reference."""
        if why := self._why_not(message):
            self.notes.count(f"blocks left out: {why}", 1)
            return []
        if self._growing is None:
            self._nominal_hz = message.nominal_hz
            self._growing = Growing(self._grid, message.step_ns / NS_PER_S, self._run_id)
        self._growing.zone_unknown = message.zone_unknown
        index = np.arange(message.first, message.first + message.samples)
        freq_hz = without_outliers(message.freq_hz, message.nominal_hz, self.notes)
        t_ns = message.t0_ns + index * message.step_ns
        return self._growing.stamped(t_ns, freq_hz, message.nominal_hz)

    def flush(self) -> list[ReferenceBlock]:
        """Return nothing: each sample is sent when it arrives."""
        return []

    def _why_not(self, block: ReferenceBlock) -> str:
        if block.t0_ns <= 0:
            return "they tell no time"
        if block.nominal_hz not in NOMINALS_HZ or self._nominal_hz not in (None, block.nominal_hz):
            return "they are of another nominal frequency"
        if not MIN_STEP_NS <= block.step_ns <= MAX_STEP_NS:
            return "the time between their samples can't be"
        if self._growing and block.step_ns != self._growing.step_ns:
            return "the time between their samples changes"
        if not 0 < block.samples == block.freq_hz.size <= MAX_SAMPLES or block.first < 0:
            return "their samples can't be counted"
        if block.t0_ns + (block.first + block.samples) * block.step_ns > 2**63 - 1:
            return "they are of no time that can be"
        return ""

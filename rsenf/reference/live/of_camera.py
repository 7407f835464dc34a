"""Another camera as the reference: its ENF estimates, one per hop."""

from __future__ import annotations

from rsenf.messages import EnfEstimate, ReferenceBlock, RowBlock
from rsenf.reference.live.growing import Growing
from rsenf.reference.live.on_the_clock import OnTheClock

MAX_STD_HZ = 0.005  # a quarter of the grid's own variation; a less certain estimate is a gap


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

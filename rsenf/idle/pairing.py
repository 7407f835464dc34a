"""Pairs row blocks with the flicker's phase, which is known later than the rows.

Rows wait until the follower has returned the seconds of all their frames, which takes a bounded
time.
"""

from __future__ import annotations

from collections import Counter, deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rsenf.flicker.conversions import SeamWatch
from rsenf.flicker.follower import FlickerFollower, Follower
from rsenf.flicker.frame_slips import FrameSlip
from rsenf.flicker.second import FlickerSecond
from rsenf.messages import RowBlock

Float = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PhasedRows:
    """Mean rows of frames, shape (frames, rows), and the phase of the flicker at each."""

    level: Float
    phase_rad: Float


class Pairing:
    """Holds the rows of usable blocks, averaged over strips, until their phase is known.

    Parameters
    ----------
    nominal_hz : float, optional
        50 or 60; found by the follower when not given.
    follower : Follower, optional
        Flicker follower shared with another stage; by default its own.

    Attributes
    ----------
    nominal_hz : float
        Of the last usable second; NaN before.
    seconds, usable : int
        Number of seconds that the follower returned, and of the usable ones.
    reasons : Counter of str
        Why the others aren't usable.
    doubted_hz : Counter of float
        Nominal frequencies of the others.
    camera_hz : float
        Original frame rate of a converted stream; else NaN.
    jitter_s : float
        Rms jitter of time stamps that even times replace.
    slips : list of FrameSlip
        Lost or repeated frames that the time stamps don't show; the phase is corrected for them.
    seams : SeamWatch
        Whether the frame rate may be another one, 0.1 % off.
    """

    def __init__(self, nominal_hz: float | None, follower: Follower | None = None) -> None:
        self._follower = follower or FlickerFollower(nominal_hz)
        self._waiting: deque[tuple[NDArray[np.int64], Float | None]] = deque()
        self._phase: dict[int, float] = {}
        self._reached = -1
        self._f0_sum_hz = self._rate_sum_hz = self._apart_sum = 0.0
        self.nominal_hz = float("nan")
        self.seconds, self.usable = 0, 0
        self.reasons: Counter[str] = Counter()
        self.doubted_hz: Counter[float] = Counter()
        self.camera_hz = float("nan")
        self.jitter_s = 0.0
        self.slips: list[FrameSlip] = []
        self.seams = SeamWatch()

    @property
    def f0_hz(self) -> float:
        """Mean illumination frequency of the usable seconds; NaN without any."""
        return self._f0_sum_hz / self.usable if self.usable else float("nan")

    @property
    def clock_hz(self) -> float | None:
        """Mean frame rate of the usable seconds, where time stamps jitter; else None."""
        return self._rate_sum_hz / self.usable if self.usable and self.jitter_s else None

    @property
    def apart_turns(self) -> float:
        """Mean of the seconds' rms phase deviations from one ramp."""
        return self._apart_sum / self.usable if self.usable else 0.0

    def update(self, block: RowBlock) -> list[PhasedRows]:
        """Add a block; return the rows whose phase is known now."""
        numbers = block.frame_number.copy()  # a view of a message would keep all of it
        self._waiting.append((numbers, block.profiles() if block.usable else None))
        self.show(block)
        return self._ready()

    def show(self, block: RowBlock) -> None:
        """Pass a block to the follower only: a shared one has to be given every block."""
        for second in self._follower.update(block):
            self._hear(second)

    def flush(self) -> list[PhasedRows]:
        """Return the remaining rows, at the end of the follower."""
        for second in self._follower.flush():
            self._hear(second)
        if self._waiting:
            self._reached = int(self._waiting[-1][0][-1])
        return self._ready()

    def _hear(self, second: FlickerSecond) -> None:
        self.seconds += 1
        self.seams.update([second])
        self.slips += second.slips
        if second.converted:
            self.camera_hz = second.frame_rate_hz
        if second.frame_number.size:
            self._reached = int(second.frame_number[-1])
        if not second.usable:
            self.reasons[second.reason] += 1
            if np.isfinite(second.nominal_hz):
                self.doubted_hz[second.nominal_hz] += 1
            return
        self.usable += 1
        self.jitter_s = second.jitter_s
        self._f0_sum_hz += second.f0_hz
        self._rate_sum_hz += second.frame_rate_hz
        self._apart_sum += second.apart_turns
        self.nominal_hz = second.nominal_hz
        self._phase.update(
            zip(second.frame_number.tolist(), second.phase_rad.tolist(), strict=True)
        )

    def _ready(self) -> list[PhasedRows]:
        out = []
        while self._waiting and int(self._waiting[0][0][-1]) <= self._reached:
            numbers, level = self._waiting.popleft()
            phase_rad = np.array([self._phase.pop(n, np.nan) for n in numbers.tolist()])
            known = np.isfinite(phase_rad)
            if level is not None and known.any():
                out.append(PhasedRows(level[known], phase_rad[known]))
        return out

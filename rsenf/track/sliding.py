"""Base class of estimators with a window of fixed length that slides over the row blocks.

The frame rate is measured before the first window begins; each block is reduced to a few values a
frame on arrival; and every ``hop_s`` the values of the last ``window_s`` are judged. Subclasses
define the values, and how to judge them.
"""

from __future__ import annotations

import dataclasses
from abc import abstractmethod
from collections import deque
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsenf.flicker.cell_light import APART_HZ, CellLight, cell_means, look_at, tells_cells
from rsenf.flicker.conversions import Conversions
from rsenf.flicker.follower import LEAST_RATE_HZ, MOST_RATE_HZ
from rsenf.flicker.lines import Line, alias_hz
from rsenf.flicker.mains import CREEPS, is_faint, why_not
from rsenf.flicker.slow_time import SlowTime, frame_periods, usual_gap_ns
from rsenf.messages import EnfEstimate, Header, RowBlock
from rsenf.timebase import nanoseconds
from rsenf.track.method import EnfMethod, TrackSettings
from rsenf.track.window import TonePhase, course_of

# Row blocks held back to measure the frame rate, which the phase ramps depend on.
RATE_NEEDS_S = 1.0
MIN_FILL_RATIO = 0.8
UNEVEN = "the phase doesn't run on evenly: frames lost or shown twice, or another light beside it"
UNMOVED = (
    "one mean per frame, and its frequency isn't seen to move as a grid's does: give the nominal "
    "frequency"
)
MOST_EXCESS = 12.0  # mean square phase deviation over that of noise and a grid
UNEVEN_RATIO = 0.1  # median relative deviation of frame intervals
MOST_UNSEEN = 2.0  # most excess where cells can't show what it is
EXAMINE_HOPS = 5  # windows that share a test for mains light
LOOKS = 2  # last tests, all of which must pass: their windows overlap
# Weaker tones (levels) are rounding, not light.
MIN_AMPLITUDE_LEVEL = 1e-4


@dataclasses.dataclass(frozen=True, eq=False)
class Window:
    """A full window: the values of its frames, its ends since the first frame, its frame rate."""

    buffer: SlowTime
    start_s: float
    end_s: float
    frame_rate_hz: float

    @property
    def centre_s(self) -> float:
        """Its centre, since the first frame."""
        return (self.start_s + self.end_s) / 2.0

    @property
    def part(self) -> slice:
        """Its frames, as a slice for the buffer's accessors."""
        return self.buffer.between(self.start_s, self.end_s)


class SlidingTracker(EnfMethod):
    """Stage from row blocks to one ENF estimate for each window.

    Parameters
    ----------
    settings : TrackSettings, optional
    """

    obeys = frozenset({"harmonic", "line_m"})

    def __init__(self, settings: TrackSettings | None = None) -> None:
        super().__init__(settings)
        self._waiting: list[RowBlock] = []
        self._buffer: SlowTime | None = None
        self._cells: SlowTime | None = None
        self._conversions: Conversions | None = None
        self._examined = -EXAMINE_HOPS  # hop of the last test for mains light
        self._has_moved = False  # whether the phase was seen to wander
        self._is_grids = False  # whether it certainly wandered as a grid's does
        self._looks: deque[str] = deque(maxlen=LOOKS)  # results of the last tests
        self._header: Header | None = None
        self._hops = 0
        self._rows = self._bands = 0
        self._level = 0.0  # 0 for frame means

    @abstractmethod
    def _prepare(self, first: RowBlock, frame_rate_hz: float) -> int:
        """Set up for blocks like the first; return the number of values per frame."""

    @abstractmethod
    def _reduce(self, block: RowBlock) -> NDArray[np.complex128]:
        """Reduce a block to the values of its frames, shape (frames, values)."""

    def _fits(self, block: RowBlock) -> bool:
        """Whether a block has the shape of the first."""
        return block.rows == self._rows

    def _cells_of(self, block: RowBlock) -> NDArray[Any]:
        """Mean levels that distinguish light from patterns, shape (frames, bands, cells)."""
        return cell_means(block.level)

    @abstractmethod
    def _tone_series(self, window: Window, found: EnfEstimate) -> NDArray[np.complex128]:
        """Series whose frequency was estimated, shape (frames,)."""

    @abstractmethod
    def _judge(self, window: Window, blank: EnfEstimate) -> EnfEstimate:
        """Fill in the result of a window, or the reason why there is none."""

    def update(self, message: RowBlock) -> list[Any]:
        """Take a block of rows; return the estimates whose windows it completes."""
        if message.frames == 0:
            return []
        self._header = message.header
        if self._buffer is None:
            self._waiting.append(message)
            spans = self._waiting[0].frame_pts_ns[0], message.frame_pts_ns[-1]
            if spans[1] - spans[0] < nanoseconds(RATE_NEEDS_S):
                if spans[1] < spans[0]:  # the clock was set back
                    del self._waiting[:-1]
                return []
            self._begin()
        else:
            self._take(self._buffer, message)
        return self._complete(final=False)

    def flush(self) -> list[Any]:
        """Return the estimate of the last window, if the stream just fills it."""
        return self._complete(final=True)

    def _begin(self) -> None:
        first = self._waiting[0]
        pts_ns = np.concatenate([block.frame_pts_ns for block in self._waiting])
        numbers = np.concatenate([block.frame_number for block in self._waiting])
        periods = frame_periods(pts_ns, numbers, usual_gap_ns(pts_ns))
        rate_hz = periods * 1e9 / int(pts_ns[-1] - pts_ns[0])
        if not LEAST_RATE_HZ < rate_hz < MOST_RATE_HZ:
            del self._waiting[0]  # the clock jumped: begin after that
            return
        self._rows = first.rows
        if first.rows > 1:
            self._level = float(np.mean([b.level.mean(dtype=np.float64) for b in self._waiting]))
            _, self._bands, strips = self._cells_of(first).shape
            self._cells = SlowTime(self._bands * strips, int(first.frame_pts_ns[0]), np.float32)
        self._conversions = Conversions(self.settings.nominals_hz, first, rate_hz)
        self._buffer = SlowTime(self._prepare(first, rate_hz), int(first.frame_pts_ns[0]))
        for block in self._waiting:
            self._take(self._buffer, block)
        self._waiting = []

    def _take(self, buffer: SlowTime, block: RowBlock) -> None:
        if self._fits(block):
            buffer.append(block, self._reduce(block))
            if self._conversions is not None:
                self._conversions.add(block)
            if self._cells is not None:
                self._cells.append(block, self._cells_of(block).reshape(block.frames, -1))

    def _complete(self, *, final: bool) -> list[Any]:
        """Return the estimates of all full windows. The last one may lack half a frame."""
        buffer = self._buffer
        out: list[Any] = []
        if buffer is None:
            return out
        s = self.settings
        while True:
            start_s = self._hops * s.hop_s
            end_s = start_s + s.window_s
            rate_hz = buffer.frame_rate_hz(buffer.between(start_s, end_s))
            reached_s = buffer.last_t_s + (1.5 / rate_hz if final and rate_hz > 0 else 0.0)
            if reached_s < end_s:
                return out
            out += self._estimates(Window(buffer, start_s, end_s, rate_hz))
            self._hops += 1
            for one in (buffer, self._cells, self._conversions):
                if one is not None:
                    one.forget_before(start_s + s.hop_s)

    def _estimates(self, window: Window) -> list[EnfEstimate]:
        """Judge a window, unless it lacks frames."""
        blank, reason = self._blank(window), self._what_lacks(window)
        found = dataclasses.replace(blank, reason=reason) if reason else self._judge(window, blank)
        return [self._believed(window, blank, found)]

    def _believed(self, window: Window, blank: EnfEstimate, found: EnfEstimate) -> EnfEstimate:
        """Return a result with a realistic error, or the reason why it isn't credible.

        The test for mains light runs every ``EXAMINE_HOPS`` windows.
        """
        if not found.usable:
            return found
        t_s = window.buffer.times(window.part) - window.centre_s
        tone_hz = 2.0 * found.enf_hz * found.harmonic
        window_s = window.end_s - window.start_s
        course = course_of(self._tone_series(window, found), t_s, tone_hz, window_s)
        var_hz2 = found.enf_var_hz2 * max(course.excess, 1.0)
        reason = (
            self._conversions.why_not(window.start_s, window.end_s) if self._conversions else ""
        )
        if not reason and course.excess > MOST_EXCESS:
            reason = UNEVEN
        elif not reason and var_hz2 > self.settings.max_std_hz**2:
            reason = "too uncertain"
        elif not reason and self._hops - self._examined >= EXAMINE_HOPS:
            self._examined = self._hops
            light = self._light(window, tone_hz)
            self._looks.append(self._why_not_mains(window, found, course, light))
        reason = reason or next(filter(None, self._looks), "")
        if not reason:
            return dataclasses.replace(found, enf_var_hz2=var_hz2)
        return dataclasses.replace(blank, header=found.header, snr_db=found.snr_db, reason=reason)

    def _light(self, window: Window, tone_hz: float) -> CellLight | None:
        """Statistics of the cells at a tone; None near 0 Hz, where each method has its own test.

        Also None near half the frame rate if frames come unevenly: what alternates is no tone then.
        """
        rate_hz = window.frame_rate_hz
        if self._cells is None or abs(alias_hz(tone_hz, rate_hz)) < APART_HZ:
            return None
        part = self._cells.between(window.start_s, window.end_s)
        usable = self._cells.usable(part)
        t_s, seen = self._cells.times(part)[usable], self._cells.values(part)[usable]
        uneven = float(np.median(np.abs(np.diff(t_s) * rate_hz - 1.0)))
        if uneven > UNEVEN_RATIO and not tells_cells(tone_hz, rate_hz):
            return None
        return look_at(seen, t_s, 2.0 * np.pi * tone_hz * t_s, self._bands, tone_hz, rate_hz)

    def _why_not_mains(
        self, window: Window, found: EnfEstimate, course: TonePhase, light: CellLight | None
    ) -> str:
        """Return why a window's result isn't mains light; '' if it may be."""
        self._has_moved |= course.wander.is_seen
        self._is_grids |= course.wander.is_grids
        if self._rows == 1 and not (self.settings.nominal_hz or self._has_moved):
            return UNMOVED
        if self._rows > 1 and light is None and course.excess > MOST_UNSEEN:
            return CREEPS
        f0_hz, rate_hz = 2.0 * found.enf_hz, found.frame_rate_hz
        return why_not(
            f0_hz, found.nominal_hz, rate_hz, course.wander, light,
            unfiltered=window.buffer.unfiltered(window.part), has_moved=self._is_grids,
        )  # fmt: skip

    def _is_faint(self, amplitude: float, line: Line, offset_hz: float) -> bool:
        """Whether a tone ``a·exp(jφ)``, half of the flicker's amplitude, is too weak."""
        if not self._level > 0.0:
            return False
        f0_hz = 2.0 * line.nominal_hz + offset_hz / line.harmonic
        return is_faint(2.0 * amplitude / self._level, f0_hz, line.nominal_hz)

    def _what_lacks(self, window: Window) -> str:
        """Return why a window can't be judged; '' if it can."""
        part, rate_hz = window.part, window.frame_rate_hz
        usable_ratio = window.buffer.usable_ratio(part)
        # Frames present, of those expected at this rate.
        length_s = window.end_s - window.start_s
        fill = (part.stop - part.start) / (rate_hz * length_s) if rate_hz > 0 else 0.0
        if fill < MIN_FILL_RATIO:
            return f"only {fill:.0%} of the frames are there"
        if usable_ratio < MIN_FILL_RATIO:
            return f"rows usable in only {usable_ratio:.0%} of the frames"
        return ""

    def _blank(self, window: Window) -> EnfEstimate:
        """Return an estimate with what is known before a window is judged."""
        assert self._header is not None
        buffer = window.buffer
        start_ns, end_ns = (
            buffer.origin_ns + nanoseconds(t) for t in (window.start_s, window.end_s)
        )
        frame_first, frame_last = buffer.frame_numbers(window.part)
        return EnfEstimate(
            header=self._header.at(
                start_ns, seq=self._hops, frame_first=frame_first, frame_last=frame_last
            ),
            method=self.name,
            harmonic=self.settings.harmonic,
            origin_pts_ns=buffer.origin_ns,
            start_pts_ns=start_ns,
            end_pts_ns=end_ns,
            frame_rate_hz=window.frame_rate_hz,
        )

"""Tracks the flicker's phase through a stream of row blocks, second by second.

Detection tests one window after another. From a detection the phase is tracked backwards to the
first second that isn't out yet, then forwards (:mod:`rsenf.flicker.phase_tracker`). While nothing
is detected, an alias near 0 Hz is tried as well (:mod:`rsenf.flicker.near_dc`).

Tracking is most of the work of a tracker and of an idle estimator, and identical in both:
:func:`shared` lets two stages of a process, which receive the same blocks, use one follower.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from rsenf.flicker.acquire import MIN_SNR, NO_FLICKER, AcquiredFlicker, acquire, may_stand_still
from rsenf.flicker.cell_light import BRIEF_S, bands_of, cell_means
from rsenf.flicker.conversions import Conversions
from rsenf.flicker.lines import ProfileBasis
from rsenf.flicker.mains import CREEPS, PATCHY, TOO_BRIEF, UNFILTERED
from rsenf.flicker.near_dc import EVERY_S, SHORTEST_S, SPAN_S, NearDcTracker
from rsenf.flicker.phase_tracker import (
    AHEAD_S,
    SHORT_S,
    TOGETHER_S,
    TOO_FEW,
    WINDOW_S,
    PhaseTracker,
)
from rsenf.flicker.regular_clock import RegularClock
from rsenf.flicker.second import FlickerSecond
from rsenf.flicker.slow_time import SlowTime, frame_periods, usual_gap_ns
from rsenf.messages import RowBlock
from rsenf.timebase import nanoseconds

Float = NDArray[np.float64]

NOMINALS_HZ = (50.0, 60.0)
# Frames held back to measure the frame rate.
RATE_NEEDS_S = 1.0
LEAST_RATE_HZ, MOST_RATE_HZ = 0.1, 1e5  # beyond these it is no camera's
LOOK_S = 20  # detection window, unless the clip is shorter
HOLD_S = 60  # seconds held back while nothing is detected
LONG_EVERY_S = 10  # interval at which all of them are tested, where a window leaves doubt
YOUNG_S = 30  # seconds held back while the read-out direction is unknown
GIVE_UP_S = 30  # seconds without the tone after which detection starts again
MIN_FILL_RATIO = 0.8
TOO_SHORT = "too short to tell which frame rate this one was made of"


class FlickerFollower:
    """Row blocks in, one :class:`FlickerSecond` for every second of the stream out.

    Parameters
    ----------
    nominal_hz : float, optional
        Nominal grid frequency, 50 or 60; found from the data if not given.
    min_snr : float
        Detection threshold: tone power over noise power in a resolution cell of a 20 s window.
    """

    def __init__(self, nominal_hz: float | None = None, *, min_snr: float = MIN_SNR) -> None:
        self._nominals = NOMINALS_HZ if nominal_hz is None else (nominal_hz,)
        self._min_snr = min_snr
        self._waiting: list[RowBlock] = []
        self._basis: ProfileBasis | None = None
        self._buffer = self._cells = SlowTime(1, 0)
        self._conversions: Conversions | None = None
        self._rate_hz = float("nan")  # frame rate of the camera
        self._come_hz = float("nan")  # frame rate as received
        self._reached = 0  # whole seconds received
        self._next = 0  # next second to compute
        self._ready: deque[FlickerSecond] = deque()  # computed, but not due yet
        self._tracker: PhaseTracker | None = None
        self._still: NearDcTracker | None = None  # where an alias may be at 0 Hz
        self._still_until = 0  # second up to which its phase is known
        self._ramp: NDArray[np.complex128] | None = None
        self._why = NO_FLICKER
        self._try_again = 0  # second of the next search for a converted frame rate
        self._why_remade = ""  # why a conversion can't be undone
        self._clock: RegularClock | None = None  # replaces stamps that jitter

    def update(self, block: RowBlock) -> list[FlickerSecond]:
        """Take a block of rows; return the seconds that it completes."""
        if block.frames == 0:
            return []
        if self._basis is None:
            self._waiting.append(block)
            if not self._begin(final=False):
                return []
        elif self._conversions and block.rows == self._basis.rows:
            self._append(self._conversions, block)
        return self._advance(final=False)

    def flush(self) -> list[FlickerSecond]:
        """Return the seconds that are left."""
        if self._basis is None and not (self._waiting and self._begin(final=True)):
            return []
        return self._advance(final=True)

    @property
    def origin_ns(self) -> int:
        """Stream clock at the first frame."""
        return self._buffer.origin_ns

    def _begin(self, *, final: bool) -> bool:
        """Set up once the frame rate is known, from up to a second of frames."""
        pts = np.concatenate([b.frame_pts_ns for b in self._waiting])
        numbers = np.concatenate([b.frame_number for b in self._waiting])
        enough = int(np.searchsorted(pts, pts[0] + nanoseconds(RATE_NEEDS_S)))
        if enough >= pts.size:
            if not final or pts.size < 2:
                return False
            enough = pts.size - 1
        lasted_ns = pts[enough] - pts[0]
        frames = int(numbers[enough] - numbers[0])
        if not LEAST_RATE_HZ * lasted_ns < frames * 1e9 < MOST_RATE_HZ * lasted_ns:
            del self._waiting[0]  # the clock stood still or jumped: begin after that
            return False
        self._come_hz = float(frames * 1e9 / lasted_ns)
        pts, numbers = pts[: enough + 1], numbers[: enough + 1]
        clock = RegularClock.fit(numbers, (pts - pts[0]) / 1e9)
        periods = frame_periods(pts, numbers, usual_gap_ns(pts))
        self._rate_hz = clock.frame_rate_hz if clock else float(periods * 1e9 / lasted_ns)
        first = self._waiting[0]
        self._conversions = Conversions(self._nominals, first, self._rate_hz)
        self._basis, self._buffer = self._conversions.basis, self._conversions.columns
        self._cells = SlowTime(bands_of(first.rows) * first.strips, int(pts[0]), np.float32)
        for nominal_hz in self._nominals:
            if may_stand_still(nominal_hz, self._rate_hz, self._basis.rows):
                self._still = NearDcTracker(nominal_hz)
        for block in self._waiting:
            if block.rows == self._basis.rows:
                self._append(self._conversions, block)
        self._waiting = []
        return True

    def _append(self, rows: Conversions, block: RowBlock) -> None:
        if self._clock is not None:
            block = self._clock.regular(block, self._buffer.origin_ns)
        rows.add(block)
        self._cells.append(block, cell_means(block.level).reshape(block.frames, -1))
        if self._still is not None:
            self._still.add(block, self._buffer.origin_ns)

    def _advance(self, *, final: bool) -> list[FlickerSecond]:
        """Process every complete second; at the end, the rest as well."""
        out: list[FlickerSecond] = []
        while self._reached + 1 <= self._buffer.last_t_s:
            self._reached += 1
            out += self._at(self._reached, final=False)
        if final:
            out += self._at(int(self._buffer.last_t_s + 1.5 / self._rate_hz), final=True)
        return out

    def _at(self, end: int, *, final: bool) -> list[FlickerSecond]:
        """Process the frames before second ``end``; at the end, all that remain."""
        look_s = min(LOOK_S, end)
        if self._tracker is None and (look_s == LOOK_S or (final and look_s >= self._shortest_s)):
            self._look(end - look_s, end, is_long=final or end % LONG_EVERY_S == 0)
        if self._tracker is not None:
            self._still = None
            is_fitted = end >= WINDOW_S and (end - WINDOW_S) % TOGETHER_S == 0
            known = end - AHEAD_S + TOGETHER_S - 1 if is_fitted else 0
        else:
            self._look_still(end, final=final)
            # Early in a stream the read-out direction may still become known.
            is_settled = end > YOUNG_S or (self._still is not None and self._still.knows_direction)
            known = max(self._still_until - AHEAD_S if is_settled else 0, end - HOLD_S)
        while self._next < (end if final else known):
            second = self._second(self._next, end)
            self._ready.append(second.by_clock(self._clock) if self._clock else second)
            self._next += 1
        due = end if final else end - AHEAD_S
        out = []
        while self._ready and self._ready[0].index < due:
            out.append(self._ready.popleft())
        kept_s = WINDOW_S if self._tracker else 0
        for one in (self._conversions, self._cells):
            if one is not None:
                one.forget_before(min(self._next, end - LOOK_S) - kept_s)
        return out

    def _look_still(self, end: int, *, final: bool) -> None:
        """Look for an alias near 0 Hz, every ``EVERY_S`` seconds."""
        if self._still is None or self._why_remade or end < SHORTEST_S:
            return
        self._still.forget_before(end - SPAN_S)
        if (final or end % EVERY_S == 0) and not self._finds_still(end):
            self._why = self._still.why

    def _finds_still(self, end: int, least_level: float = 0.0) -> bool:
        """Look for light of more than a level that stands still; its phase is known if found."""
        still = self._still
        if still is None or end < SHORTEST_S or not still.look(end) or still.level < least_level:
            return False
        self._still_until, self._nominals = end, (still.nominal_hz,)
        return True

    def _second(self, index: int, end: int) -> FlickerSecond:
        if self._tracker is not None:
            self._tracker.settled_s = self._next
            self._tracker.around(self._buffer, index, end)  # slips move frames between seconds
            second = self._tracker.second(self._buffer, self._blank(index), end)
            if self._tracker.failed >= GIVE_UP_S:
                self._tracker, self._why = None, second.reason
            return second
        blank, part = self._blank(index), self._buffer.between(index, index + 1)
        if self._still is not None and index < self._still_until:
            return self._still.second(blank, self._buffer.times(part))
        return blank

    def _blank(self, index: int) -> FlickerSecond:
        part = self._buffer.between(index, index + 1)
        numbers = self._buffer.numbers(part)
        in_second = set(numbers.tolist())
        return FlickerSecond(
            index=index,
            start_s=float(index),
            end_s=index + 1.0,
            reason=self._why,
            frame_rate_hz=self._rate_hz,
            converted=self._buffer.conversion is not None,
            slips=tuple(slip for slip in self._buffer.slips if slip.frame_number in in_second),
            doubled=self._conversions.doubled(index) if self._conversions else None,
            frame_number=numbers,
        )

    def _look(self, start: int, end: int, *, is_long: bool) -> None:
        """Detect flicker in a window, and track it back to the first second that isn't out yet."""
        assert self._basis is not None
        t_s, columns = self._buffer.usable_of(start, end)
        if t_s.size < MIN_FILL_RATIO * self._shown_hz * (end - start):
            self._why = TOO_FEW
            return
        if self._clock is None and self._goes_by_a_clock(start, end):
            t_s, columns = self._buffer.usable_of(start, end)
        found = self._found(t_s, columns, (start, end))
        if isinstance(found, str):
            self._why = found
            return
        tracker = PhaseTracker(
            found, start, self._basis, self._rate_hz, self._shown_hz, self._min_snr,
            self._cells, self._ramp,
        )  # fmt: skip
        tracker.settled_s = self._next
        self._why = tracker.why_not_mains(start, end)
        first = int(self._buffer.first_t_s)
        if self._why in ("", CREEPS, TOO_BRIEF, PATCHY, UNFILTERED):
            # A fit shows how the phase wanders.
            tracker.extend(self._buffer, start, end)
            self._why = tracker.why_not_mains(start, end)
        if self._why in (PATCHY, UNFILTERED) and is_long:
            self._go_back(tracker, start, first)
            tracker.extend(self._buffer, first, end)
            self._why = tracker.why_not_mains(first, end)
        if self._why:
            return
        tracker.extend(self._buffer, start, end)
        is_other = self._still is not None and self._still.nominal_hz != found.nominal_hz
        if is_other and self._finds_still(end, tracker.level):
            return  # stronger light, of which a codec or converter makes such a tone
        self._nominals, self._ramp, self._tracker = (found.nominal_hz,), tracker.ramp, tracker
        self._go_back(tracker, start, first)

    def _go_back(self, tracker: PhaseTracker, start: int, first: int) -> None:
        """Track from a window that begins at ``start`` back to second ``first``."""
        for before in range(start - 1, first - 1, -1):
            tracker.extend(self._buffer, before, before + LOOK_S)

    def _goes_by_a_clock(self, start: int, end: int) -> bool:
        """Switch to even frame times if they make the light's SNR much higher."""
        assert self._conversions is not None
        clock = self._conversions.clock_of(start, end, self._min_snr)
        if clock is None:
            return False
        self._clock, self._rate_hz = clock, clock.frame_rate_hz
        self._conversions.go_by(clock)
        self._cells.go_by(clock)
        return True

    @property
    def _shortest_s(self) -> float:
        """Shortest window for detection: longer without rows to test the light by."""
        return SHORT_S if self._basis and self._basis.rows > 1 else BRIEF_S

    @property
    def _shown_hz(self) -> float:
        """Rate of distinct frames received."""
        conversion = self._buffer.conversion
        return min(conversion.source_hz, conversion.shown_hz) if conversion else self._come_hz

    def _found(self, t_s: Float, columns: Float, span_s: tuple[int, int]) -> AcquiredFlicker | str:
        """Detect flicker at the times at which frames were taken, or say why there is none."""
        assert self._basis is not None
        assert self._conversions is not None
        if self._buffer.conversion is None and span_s[1] >= self._try_again:
            self._try_again = span_s[1] + LOOK_S
            conversion, is_proven = self._conversions.find(*span_s)
            self._why_remade = conversion.why_not_undone if conversion else ""
            if conversion is not None and not self._why_remade:
                if span_s[1] - span_s[0] < BRIEF_S:
                    return TOO_SHORT
                taken_s, source_hz = conversion.taken_s(t_s), conversion.source_hz
                found = acquire(
                    self._nominals, self._basis, taken_s, columns, source_hz, span_s, self._min_snr
                )
                if is_proven or not isinstance(found, str):
                    self._conversions.undo(conversion)
                    self._cells.convert(conversion)
                    self._rate_hz = source_hz
                    if self._still:
                        self._still = self._still.of_source(source_hz, self._nominals)
                    return found
        if self._why_remade:
            return self._why_remade
        return acquire(
            self._nominals, self._basis, t_s, columns, self._rate_hz, span_s, self._min_snr
        )


Heard = tuple[RowBlock | None, list[FlickerSecond]]  # a block (None: end), and its seconds


class Follower(Protocol):
    """Row blocks in, one :class:`FlickerSecond` for every second of the stream out."""

    @property
    def origin_ns(self) -> int:
        """Stream clock at the first frame."""
        ...

    def update(self, block: RowBlock) -> list[FlickerSecond]:
        """Take a block of rows; return the seconds that it completes."""
        ...

    def flush(self) -> list[FlickerSecond]:
        """Return the seconds that are left."""
        ...


def shared(follower: FlickerFollower) -> tuple[Follower, Follower]:
    """Return two readers of one follower. Both must be given the very same blocks."""
    one, other = _Reader(follower), _Reader(follower)
    one.other, other.other = other, one
    return one, other


@dataclass(eq=False)
class _Reader:
    follower: FlickerFollower
    queued: deque[Heard] = field(default_factory=deque)  # results queued by the other reader

    def __post_init__(self) -> None:
        self.other = self

    @property
    def origin_ns(self) -> int:
        return self.follower.origin_ns

    def update(self, block: RowBlock) -> list[FlickerSecond]:
        return self._next(block)

    def flush(self) -> list[FlickerSecond]:
        return self._next(None)

    def _next(self, block: RowBlock | None) -> list[FlickerSecond]:
        if not self.queued:
            seconds = self.follower.flush() if block is None else self.follower.update(block)
            self.other.queued.append((block, seconds))
            return seconds
        known, seconds = self.queued.popleft()
        if known is not block:
            raise RuntimeError("two stages that follow the flicker together were fed differently")
        return seconds

"""The verdict on one epoch of a feed, from its ENF estimates, with hysteresis between two limits.

If a feed is stale: since when it hasn't followed the grid, and when its picture was taken.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from rsenf.live.alarms import Change, FlickerSize, Jump, Jumps
from rsenf.live.cusum import LONGEST_S, Cusum, Phase
from rsenf.live.past import LEAST_S, MOST_S, GrowingGrid, Origin, OwnPast, in_reference
from rsenf.live.settings import LiveSettings
from rsenf.live.ticks import Tick
from rsenf.messages import EnfEstimate
from rsenf.timebase import NS_PER_S, nanoseconds, seconds


class Suspects:
    """The estimates since a feed last followed the grid, and searches for their origin.

    Attributes
    ----------
    origin : Origin or None
        Age of the picture, found in the reference.
    repeats : Origin or None
        Age of the picture, found in the feed's own past.
    since_ns : int or None
        Stream clock since when the estimates haven't followed the grid.
    """

    def __init__(self, settings: LiveSettings, own: OwnPast) -> None:
        self._youngest_s = settings.latest_s
        self._every_ns = nanoseconds(settings.search_every_s)
        self._own = own
        self._waiting: list[EnfEstimate] = []
        self._searched_ns: int | None = None
        self.clear()

    def clear(self) -> None:
        """Discard everything: the feed follows the grid."""
        self.jumped()
        self.repeats: Origin | None = None
        self.since_ns: int | None = None

    def jumped(self) -> None:
        """Discard the estimates and the origin: the picture has jumped in time, as loops do."""
        self._waiting = []
        self.origin: Origin | None = None
        self._searched_ns = None

    def add(self, estimate: EnfEstimate) -> None:
        """Add an estimate that doesn't follow the grid."""
        if self._waiting and estimate.origin_pts_ns != self._waiting[-1].origin_pts_ns:
            self.jumped()  # a restarted tracker's times and phases have another origin
        if self.since_ns is None:
            self.since_ns = estimate.start_pts_ns
        self._waiting.append(estimate)
        del self._waiting[:-MOST_S]

    def search(self, tick: Tick, grid: GrowingGrid) -> None:
        """Search for the origin, if unknown, with enough estimates and not too soon again."""
        known = self.origin is not None or tick.offset_ns is None
        if known or sum(e.usable for e in self._waiting) < LEAST_S:
            return
        if self._searched_ns is not None and tick.pts_ns - self._searched_ns < self._every_ns:
            return
        assert tick.offset_ns is not None
        self._searched_ns = tick.pts_ns
        self.repeats = self.repeats or self._own.repeated(self._waiting, tick.offset_ns)
        if grid.is_there:
            held = grid.held(self._waiting[-1].end_pts_ns + tick.offset_ns)
            self.origin = in_reference(self._waiting, tick.offset_ns, held, self._youngest_s)


SEEN = 20  # last estimates that decide whether there is a signal
LEAST_USABLE = 0.3  # share of usable ones
FORGET_NS = 30 * NS_PER_S  # without a comparison for this long, the verdict no longer holds
SLIPS = 1000  # places with lost frames that are remembered
LEAST_RATE_HZ = 1.0  # of frames whose loss is accounted for
SEARCH_NS = 60 * NS_PER_S  # longest search for flicker before a tracker says that there is none


class Judge:
    """The verdict on one epoch.

    Parameters
    ----------
    settings : LiveSettings
    grid : GrowingGrid
    own : OwnPast

    Attributes
    ----------
    evidence : Cusum or None
        None before the first usable phase.
    standing : str
        Decision by the phases: 'live', 'stale' or 'undecided'.
    suspects : Suspects
    """

    def __init__(self, settings: LiveSettings, grid: GrowingGrid, own: OwnPast) -> None:
        self._settings, self._grid, self._own = settings, grid, own
        self._seen: deque[EnfEstimate] = deque(maxlen=SEEN)
        self._jumps, self._size = Jumps(), FlickerSize()
        self._compared_ns: int | None = None
        self._lost = deque([(-(1 << 63), 0)], maxlen=SLIPS)  # since when how many frames
        self.evidence: Cusum | None = None
        self.suspects = Suspects(settings, own)
        self.standing = "undecided"

    def update(self, estimate: EnfEstimate, tick: Tick) -> tuple[Jump | None, Change | None]:
        """Take an estimate; return a jump of the phase and a change of the amplitude, if any."""
        self._seen.append(estimate)
        phase = _phase_of(estimate, self._lost_before(estimate))
        if phase is None or not math.isfinite(estimate.enf_hz):
            return None, None
        if self.evidence is None:
            self.evidence = Cusum(self._settings, estimate.nominal_hz)
        last = self.evidence.last
        if last is not None and phase.t_ns <= last.t_ns:
            return None, None  # already known
        jump = self._jumps.update(phase, self.evidence)
        self.evidence.update(phase, self._moved(estimate, phase, tick))
        self._stand()
        if self.evidence.nats >= self._settings.limits.most:
            self.suspects.clear()
        elif jump or estimate.slips:  # a splice may look like lost or repeated frames
            self.suspects.jumped()
        self.suspects.add(estimate)
        if tick.offset_ns is not None:
            self._own.add(estimate, tick.offset_ns)
        return jump, self._size.update(estimate)

    def _lost_before(self, estimate: EnfEstimate) -> int:
        """Frames lost before the estimate's tracker began, as those before it have counted."""
        newest_ns, total = self._lost[-1]
        if estimate.slips and estimate.start_pts_ns > newest_ns:
            self._lost.append((estimate.start_pts_ns, total + int(estimate.slip_frames.sum())))
        return next((n for ns, n in reversed(self._lost) if ns < estimate.origin_pts_ns), 0)

    def _moved(self, estimate: EnfEstimate, phase: Phase, tick: Tick) -> np.ndarray | None:
        assert self.evidence is not None
        last, lag_s = self.evidence.last, self.evidence.follows.lag_s
        fits = self._grid.nominal_hz == estimate.nominal_hz
        is_open = estimate.mirror_hz > 0.0  # the sign of the deviation is ambiguous
        if last is None or tick.offset_ns is None or not fits or is_open:
            return None
        passed_s = seconds(phase.t_ns - last.t_ns)
        if passed_s > LONGEST_S:
            return None
        moved = self._grid.moved(last.t_ns + tick.offset_ns, passed_s, lag_s)
        if moved is not None:
            self._compared_ns = phase.t_ns
        return moved

    def _stand(self) -> None:
        assert self.evidence is not None
        limits, nats = self._settings.limits, self.evidence.nats
        if nats >= limits.live:
            self.standing = "live"
        elif nats <= limits.stale:
            self.standing = "stale"
        elif self.evidence.is_wild or nats == 0.0:  # the sum was reset
            self.standing = "undecided"

    def verdict(self, due_ns: int, tick: Tick) -> tuple[str, str]:
        """Return the verdict at a time, and the evidence in words.

        Parameters
        ----------
        due_ns : int
            Stream clock up to which estimates are complete.
        tick : Tick
        """
        if unusable := self._why_no_estimate(due_ns, tick):
            return unusable
        if self.evidence is None:
            return "undecided", "the flicker has only begun to be followed"
        if why := self._why_not_compared(due_ns, tick):
            return "undecided", why
        if self.evidence.is_wild:
            return "undecided", "the phase jumps about as no grid's does"
        nats = self.evidence.nats
        if self.standing == "live":
            course = self.evidence.follows.course
            lag = f"{course.lag_s:+.1f} ± {course.lag_std_s:.1f} s"
            text = f"follows {self._grid.name} at a lag of {lag}"
            return "live", f"{text}, clock {course.clock_ppm:+.1f} ± {course.clock_std_ppm:.1f} ppm"
        if self.standing == "stale":
            return "stale", f"does not follow {self._grid.name} now{self._story()}"
        leaning = "for" if nats > 0 else "against"
        return "undecided", f"{abs(nats):.0f} nats {leaning} following {self._grid.name} so far"

    def _story(self) -> str:
        origin, repeats = self.suspects.origin, self.suspects.repeats
        if repeats is not None:
            return f"; it repeats itself after {repeats.age_s:.1f} s"
        if origin is not None:
            return f"; its picture is {origin.age_s:.1f} ± {origin.std_s:.1f} s old"
        return ""

    def _why_no_estimate(self, due_ns: int, tick: Tick) -> tuple[str, str] | None:
        usable = sum(e.usable for e in self._seen)
        if len(self._seen) >= SEEN // 2 and usable < LEAST_USABLE * len(self._seen):
            return "no_signal", self._seen[-1].reason or "no usable flicker"
        last = self._seen[-1] if self._seen else None
        late_ns = due_ns - (last.end_pts_ns if last else tick.first_pts_ns)
        if late_ns <= (FORGET_NS if last else SEARCH_NS):
            return None
        since = f"for {seconds(late_ns):.0f} s"
        if last and not last.usable:
            return "no_signal", f"no flicker found {since}"
        return "undecided", f"no estimate {since}: the tracker is behind, or gone"

    def _why_not_compared(self, due_ns: int, tick: Tick) -> str:
        """Why recent phases couldn't be compared with the reference; empty if they were."""
        newest = self._seen[-1]
        if self._compared_ns is not None and newest.end_pts_ns - self._compared_ns <= FORGET_NS:
            return ""
        if not self._grid.is_there:
            return "no reference with a known time"
        if tick.offset_ns is None:
            return "nothing tells when the pictures came"
        if newest.usable and newest.nominal_hz != self._grid.nominal_hz:
            return f"light of a {newest.nominal_hz:.0f} Hz grid, reference of another"
        if newest.usable and newest.mirror_hz > 0.0:
            return "the direction of read-out isn't known yet, nor the sign of the ENF's deviation"
        if newest.usable and _phase_of(newest) is None:
            return f"estimates by {newest.method!r} carry no phase"
        behind_s = seconds(due_ns + tick.offset_ns - self._grid.end_ns())
        if behind_s > 0:
            return f"{self._grid.name} ended {behind_s:.0f} s ago"
        return f"{self._grid.name} has a gap"


def _phase_of(estimate: EnfEstimate, lost: int = 0) -> Phase | None:
    """Return the phase of an estimate's second; None if it has no usable one."""
    if not estimate.usable or estimate.points != 1 or estimate.nominal_hz not in (50.0, 60.0):
        return None
    if not estimate.start_pts_ns <= int(estimate.amplitude_pts_ns[0]) <= estimate.end_pts_ns:
        return None
    is_timed = not lost or estimate.frame_rate_hz >= LEAST_RATE_HZ
    if estimate.carrier_hz != 2.0 * estimate.nominal_hz or not is_timed:
        return None
    re, im = float(estimate.amplitude_re[0]), float(estimate.amplitude_im[0])
    power = re**2 + im**2
    variance = float(estimate.amplitude_var_re[0] + estimate.amplitude_var_im[0]) / 2.0
    if not (0.0 < power < math.inf and 0.0 <= variance < math.inf):
        return None
    # Relative to the stream's clock, and as if no frame were lost: trackers may restart.
    turns = round(estimate.carrier_hz) * estimate.origin_pts_ns % NS_PER_S / NS_PER_S
    turns += lost and lost * 2.0 * estimate.enf_hz / estimate.frame_rate_hz
    rad = math.remainder(math.atan2(im, re) - math.tau * turns, math.tau)
    return Phase(int(estimate.amplitude_pts_ns[0]), rad, variance / power)

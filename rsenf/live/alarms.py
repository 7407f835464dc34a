"""Sudden changes of a feed, and the alarms of a camera: one message whenever one begins or ends.

Changes are jumps of the phase, of the flicker's amplitude, and of the idle ratio. Each alarm has a
text for a person.
"""

from __future__ import annotations

import dataclasses
import math
from collections import deque
from dataclasses import dataclass
from typing import Any

import numpy as np

from rsenf.live.bank import TURN_RAD
from rsenf.live.cusum import Cusum, Phase
from rsenf.live.ticks import Tick
from rsenf.medians import median_of_few
from rsenf.messages import Alarm, EnfEstimate, Header, IdleEstimate
from rsenf.timebase import NS_PER_S, seconds

AFTER_S = 3  # seconds of deviation that confirm a jump
FORETOLD_S = range(1, AFTER_S + 3)
SURE_JUMP_STDS = 6.0
LEAST_RAD = 0.4


@dataclass(frozen=True)
class Jump:
    """A phase jump: time on the stream's clock, size, and the limit it exceeded."""

    t_ns: int
    rad: float
    limit_rad: float


class Jumps:
    """Detects jumps in the phases of one epoch."""

    def __init__(self) -> None:
        self._foretold: dict[int, tuple[float, float]] = {}  # predicted phase, variance; by second
        self._from: Phase | None = None
        self._seen: list[Phase] = []

    def update(self, phase: Phase, evidence: Cusum) -> Jump | None:
        """Take a phase; return the jump that it confirms, if any.

        Parameters
        ----------
        phase : Phase
        evidence : Cusum
            Predicts phases. Update it with this phase after this call.
        """
        last = evidence.last
        if last is None:
            return None
        if self._from is None:
            ahead_s = _after_s(last, phase)
            if ahead_s in FORETOLD_S and _is_out(phase, _foretold(evidence, ahead_s)) is not None:
                self._from, self._seen = last, [phase]
                self._foretold = {after_s: _foretold(evidence, after_s) for after_s in FORETOLD_S}
            return None
        self._seen.append(phase)
        if seconds(phase.t_ns - self._from.t_ns) < AFTER_S + 0.5:
            return None
        foretold = [self._foretold.get(_after_s(self._from, p)) for p in self._seen]
        found = [f and _is_out(p, f) for p, f in zip(self._seen, foretold, strict=True)]
        self._from = None
        last_out = found[-1]
        if last_out is None or any(out is None for out in found):
            return None
        return Jump(self._seen[0].t_ns, *last_out)


def _after_s(last: Phase, phase: Phase) -> int:
    return round(seconds(phase.t_ns - last.t_ns))


def _is_out(phase: Phase, foretold: tuple[float, float]) -> tuple[float, float] | None:
    """Return a phase's deviation from its prediction and the limit; None if below the limit."""
    mean, var = foretold
    away = phase.rad - mean
    away -= TURN_RAD * round(away / TURN_RAD)
    limit = max(SURE_JUMP_STDS * math.sqrt(var + phase.var_rad2), LEAST_RAD)
    return (away, limit) if abs(away) > limit else None


def _foretold(evidence: Cusum, after_s: int) -> tuple[float, float]:
    return evidence.any_grid.phase_after(float(after_s))


NEW_S = 8  # newest seconds, which are compared with the OLD_S before
OLD_S = 120
LEAST_S = 30  # least number of earlier seconds
SURE_CHANGE_STDS = 8.0
LEAST_LOG = math.log(1.3)  # clouds and people change the amplitude by less
MAD_TO_STD = 1.4826  # standard deviation of a normal over its median absolute deviation
# Smallest difference of two idle ratios, beside their intervals: a codec shifts them by some tenths
# of a percentage point.
LEAST_IDLE = 0.01


@dataclass(frozen=True)
class Change:
    """A changed quantity: its value, the value before, and the limit that was exceeded."""

    value: float
    before: float
    limit: float


class FlickerSize:
    """Compares the flicker's amplitude with that of the minutes before, on a log scale.

    A change is reported if all of the newest values differ from the median in the same direction,
    by more than 8 robust standard deviations (median absolute deviation) and a factor of 1.3.
    """

    def __init__(self) -> None:
        self._log: deque[float] = deque(maxlen=OLD_S + NEW_S)

    def update(self, estimate: EnfEstimate) -> Change | None:
        """Take an estimate; return the factor by which the amplitude has changed, if it has."""
        size = math.hypot(float(estimate.amplitude_re[0]), float(estimate.amplitude_im[0]))
        if size <= 0.0:
            return None
        self._log.append(math.log(size))
        if len(self._log) < LEAST_S + NEW_S:
            return None
        every = np.array(self._log)
        old, new = every[:-NEW_S], every[-NEW_S:]
        middle = float(median_of_few(old))
        scatter = MAD_TO_STD * float(median_of_few(np.abs(old - middle)))
        limit = max(SURE_CHANGE_STDS * scatter, LEAST_LOG)
        away = new - middle
        if not (np.abs(away) > limit).all() or abs(away.sum()) != np.abs(away).sum():
            return None
        return Change(math.exp(float(np.median(away))), 1.0, math.exp(limit))


class IdlePeriod:
    """Compares each idle estimate with an older one."""

    def __init__(self) -> None:
        self._known: IdleEstimate | None = None

    def update(self, estimate: IdleEstimate) -> Change | None:
        """Take an estimate; return the change, if it is incompatible with the older one."""
        if estimate.verdict != "estimated" or not math.isfinite(estimate.idle_ratio):
            return None
        known = self._known
        if known is None:
            self._known = estimate
            return None
        apart = abs(estimate.idle_ratio - known.idle_ratio)
        limit = max(_half(estimate) + _half(known), LEAST_IDLE)
        # An estimate uses the whole epoch, so after a change it moves slowly. It is therefore
        # compared with an old one, which is replaced only by a much more precise one.
        if apart > limit or _half(estimate) < _half(known) / 2.0:
            self._known = estimate
        return Change(estimate.idle_ratio, known.idle_ratio, limit) if apart > limit else None


def _half(estimate: IdleEstimate) -> float:
    """Return half the width of the 95 % interval."""
    return (estimate.idle_ratio_high - estimate.idle_ratio_low) / 2.0


QUIET_NS = 30 * NS_PER_S  # an instantaneous event ends after this time without repetition


class Alarms:
    """The alarms of one camera."""

    def __init__(self) -> None:
        self._on: dict[str, tuple[Alarm, int | None]] = {}
        self._out: list[Alarm] = []
        self._sent: Header | None = None

    def happened(self, alarm: Alarm, now_ns: int) -> None:
        """Raise an alarm for an instantaneous event; it ends by itself QUIET_NS later."""
        self._raise(alarm, now_ns + QUIET_NS)

    def holds(self, alarm: Alarm) -> None:
        """Raise an alarm that lasts until :meth:`over`."""
        self._raise(alarm, None)

    def _raise(self, alarm: Alarm, until_ns: int | None) -> None:
        if alarm.kind not in self._on:
            self._send(alarm)
        first = self._on[alarm.kind][0] if alarm.kind in self._on else alarm
        self._on[alarm.kind] = first, until_ns

    def over(self, kind: str, header: Header, now_ns: int, **values: Any) -> None:
        """End an alarm, with fields that tell more by now; does nothing if it isn't active."""
        if kind in self._on:
            alarm, _ = self._on.pop(kind)
            values |= {"header": header, "active": False, "end_pts_ns": now_ns}
            self._send(dataclasses.replace(alarm, **values))

    def pass_by(self, header: Header, now_ns: int) -> None:
        """End instantaneous alarms that have expired, by the stream's clock."""
        for kind, (_, until_ns) in list(self._on.items()):
            if until_ns is not None and now_ns >= until_ns:
                self.over(kind, header, now_ns)

    def new_epoch(self, header: Header, now_ns: int) -> None:
        """End all alarms but 'lost', which the next picture ends: the stream's clock is reset."""
        for kind in [kind for kind in self._on if kind != "lost"]:
            self.over(kind, header, now_ns)

    def taken(self) -> list[Alarm]:
        """Return the messages since the last call."""
        out, self._out = self._out, []
        return out

    def _send(self, alarm: Alarm) -> None:
        self._sent = numbered_after(self._sent, alarm.header)
        self._out.append(dataclasses.replace(alarm, header=self._sent))


def numbered_after(last: Header | None, header: Header) -> Header:
    """Return ``header`` with the sequence number after ``last``; 0 in a new run or epoch."""
    is_new = last is None or (last.run_id, last.epoch) != (header.run_id, header.epoch)
    return header.numbered(0 if last is None or is_new else last.seq + 1)


def idle_changed(change: Change, tick: Tick) -> Alarm:
    """Return the alarm for a changed idle ratio."""
    text = f"idle period {100 * change.before:.1f} % before, {100 * change.value:.1f} % now"
    return Alarm(
        header=tick.header, kind="idle_changed", start_pts_ns=tick.pts_ns, end_pts_ns=tick.pts_ns,
        value=change.value, limit=change.limit, text=f"{text}: another camera, or another mode",
    )  # fmt: skip


def phase_jump(jump: Jump, tick: Tick) -> Alarm:
    """Return the alarm for a phase jump."""
    text = f"the phase jumped by {jump.rad:+.2f} rad"
    return Alarm(
        header=tick.header, kind="phase_jump", start_pts_ns=jump.t_ns, end_pts_ns=jump.t_ns,
        value=jump.rad, limit=jump.limit_rad, unit="rad",
        text=f"{text}: a splice, frames lost or sent twice, or another exposure",
    )  # fmt: skip


def frames_slipped(estimate: EnfEstimate, tick: Tick) -> Alarm:
    """Return the alarm for lost or repeated frames, which the tracker has detected and counted."""
    at_ns, frames = estimate.start_pts_ns, estimate.slip_frames.tolist()
    lost, again = sum(max(n, 0) for n in frames), sum(max(-n, 0) for n in frames)
    count = [f"{n} {what}" for n, what in ((lost, "lost"), (again, "sent twice")) if n]
    text = (
        f"frames {' and '.join(count)} at frame {', '.join(map(str, estimate.slip_frame.tolist()))}"
    )
    return Alarm(
        header=tick.header, kind="phase_jump", start_pts_ns=at_ns, end_pts_ns=at_ns,
        value=float(lost + again), unit="frames",
        text=f"{text}, by the jump of the phase; a splice may look alike",
    )  # fmt: skip


def light_changed(change: Change, estimate: EnfEstimate, tick: Tick) -> Alarm:
    """Return the alarm for a changed flicker amplitude."""
    at_ns = estimate.start_pts_ns
    text = f"the flicker is {change.value:.2f} times what it was: another lamp, or another view"
    return Alarm(
        header=tick.header, kind="light_changed", start_pts_ns=at_ns, end_pts_ns=at_ns,
        value=change.value, limit=change.limit, text=text,
    )  # fmt: skip

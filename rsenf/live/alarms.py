"""Alarm messages of a camera, with a text for a person: one whenever an alarm begins or ends."""

from __future__ import annotations

import dataclasses
from typing import Any

from rsenf.live.changes import Change, Jump
from rsenf.live.ticks import Tick
from rsenf.messages import Alarm, EnfEstimate, Header
from rsenf.timebase import NS_PER_S

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

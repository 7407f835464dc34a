"""Alarm messages of instantaneous events, with a text for a person."""

from __future__ import annotations

from rsenf.live.jumps import Jump
from rsenf.live.light import Change
from rsenf.live.ticks import Tick
from rsenf.messages import Alarm, EnfEstimate


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
    told = [f"{n} {what}" for n, what in ((lost, "lost"), (again, "sent twice")) if n]
    text = (
        f"frames {' and '.join(told)} at frame {', '.join(map(str, estimate.slip_frame.tolist()))}"
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

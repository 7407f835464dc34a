"""The stage of liveness detection: takes rows, estimates and a reference; sends verdicts, alarms.

Each tick (second of pictures) is processed once its estimates and the reference have arrived, or
have been waited for long enough. Estimates are used up to 16 s before the tick.
"""

from __future__ import annotations

import dataclasses
import math
from bisect import insort
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from itertools import islice
from typing import Any

from rsenf.live.alarms import (
    Alarms,
    IdlePeriod,
    frames_slipped,
    idle_changed,
    light_changed,
    numbered_after,
    phase_jump,
)
from rsenf.live.judge import Judge
from rsenf.live.past import GrowingGrid, OwnPast
from rsenf.live.picture import PictureFacts
from rsenf.live.settings import LiveSettings
from rsenf.live.ticks import Tick, Ticker
from rsenf.messages import (
    Alarm,
    EnfEstimate,
    Header,
    IdleEstimate,
    Liveness,
    ReferenceBlock,
    RowBlock,
)
from rsenf.stage import ALONE
from rsenf.timebase import NS_PER_S, nanoseconds

BEHIND_NS = 16 * NS_PER_S  # largest delay of a tracker's estimate
# Longest wait for late messages, in arrival time of the pictures. Estimates are late while a
# tracker is still searching for flicker.
ESTIMATES_PATIENCE_NS, REFERENCE_PATIENCE_NS = 3 * NS_PER_S, 30 * NS_PER_S
MOST_WAITING, MOST_RUNS = 3600, 4  # pending ticks and estimates (an hour), and runs of these
NEVER_NS = -(2**63)
LN10 = math.log(10.0)


@dataclass(frozen=True)
class Silence:
    """Notice that no picture has arrived for ``lost_s``, or none yet; sent by the stage's caller.

    The header is used for the verdict if there has been no picture at all.
    """

    header: Header


class Live:
    """Judges one camera. A :class:`rsenf.stage.Stage`.

    Parameters
    ----------
    settings : LiveSettings, optional
    start_utc_ns : int
        Time of the first picture for recordings and simulations; 0 to use arrival times.
    on_late : callable
        Called with the newest rows' time, ns, when an input came about when its time was over: the
        next verdict depends on which of the two came first.
    """

    def __init__(
        self, settings: LiveSettings | None = None, *, start_utc_ns: int = 0,
        on_late: Callable[[int], None] = ALONE.late,
    ) -> None:  # fmt: skip
        self.settings = settings or LiveSettings()
        self._on_late = on_late
        self._ticker = Ticker(self.settings, start_utc_ns)
        self._grid = GrowingGrid(self.settings.keep_hours)
        self._own = OwnPast(self.settings.keep_hours)
        self._idle_period, self._alarms = IdlePeriod(), Alarms()
        self._ticks: deque[Tick] = deque()
        self._estimates: dict[tuple[str, int], list[EnfEstimate]] = {}  # by run, in order of time
        self._idles: deque[IdleEstimate] = deque(maxlen=MOST_WAITING)
        self._known: tuple[tuple[str, int], int] | None = None  # run and end of the newest estimate
        self._frames: deque[tuple[int, int]] = deque()  # time and number of each tick's last frame
        self._judge = Judge(self.settings, self._grid, self._own)
        self._done: Tick | None = None
        self._taken_ns = NEVER_NS  # end of the newest estimate taken in this epoch
        self._said: Liveness | None = None
        self._sent: Header | None = None
        self._is_reference_late = self._is_lost = False
        self._is_held = False  # a second came while lost that may be from before the outage

    def update(
        self, message: RowBlock | EnfEstimate | IdleEstimate | ReferenceBlock | Silence
    ) -> list[Liveness | Alarm]:
        """Take a message; return the verdicts and alarms that it completes."""
        if isinstance(message, ReferenceBlock):
            if self._is_reference_late:
                self._note_late()
            self._grid.add(message)
        elif isinstance(message, EnfEstimate):
            if message.rank == 0:
                if self._is_late(message):
                    self._note_late()
                self._keep(message)
        elif isinstance(message, IdleEstimate):
            self._idles.append(message)
        elif isinstance(message, Silence):
            return self._advance(to_end=True) + self._lose(message.header)
        elif tick := self._ticker.add(message):
            self._ticks.append(tick)
        return self._advance()

    def _keep(self, estimate: EnfEstimate) -> None:
        """Queue an estimate for its tick; the queue is bounded, as pictures may stay away."""
        run = self._run_of(estimate.header)
        waiting = self._estimates.setdefault(run, [])
        insort(waiting, estimate, key=lambda e: e.end_pts_ns)
        del waiting[MOST_WAITING:]
        while len(self._estimates) > MOST_RUNS:
            del self._estimates[next(iter(self._estimates))]
        self._known = run, estimate.end_pts_ns

    def _note_late(self) -> None:
        if newest := self._ticks[-1] if self._ticks else self._done:
            self._on_late(newest.pts_ns)

    def _is_late(self, estimate: EnfEstimate) -> bool:
        """Whether a tick was processed, or was soon to be, without this estimate."""
        done, end_ns = self._done, estimate.end_pts_ns
        if done and end_ns > self._taken_ns and end_ns < done.pts_ns - BEHIND_NS - NS_PER_S:
            return self._run_of(estimate.header) == done.run
        waiting = [tick for tick in islice(self._ticks, 1) if not self._has_estimates(tick)]
        return any(self._waited_ns(tick) > ESTIMATES_PATIENCE_NS // 2 for tick in waiting)

    def _run_of(self, header: Header) -> tuple[str, int]:
        """Return run and epoch of the pictures that an estimate is of.

        A tracker that was restarted extends the name of their run by one of its own.
        """
        own, extended = (header.run_id, header.epoch), header.run_id.rpartition(".")[0]
        of = self._ticker.run, self._done and self._done.run
        return own if own in of or (extended, header.epoch) not in of else (extended, header.epoch)

    def flush(self) -> list[Liveness | Alarm]:
        """Return the verdicts on the rest of the stream. A feed that is lost stays so."""
        out = self._advance(to_end=True)
        if self._done is not None and not self._is_lost:
            end = dataclasses.replace(self._done, silent_s=0.0)
            out += self._process(end, end.pts_ns)
        return out

    def _advance(self, *, to_end: bool = False) -> list[Liveness | Alarm]:
        """Process the pending ticks that are ready, or all."""
        out: list[Liveness | Alarm] = []
        while self._ticks and (to_end or self._is_ready(self._ticks[0])):
            tick = self._ticks.popleft()
            out += self._process(tick, tick.pts_ns - BEHIND_NS)
        return out

    def _is_ready(self, tick: Tick) -> bool:
        """Whether all data for a tick has arrived, or the waiting time is over."""
        due_ns = tick.pts_ns - BEHIND_NS
        if due_ns <= tick.first_pts_ns:
            return True
        is_over = self._waited_ns(tick) > ESTIMATES_PATIENCE_NS
        return self._has_reference(tick, due_ns) and (is_over or self._has_estimates(tick))

    def _has_estimates(self, tick: Tick) -> bool:
        """Whether the estimates for a tick have arrived."""
        if self._known is None:
            return False
        run, end_ns = self._known
        is_past = run == self._ticks[-1].run != tick.run
        return is_past or (run == tick.run and end_ns >= tick.pts_ns - BEHIND_NS - NS_PER_S)

    def _waited_ns(self, tick: Tick) -> int:
        if len(self._ticks) > MOST_WAITING:
            return max(ESTIMATES_PATIENCE_NS, REFERENCE_PATIENCE_NS) + 1
        return self._ticks[-1].header.arrival_time_ns - tick.header.arrival_time_ns

    def _has_reference(self, tick: Tick, due_ns: int) -> bool:
        """Whether the reference has arrived, or the waiting time for it is over."""
        if tick.offset_ns is None:
            return True
        ahead_ns = nanoseconds(max(-self.settings.earliest_s, 0.0))
        if self._grid.covers(due_ns + tick.offset_ns + ahead_ns):
            self._is_reference_late = False
        elif self._waited_ns(tick) > REFERENCE_PATIENCE_NS:
            self._is_reference_late = True
        else:
            return self._is_reference_late
        return True

    def _process(self, tick: Tick, due_ns: int) -> list[Liveness | Alarm]:
        out: list[Liveness | Alarm] = []
        if tick.silent_s and not self._is_lost:
            out += self._lose(tick.header)
        done = self._done
        is_anew = done is None or done.part != tick.part
        if is_anew:
            self._begin_epoch(tick)
        # Rows of before the outage may come once it is over, or known: less than a second of them.
        is_back = is_anew or bool(tick.silent_s) or self._is_held
        self._is_held = self._is_lost and not is_back
        if self._is_lost and is_back:
            self._is_lost = False
            outage_s = tick.silent_s
            length = (
                {"text": f"no picture for {outage_s:.1f} s", "value": outage_s} if outage_s else {}
            )
            self._alarms.over("lost", tick.header, tick.pts_ns, **length)
        self._done = tick
        self._grid.reach(tick.utc_ns)
        self._take_idle(tick, due_ns)
        waiting = self._estimates.get(tick.run, [])
        while waiting and _is_due(waiting[0], tick, due_ns):
            estimate = waiting.pop(0)
            # A restarted tracker tells of the past again, any of the time before a clock was set.
            if estimate.end_pts_ns > self._taken_ns and estimate.start_pts_ns >= tick.first_pts_ns:
                self._taken_ns = estimate.end_pts_ns
                self._take(estimate, tick)
        self._alarms.pass_by(tick.header, tick.pts_ns)
        said = [] if self._is_lost else self._conclude(tick, due_ns)
        return [*out, *self._alarms.taken(), *said]

    def _begin_epoch(self, tick: Tick) -> None:
        """Reset the judge: the new epoch may be of another feed."""
        if self._done is not None:
            self._alarms.new_epoch(self._done.header, self._done.pts_ns)
            self._estimates.pop(self._done.run, None)
        self._judge = Judge(self.settings, self._grid, self._own)
        self._frames.clear()
        self._taken_ns = NEVER_NS
        self._said = None

    def _take_idle(self, tick: Tick, due_ns: int) -> None:
        self._frames.append((tick.pts_ns, tick.header.frame_last))
        while len(self._frames) > 1 and self._frames[1][0] <= due_ns:
            self._frames.popleft()
        at_ns, frame = self._frames[0]
        while self._idles and at_ns <= due_ns:
            header = self._idles[0].header
            if self._run_of(header) == tick.run and header.frame_last > frame:
                return
            change = self._idle_period.update(self._idles.popleft())
            if change:
                self._alarms.happened(idle_changed(change, tick), tick.pts_ns)

    def _take(self, estimate: EnfEstimate, tick: Tick) -> None:
        jump, change = self._judge.update(estimate, tick)
        if estimate.slips and estimate.usable:
            self._alarms.happened(frames_slipped(estimate, tick), tick.pts_ns)
        if jump:
            self._alarms.happened(phase_jump(jump, tick), tick.pts_ns)
        if change:
            self._alarms.happened(light_changed(change, estimate, tick), tick.pts_ns)

    def _conclude(self, tick: Tick, due_ns: int) -> list[Liveness | Alarm]:
        judge, facts = self._judge, tick.facts
        verdict, evidence = judge.verdict(due_ns, tick)
        if verdict == "stale":
            judge.suspects.search(tick, self._grid)
            verdict, evidence = judge.verdict(due_ns, tick)
        if facts.loop_since_ns is not None:
            again = f"its pictures come again after {facts.period_s:.2f} s, alike to the last bit"
            verdict, evidence = "stale", again
        if facts.frozen_since_ns is not None:
            stood_s = (tick.pts_ns - facts.frozen_since_ns) / NS_PER_S
            verdict, evidence = "frozen", f"the same picture for {stood_s:.0f} s"
        if tick.dropped and verdict not in ("stale", "frozen"):
            verdict = "undecided"
            evidence = f"not judged: rsenf is behind: {tick.dropped} frames dropped"
        since_ns = judge.suspects.since_ns
        self._hold("frozen", verdict == "frozen", tick, evidence, facts.frozen_since_ns)
        self._hold("stale", verdict == "stale", tick, evidence, facts.loop_since_ns or since_ns)
        repeats = judge.suspects.repeats if verdict == "stale" else None
        period_s = repeats.age_s if repeats else facts.period_s
        loop_ns = facts.loop_since_ns or since_ns
        self._hold("loop", math.isfinite(period_s), tick, evidence, loop_ns, period_s)
        is_last = due_ns == tick.pts_ns
        return [*self._alarms.taken(), *self._say(verdict, evidence, tick, always=is_last)]

    def _hold(
        self,
        kind: str,
        is_so: bool,
        tick: Tick,
        text: str,
        since_ns: int | None,
        period_s: float = math.nan,
    ) -> None:
        """Raise an alarm with its start, or end it."""
        if not is_so:
            self._alarms.over(kind, tick.header, tick.pts_ns)
            return
        start_ns = tick.pts_ns if since_ns is None else since_ns
        unit = "s" if math.isfinite(period_s) else ""
        self._alarms.holds(
            Alarm(
                header=tick.header, kind=kind, severity="alarm", start_pts_ns=start_ns,
                end_pts_ns=tick.pts_ns, value=period_s, unit=unit, text=text,
            )
        )  # fmt: skip

    def _say(
        self, verdict: str, evidence: str, tick: Tick, *, always: bool = False
    ) -> list[Liveness | Alarm]:
        said = self._said
        is_new = said is None or said.verdict != verdict
        if said and not (is_new or always or self._is_due_to_report(tick, said)):
            return []
        message = Liveness(
            header=numbered_after(self._sent, tick.header),
            verdict=verdict,
            since_ns=tick.utc_ns if said is None or is_new else said.since_ns,
            log10_lr=self._judge.evidence.nats / LN10 if self._judge.evidence else math.nan,
            evidence=evidence,
            **self._lag(verdict, tick),
        )
        self._said, self._sent = message, message.header
        return [message]

    def _lag(self, verdict: str, tick: Tick) -> dict[str, Any]:
        """Return a verdict's fields about lag and clock error."""
        running, origin = self._judge.evidence, self._judge.suspects.origin
        if verdict == "live" and running:
            return vars(running.follows.course)
        if verdict == "stale" and origin:
            taken_ns = tick.utc_ns - nanoseconds(origin.age_s)
            return {"lag_s": origin.age_s, "lag_std_s": origin.std_s, "origin_utc_ns": taken_ns}
        return {}

    def _is_due_to_report(self, tick: Tick, said: Liveness) -> bool:
        since_ns = tick.header.pts_ns - said.header.pts_ns
        # Minus half a second: ticks come with blocks of frames, at slightly irregular times.
        return since_ns >= nanoseconds(self.settings.report_every_s) - NS_PER_S // 2

    def _lose(self, header: Header) -> list[Liveness | Alarm]:
        """Report a lost feed once; independent of when the loss was noticed."""
        if self._is_lost:
            return []
        self._is_lost = True
        limit_s, tick = self.settings.lost_s, self._done
        text = f"no picture for more than {limit_s:g} s"
        if tick is None:
            text = "no picture yet"
            tick = Tick(header, header.pts_ns, header.pts_ns, None, PictureFacts(), part=0)
        self._alarms.holds(
            Alarm(
                header=tick.header,
                kind="lost",
                severity="alarm",
                start_pts_ns=tick.pts_ns,
                end_pts_ns=tick.pts_ns,
                limit=limit_s,
                unit="s",
                text=text,
            )
        )
        return [*self._alarms.taken(), *self._say("undecided", text, tick)]


def _is_due(estimate: EnfEstimate, tick: Tick, due_ns: int) -> bool:
    """Whether an estimate belongs to a tick, by its time and its arrival.

    A tracker that has just found flicker sends the estimates of all earlier seconds at once.
    """
    later_ns = estimate.header.arrival_time_ns - tick.header.arrival_time_ns
    return estimate.end_pts_ns <= due_ns and not 0 < later_ns < ESTIMATES_PATIENCE_NS

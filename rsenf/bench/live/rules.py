"""The live stage and the literature's rule on one feed, each at several limits."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

from rsenf.bench.live.correlation import LIMIT, sliding_correlation
from rsenf.bench.live.onsets import onsets
from rsenf.bench.live.watched import Watch
from rsenf.live import Live
from rsenf.live.settings import Limits, LiveSettings
from rsenf.messages import Alarm, Liveness

# Nats from the surest "live" down to "stale", for the trade-off; the fitted one comes besides.
NATS = (6.0, 9.0, 13.0, 19.0, 28.0, 40.0, 57.0)
CORRELATIONS = (-0.5, 0.0, 0.3, 0.5, 0.7, LIMIT, 0.9, 0.95)
WRONG = ("stale", "frozen")
INFO = "info"


@dataclass
class Said:
    """What the live stage said of a feed; times in seconds since its first rows came.

    Attributes
    ----------
    verdicts : list of (float, str)
        Each change.
    alarms : list of (float, str, str)
        Beginning of each that is more than a note: its kind, and its line for a person.
    """

    verdicts: list[tuple[float, str]] = field(default_factory=list)
    alarms: list[tuple[float, str, str]] = field(default_factory=list)

    @property
    def wrong_s(self) -> list[float]:
        """When the verdict became one of :data:`WRONG`."""
        return onsets((t_s, verdict in WRONG) for t_s, verdict in self.verdicts)

    @property
    def alarm_s(self) -> list[float]:
        """When an alarm began, or the verdict became one of :data:`WRONG`."""
        return sorted([*self.wrong_s, *(t_s for t_s, _, _ in self.alarms)])

    def seconds_of(self, verdict: str, begin_s: float, end_s: float) -> float:
        """How long a verdict stood between two times."""
        ends = [*(t_s for t_s, _ in self.verdicts[1:]), end_s]
        spans = zip(self.verdicts, ends, strict=True) if self.verdicts else ()
        return sum(
            max(min(stop_s, end_s) - max(t_s, begin_s), 0.0)
            for (t_s, said), stop_s in spans
            if said == verdict
        )

    def at(self, t_s: float) -> str:
        """Verdict that stood at a time; empty before the first."""
        return next((said for since_s, said in reversed(self.verdicts) if since_s <= t_s), "")


def live_at(nats: float, settings: LiveSettings | None = None) -> LiveSettings:
    """Return settings whose limits, all in proportion, are so far from "live" to "stale"."""
    settings = settings or LiveSettings()
    factor = nats / span_of(settings.limits)
    scaled = {name: value * factor for name, value in dataclasses.asdict(settings.limits).items()}
    return dataclasses.replace(settings, limits=Limits(**scaled))


def span_of(limits: Limits) -> float:
    """Nats from the surest "live" down to "stale"."""
    return limits.most - limits.stale


def said_live(watch: Watch, settings: LiveSettings) -> Said:
    """Have the live stage watch a feed."""
    stage, said = Live(settings), Said()
    for message in watch.messages:
        t_s = watch.since_begin_s(message.header.arrival_time_ns)
        for out in stage.update(message):
            _note(said, t_s, out)
    return said


def _note(said: Said, t_s: float, out: Any) -> None:
    if isinstance(out, Liveness):
        if not said.verdicts or said.verdicts[-1][1] != out.verdict:
            said.verdicts.append((t_s, out.verdict))
    elif isinstance(out, Alarm) and out.active and out.severity != INFO:
        said.alarms.append((t_s, out.kind, out.text))


def said_correlation(watch: Watch, limits: Sequence[float]) -> Iterator[tuple[float, list[float]]]:
    """Yield limits of the correlation with the times at which it fell below them.

    Where camera or reference stands still there is no correlation, which is below any limit.
    """
    found = [
        (watch.since_begin_s(host_ns), value)
        for host_ns, value in sliding_correlation(watch.messages)
    ]
    for limit in limits:
        yield limit, onsets((t_s, not value >= limit) for t_s, value in found)

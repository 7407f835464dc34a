"""One ENF method on hours of rows: processor time, and memory beyond what it began with."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Any

from rsenf.bench.memory import HELD, PEAK, memory_mb, restart_peak
from rsenf.bench.tracker.light import Light
from rsenf.stage import Stage
from rsenf.track import TrackSettings, make_tracker

WARM_UP_S = 45.0  # until flicker is found and windows are full


@dataclass(frozen=True)
class Hour:
    """A method on rows of one kind.

    Parameters
    ----------
    method : str
    rows : int
    frame_rate_hz : float
    parts, part_s : int, float
        How often, and how much video each time.
    settings : dict
        Of the tracker, beside its method.
    """

    method: str
    rows: int
    frame_rate_hz: float
    parts: int
    part_s: float
    settings: dict[str, Any] = field(default_factory=dict)

    @property
    def key(self) -> str:
        """Name that tells it from any other."""
        given = "".join(f" {name}={value}" for name, value in self.settings.items())
        size = f"{self.rows} rows {self.frame_rate_hz:g} fps"
        return f"{self.method}{given} {size} {self.parts} x {self.part_s:g} s"

    def measure(self, seed: int) -> dict[str, Any]:
        """Run it; the first seconds, in which flicker is still looked for, don't count."""
        light = Light(self.rows, self.frame_rate_hz, seed)
        held_mb = memory_mb(HELD)
        restart_peak()
        stage = make_tracker(TrackSettings(method=self.method, **self.settings))
        spent_s(stage, light.blocks(0.0, WARM_UP_S))
        cpu_s = [
            spent_s(stage, light.blocks(WARM_UP_S + k * self.part_s, self.part_s))
            for k in range(self.parts)
        ]
        peak_mb = memory_mb(PEAK)
        return {
            "method": self.method,
            "settings": self.settings,
            "rows": self.rows,
            "frame_rate_hz": self.frame_rate_hz,
            "hours": self.parts * self.part_s / 3600.0,
            "cpu_s_per_hour": [one * 3600.0 / self.part_s for one in cpu_s],
            "peak_mb": peak_mb - held_mb if peak_mb and held_mb else None,
        }


def spent_s(stage: Stage, messages: Any, out: list[Any] | None = None) -> float:
    """Feed a stage; return the processor time that it took for itself."""
    total_s = 0.0
    for message in messages:
        begun_s = time.process_time()
        made = stage.update(message)
        total_s += time.process_time() - begun_s
        if out is not None:
            out += made
    return total_s

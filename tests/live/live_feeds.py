"""Feeds second by second, honest and not, with the reference of the grid they are on.

Estimates are made of the light's phase itself, as a tracker would, 15 s behind the pictures; the
pictures are four rows of noise, for only whether they repeat is asked of them.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable, Iterator
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsenf.live import Live
from rsenf.messages import Alarm, EnfEstimate, Header, Liveness, ReferenceBlock, RowBlock
from rsenf.model import GridPath, synthetic_grid

T0_NS = 1_700_000_000_000_000_000
NS = 1_000_000_000
GRID_S = 2400
START_S = 900.0  # of the feeds, on the grid
AHEAD_S = 15  # pictures that a tracker has seen beyond the second that it tells of
RATE = 4  # frames a second: enough to be told apart
Float = NDArray[np.float64]


@lru_cache(maxsize=4)
def grid_hz(seed: int = 3) -> Float:
    path = synthetic_grid(seed, GRID_S + 2.0)
    return np.asarray(np.diff(path.cycles(np.arange(GRID_S + 1.0))))


def reference(
    first: int = 0, until: int = GRID_S, *, total: int = GRID_S, seed: int = 3
) -> ReferenceBlock:
    freq = grid_hz(seed)[first:until]
    return ReferenceBlock(
        header=Header(source="reference/ce"), grid="ce", nominal_hz=50.0, t0_ns=T0_NS,
        step_ns=NS, first=first, samples=freq.size, total=total, freq_hz=freq,
        readings=np.ones(freq.size, np.uint32),
    )  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Camera:
    """What a feed shows.

    ``filmed`` tells from when the picture of each second of the feed is, in seconds of it: itself
    where the feed is honest. ``picture`` numbers the pictures of frames, by their times.
    """

    filmed: Callable[[float], float] = lambda t_s: t_s
    picture: Callable[[float], float] = lambda t_s: t_s
    size: Callable[[float], float] = lambda _: 6.0
    usable: Callable[[float], bool] = lambda _: True
    clock_ppm: float = 20.0
    noise_rad: float = 0.02
    late_s: float = 0.3
    epoch: int = 0
    start_s: float = START_S
    seed: int = 1

    def header(self, t_s: float, number: int) -> Header:
        arrival_ns = T0_NS + round((self.start_s + t_s + self.late_s) * NS)
        return Header(
            run_id="r", source="lab/cam", epoch=self.epoch, seq=number, pts_ns=round(t_s * NS),
            frame_first=number * RATE, frame_last=number * RATE + RATE - 1,
            arrival_time_ns=arrival_ns,
        )  # fmt: skip

    def rows(self, second: int) -> RowBlock:
        t_s = second + np.arange(RATE) / RATE
        pictures = [np.random.default_rng(round(1000 * self.picture(t))) for t in t_s.tolist()]
        level = np.array([rng.normal(120, 1, (4, 1)) for rng in pictures], np.float32)
        return RowBlock(
            header=self.header(float(second), second), frames=RATE, rows=4, strips=1,
            frame_number=second * RATE + np.arange(RATE),
            frame_pts_ns=np.round(t_s * NS).astype(np.int64), level=level,
            kept_px=np.ones((4, 1), np.uint32),
        )  # fmt: skip

    def estimate(self, second: int, made_at: int) -> EnfEstimate:
        path = GridPath(grid_hz(), 1.0, 0.0)
        t_s = second + 0.5
        at_s = self.start_s + self.filmed(t_s)
        rng = np.random.default_rng([self.seed, second])
        cycles = 2.0 * (float(path.cycles(np.array([at_s]))[0]) - 50.0 * at_s)
        phase = 2.0 * math.pi * (cycles + 100.0 * (at_s - self.start_s - t_s))
        phase -= 2.0 * math.pi * 100.0 * 1e-6 * self.clock_ppm * t_s
        phase += self.noise_rad * rng.standard_normal()
        enf = float(path.frequency_hz(np.array([at_s]))[0]) * (1.0 - 1e-6 * self.clock_ppm)
        own, size = np.array([(self.noise_rad * self.size(t_s)) ** 2]), self.size(t_s)
        arrival_ns = self.header(float(made_at), made_at).arrival_time_ns
        header = dataclasses.replace(self.header(float(second), second), arrival_time_ns=arrival_ns)
        blank = EnfEstimate(
            header=header, method="made", nominal_hz=50.0, start_pts_ns=second * NS,
            end_pts_ns=(second + 1) * NS, reason="no mains flicker stands out",
        )  # fmt: skip
        if not self.usable(t_s):
            return blank
        return dataclasses.replace(
            blank, usable=True, reason="", enf_hz=enf, enf_var_hz2=1e-7, carrier_hz=100.0,
            points=1, amplitude_pts_ns=np.array([round(t_s * NS)]),
            amplitude_re=np.array([size * math.cos(phase)]),
            amplitude_im=np.array([size * math.sin(phase)]),
            amplitude_var_re=own, amplitude_var_im=own, amplitude_cov=np.zeros(1),
        )  # fmt: skip

    def messages(self, seconds: int) -> Iterator[Any]:
        """All that a camera's stages send, in the order in which it comes."""
        for second in range(seconds):
            yield self.rows(second)
            if second >= AHEAD_S:
                yield self.estimate(second - AHEAD_S, second)
        for second in range(max(seconds - AHEAD_S, 0), seconds):
            yield self.estimate(second, seconds - 1)


@dataclasses.dataclass(frozen=True)
class Said:
    """What the stage says."""

    verdicts: list[Liveness]
    alarms: list[Alarm]

    @property
    def story(self) -> list[str]:
        """Verdicts, each once until another comes."""
        names = [v.verdict for v in self.verdicts]
        return [n for i, n in enumerate(names) if i == 0 or n != names[i - 1]]

    def first(self, verdict: str) -> Liveness:
        return next(v for v in self.verdicts if v.verdict == verdict)

    def alarms_of(self, kind: str) -> list[Alarm]:
        return [a for a in self.alarms if a.kind == kind]


def said(messages: Iterable[Any], stage: Live | None = None) -> Said:
    live = stage or Live()
    out = [one for message in messages for one in live.update(message)] + live.flush()
    return Said(
        [m for m in out if isinstance(m, Liveness)], [m for m in out if isinstance(m, Alarm)]
    )


def looped(from_s: float, length_s: float) -> Callable[[float], float]:
    """From a time on, the stretch before it again and again."""
    return lambda t: t if t < from_s else from_s - length_s + (t - from_s) % length_s

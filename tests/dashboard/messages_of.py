"""What a graph would send of a camera, second by second, made up: rows, estimates, verdicts."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from rsenf.bus.keys import camera_key, health_key, reference_key
from rsenf.messages import (
    Alarm,
    EnfEstimate,
    Header,
    Health,
    IdleEstimate,
    Liveness,
    MatchResult,
    ReferenceBlock,
    RowBlock,
    VideoPacket,
)

START_NS = 1_790_000_000_000_000_000
S = 1_000_000_000
RATE_HZ, ROWS, IDLE = 29.97, 180, 0.38
SITE = "house"

Sent = tuple[str, Any]


def grid_hz(seconds: int, seed: int = 1) -> NDArray[np.float64]:
    """A grid's frequency that wanders about 50 Hz."""
    steps = np.random.default_rng(seed).normal(0, 0.0016, seconds)
    path = np.zeros(seconds)
    for k in range(1, seconds):
        path[k] = 0.995 * path[k - 1] + steps[k]
    return 50.0 + path


class Camera:
    """One camera under the light of a grid.

    Parameters
    ----------
    name : str
    enf_hz : ndarray
        Of each second.
    start_ns : int
        Wall clock at its first frame.
    run_id : str
        Of its source.
    """

    def __init__(
        self,
        name: str,
        enf_hz: NDArray[np.float64],
        start_ns: int = START_NS,
        run_id: str = "a",
        seed: int = 0,
    ) -> None:
        self.name, self.start_ns, self.run_id = name, start_ns, run_id
        self._enf_hz, self._rng = enf_hz, np.random.default_rng(seed)
        self._texture = 90 + 40 * self._rng.random(ROWS)
        self._turns = np.concatenate([[0.0], np.cumsum(2 * enf_hz)])
        self._frame = 0
        self.epoch = 0

    def header(self, topic_seq: int, second: float, **more: Any) -> Header:
        t_ns = round(second * S)
        return Header(
            run_id=self.run_id, source=f"{SITE}/{self.name}", epoch=self.epoch, seq=topic_seq,
            pts_ns=t_ns, arrival_time_ns=self.start_ns + t_ns, **more,
        )  # fmt: skip

    def key(self, topic: str) -> str:
        return camera_key(SITE, self.name, topic)

    def rows(self, second: int) -> Sent:
        """The row block of a second."""
        last = math.ceil((second + 1) * RATE_HZ)
        number = np.arange(self._frame, last)
        self._frame = last
        t_s = number / RATE_HZ
        seen_s = t_s[:, None] + np.arange(ROWS) / ROWS * (1 - IDLE) / RATE_HZ
        turns = np.interp(seen_s, np.arange(self._turns.size), self._turns)
        noise = self._rng.normal(0, 0.15, seen_s.shape)
        level = self._texture * (1 + 0.02 * np.cos(2 * np.pi * turns)) + noise
        block = RowBlock(
            header=self.header(
                second, t_s[0], frame_first=int(number[0]), frame_last=int(number[-1])
            ),
            frames=len(number), rows=ROWS, strips=1, frame_number=number,
            frame_pts_ns=np.rint(t_s * S).astype(np.int64),
            level=level[:, :, None].astype(np.float32),
            kept_px=np.full((ROWS, 1), 300, np.uint32), steady_ratio=0.93,
        )  # fmt: skip
        return self.key("rows"), block

    def enf(self, second: int, *, usable: bool = True) -> Sent:
        """The estimate of a second."""
        std_hz = 0.0004
        estimate = EnfEstimate(
            header=self.header(second, second), method="projection", nominal_hz=50.0,
            start_pts_ns=second * S, end_pts_ns=(second + 1) * S, frame_rate_hz=RATE_HZ,
            enf_hz=float(self._enf_hz[second] + self._rng.normal(0, std_hz)),
            enf_var_hz2=std_hz**2, snr_db=31.0 + self._rng.normal(0, 0.5), usable=usable,
            reason="" if usable else "no mains flicker stands out",
        )  # fmt: skip
        return self.key("track"), estimate

    def idle(self, second: int) -> Sent:
        return self.key("idle"), IdleEstimate(
            header=self.header(second, 0), method="coherent", verdict="estimated", idle_ratio=IDLE,
            idle_ratio_var=1e-7, idle_ratio_low=IDLE - 0.0006, idle_ratio_high=IDLE + 0.0006,
            read_out_time_s=(1 - IDLE) / RATE_HZ, direction="forward", frame_rate_hz=RATE_HZ,
            nominal_hz=50.0,
        )  # fmt: skip

    def match(self, second: int, lag_s: float = 0.0) -> Sent:
        return self.key("match"), MatchResult(
            header=self.header(second, 0), method="phase", grid="ce", decision="match",
            lag_s=lag_s, start_utc_ns=self.start_ns, correlation=0.9997, log10_lr=6.2,
            clock_ppm=12.4, clock_std_ppm=1.1, seconds_used=float(second), verbal="very strong",
        )  # fmt: skip

    def live(self, second: int, verdict: str = "live", since: int = 0, **more: Any) -> Sent:
        return self.key("live"), Liveness(
            header=self.header(second, second), verdict=verdict,
            since_ns=self.start_ns + since * S, **more,
        )  # fmt: skip

    def alarm(self, number: int, second: int, *, active: bool = True, **more: Any) -> Sent:
        more = {"kind": "phase_jump", "severity": "alarm", "value": 1.3, "limit": 0.4,
                "unit": "rad", "text": "the flicker's phase jumped: cut, or frames lost",
                **more}  # fmt: skip
        return self.key("alarm"), Alarm(
            header=self.header(number, second), active=active,
            start_pts_ns=second * S, end_pts_ns=second * S, **more,
        )  # fmt: skip

    def key_frame(self, second: int) -> Sent:
        """A picture of a room, as motion JPEG has it."""
        picture = np.full((180, 320, 3), 70, np.uint8)
        picture[:] += np.linspace(0, 60, 320).astype(np.uint8)[None, :, None]
        hue = tuple(int(v) for v in self._texture[:3])
        cv2.rectangle(picture, (40, 60), (150, 180), hue, -1)
        cv2.circle(picture, (240, 60), 28, (190, 220, 230), -1)
        cv2.putText(picture, self.name, (12, 24), cv2.FONT_HERSHEY_SIMPLEX, 0.6, (240,) * 3, 1)
        data = cv2.imencode(".jpg", picture)[1].tobytes()
        return self.key("video"), VideoPacket(
            header=self.header(second, second), codec="mjpeg", keyframe=True, data=data
        )

    def seconds(self, first: int, last: int) -> Iterator[Sent]:
        """What comes between two seconds: rows and estimates, and now and then the others."""
        for second in range(first, last):
            yield self.rows(second)
            yield self.enf(second)
            if second % 10 == 5:
                yield self.idle(second // 10)
                yield self.match(second // 10)


def reference(freq_hz: NDArray[np.float64], start_ns: int = START_NS, first: int = 0) -> Sent:
    """A block of a reference whose sample 0 is at ``start_ns``."""
    return reference_key(SITE, "ce"), ReferenceBlock(
        header=Header(run_id="g", source="reference/ce", seq=first), grid="ce", nominal_hz=50.0,
        t0_ns=start_ns, step_ns=S, first=first, samples=len(freq_hz), freq_hz=freq_hz,
        readings=np.ones(len(freq_hz), np.uint32),
    )  # fmt: skip


def health(node: str, kind: str, now_ns: int, seq: int = 0, **more: Any) -> Sent:
    """What a node says of itself."""
    more = {"state": "running", "pid": 100, "rate_hz": 30.0, "latency_s": 0.06,
            "last_input_ns": now_ns, "memory_bytes": 96_000_000, **more}  # fmt: skip
    return health_key(SITE, node), Health(
        header=Header(run_id="a", source=node, seq=seq, arrival_time_ns=now_ns), node=node,
        kind=kind, host="station", time_ns=now_ns, **more,
    )  # fmt: skip

"""Cameras of a day, as a node of a graph: rows by the second, with faults of the feed from a seed.

A stream is a function of the seed and the second, so that a feeder that was killed goes on
where it was. Arrival times go by the stream, not by this host's clock: a second may take a
millisecond. It is at most a few seconds ahead of its verdicts (of ``live``), unless these stay
away: then it goes on in real time, so that a node that is away is away as long in the stream.
"""

from __future__ import annotations

import functools
import os
import sys
import threading
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from rsenf.bus.inbox import Inbox
from rsenf.bus.keys import LOOKING, camera_key, source_of
from rsenf.bus.zenoh_bus import BusSettings, open_bus
from rsenf.messages import Header, Mark, RowBlock
from rsenf.model import GridPath, synthetic_grid
from rsenf.rows.stage import blocks_from_luminance
from rsenf.run.node import NodeProcess
from rsenf.run.own_node import run_own_node
from rsenf.timebase import nanoseconds
from tests.run.link_proxy import LinkProxy

SITE, RATE_HZ, ROWS = "day", 30, 16
T0_NS = 1_767_225_600_000_000_000  # 2026-01-01
LATENCY_S, MARGIN_S = 0.1, 200
AHEAD_S, PATIENCE_S = 3, 1.0  # of the stream, and of the host
FEED_FAULTS = ("loop", "freeze", "splice", "stall", "clock set")
HOST_FAULTS = ("kill", "stop", "disk full", "link cut")
KINDS = FEED_FAULTS + HOST_FAULTS
VICTIMS = ("track", "idle", "match", "live", "record", "east", "west")
EVERY_S, WITHIN_S, LOOP_S = 600, 60, 30
LASTS_S = {"loop": 120, "freeze": 60, "splice": 180}
CLOCK_SET_S = (-3600.0, -60.0, 8.0, 60.0, 3600.0)
NEW_EPOCH_S = 10.0  # a leap ahead by more, or back, begins a new epoch, as decoders do
CUT_S = (3.0, 15.0)


@dataclass(frozen=True)
class Fault:
    """One fault: when, which, of whom; seconds of the stream, those of a cut of the host."""

    at_s: int
    kind: str
    of: str
    lasts_s: int = 0
    value_s: float = 0.0


def cameras_of(feeder: str, count: int) -> list[str]:
    """Return the cameras of a feeder: each has half of them."""
    first, last = (0, count // 2) if feeder == "east" else (count // 2, count)
    return [f"cam{k}" for k in range(first, last)]


@functools.cache
def faults(seed: int, total_s: int, count: int) -> tuple[Fault, ...]:
    """Return the faults of a day, one every ten minutes, all kinds equally often."""
    rng, out = np.random.default_rng(seed), list[Fault]()
    kinds = list[str]()
    for begin_s in range(EVERY_S, total_s - EVERY_S // 2, EVERY_S):
        kinds = kinds or list(rng.permutation(KINDS))
        kind = str(kinds.pop())
        of = str(rng.choice(VICTIMS)) if kind in HOST_FAULTS else f"cam{rng.integers(count)}"
        lasts_s, value_s = LASTS_S.get(kind, 0), 0.0
        if kind == "stall":
            lasts_s = int(rng.integers(10, 60))
        elif kind == "splice":
            value_s = float(rng.uniform(20, 120))
        elif kind == "clock set":
            value_s = float(rng.choice(CLOCK_SET_S))
        elif kind == "disk full":
            of = "record"
        elif kind == "link cut":
            of, value_s = str(rng.choice(("east", "west"))), float(rng.choice(CUT_S))
        out.append(Fault(begin_s + int(rng.integers(WITHIN_S)), kind, of, lasts_s, value_s))
    return tuple(out)


@functools.cache
def grid_of(seed: int, total_s: int) -> GridPath:
    """Return the grid of all cameras; the day begins a margin after it."""
    return synthetic_grid(seed, total_s + 4.0 * MARGIN_S)


class Camera:
    """The stream of one camera.

    Parameters
    ----------
    name : str
    seed, total_s : int
    found : sequence of Fault
        All of the day; those of this camera count.

    Attributes
    ----------
    epoch, seq, is_sent : ndarray, shape (total_s,)
        Place of each second's block; whether there is one.
    """

    def __init__(self, name: str, seed: int, total_s: int, found: tuple[Fault, ...]) -> None:
        self.name, self._seed = name, [seed, int(name.removeprefix("cam"))]
        rng = np.random.default_rng(self._seed)
        self._idle, self._noise = rng.uniform(0.1, 0.4), rng.uniform(1.0, 2.0)
        self._scale = 1.0 + 1e-6 * rng.uniform(-20.0, 20.0)  # the camera's clock runs so fast
        self._grid = grid_of(seed, total_s)
        self._mine = [fault for fault in found if fault.of == name]
        self.epoch, self.seq = np.zeros((2, total_s), np.int64)
        self._set_s, self.is_sent = np.zeros(total_s), np.ones(total_s, bool)
        for fault in self._mine:
            if fault.kind == "stall":
                self.is_sent[fault.at_s : fault.at_s + fault.lasts_s] = False
            elif fault.kind == "clock set":
                self._set_s[fault.at_s :] += fault.value_s
                self.epoch[fault.at_s :] += not 0.0 < fault.value_s <= NEW_EPOCH_S
        for epoch in np.unique(self.epoch):
            of = self.epoch == epoch
            self.seq[of] = np.cumsum(self.is_sent[of]) - 1

    def block(self, second: int, run_id: str) -> RowBlock:
        """Return the rows of a second, as they arrive."""
        level = self._light(second, second)
        for fault in self._mine:
            since_s = second - fault.at_s
            if not 0 <= since_s < fault.lasts_s:
                continue
            if fault.kind == "loop":
                again = fault.at_s - LOOP_S + since_s % LOOP_S
                level = self._light(again, again)
            elif fault.kind == "freeze":
                level = np.tile(self._light(fault.at_s - 1, fault.at_s - 1)[-1:], (RATE_HZ, 1))
            elif fault.kind == "splice":
                level = self._light(second - fault.value_s, second)
        frame = int(self.seq[second]) * RATE_HZ
        t_s = second + self._set_s[second] + np.arange(RATE_HZ) / RATE_HZ
        header = Header(run_id=run_id, source=f"{SITE}/{self.name}", epoch=int(self.epoch[second]))
        (made,) = blocks_from_luminance(level[:, :, None], t_s, header, block_frames=RATE_HZ)
        header = replace(
            made.header,
            seq=int(self.seq[second]),
            frame_first=frame,
            frame_last=frame + RATE_HZ - 1,
            arrival_time_ns=T0_NS + nanoseconds(second * self._scale + LATENCY_S),
        )
        return replace(made, header=header, frame_number=made.frame_number + frame)

    def _light(self, second: float, noise: int) -> np.ndarray:
        within = np.arange(ROWS) / ROWS * (1.0 - self._idle) / RATE_HZ
        t_s = second + np.arange(RATE_HZ)[:, None] / RATE_HZ + within
        # Two harmonics, as of a lamp on a bridge rectifier.
        turn = 4 * np.pi * self._grid.cycles(MARGIN_S + t_s * self._scale)
        grain = np.random.default_rng([*self._seed, noise]).normal(0, self._noise, t_s.shape)
        level = 120 + 20 * np.cos(turn) + 4 * np.cos(2 * turn + 1) + grain
        return level.astype(np.float32)


class Verdicts:
    """Up to which second of the stream each camera has a verdict."""

    def __init__(self, inbox: Inbox) -> None:
        self.until_s: dict[str, float] = {}
        self._inbox = inbox

    def take(self, timeout_s: float) -> None:
        """Take what is there, or the next."""
        while received := self._inbox.receive(timeout_s):
            timeout_s, header = 0.0, received.message.header
            if header.arrival_time_ns:
                camera = source_of(received.key).split("/")[1]
                self.until_s[camera] = (header.arrival_time_ns - T0_NS) / 1e9


def feed(node: NodeProcess, verdicts: Verdicts, link: LinkProxy, where: Path) -> None:
    """Send every second of every camera; what was sent is noted in a file as it goes."""
    seed, total_s, count, is_honest = (int(word) for word in sys.argv[2:6])
    found = () if is_honest else faults(seed, total_s, count)
    cameras = [Camera(name, seed, total_s, found) for name in cameras_of(node.name, count)]
    cuts = [fault for fault in found if (fault.kind, fault.of) == ("link cut", node.name)]
    publishers = [node.publisher(camera.name, "rows") for camera in cameras]
    node.ready()
    node.wait_for_peers()
    begun = not where.exists()
    place = np.memmap(where, np.int64, "w+" if begun else "r+", shape=(len(cameras),))
    last, sent_s = [Header(run_id=node.run_id)] * len(cameras), [0.0] * len(cameras)
    cuts = [fault for fault in cuts if begun or fault.at_s > place.min()]
    while (place < total_s).any() and not node.stop.is_set():
        verdicts.take(0.0)
        waits = True
        for k, camera in enumerate(cameras):
            second, now_s = int(place[k]), time.monotonic()
            is_near = second <= verdicts.until_s.get(camera.name, 0.0) + AHEAD_S
            if second >= total_s or not (is_near or now_s - sent_s[k] > PATIENCE_S):
                continue
            if camera.is_sent[second]:
                block = camera.block(second, node.run_id)
                publishers[k].send(block)
                last[k], sent_s[k] = block.header, now_s
            place[k], waits = second + 1, False
            if place[k] == total_s:
                publishers[k].send(RowBlock(header=last[k].numbered(last[k].seq + 1, Mark.END)))
        if cuts and place.min() >= cuts[0].at_s:
            link.cut()
            threading.Timer(cuts.pop(0).value_s, link.mend).start()
        if waits:
            verdicts.take(0.01)


def main() -> None:
    """Feed over a link that can be cut; listen beside it."""
    connect = os.environ["RSENF_CONNECT"]
    inbox = Inbox()
    with (
        open_bus(BusSettings(connect=(connect,))) as bus,
        LinkProxy(int(connect.rpartition(":")[2])) as link,
    ):
        bus.subscribe(inbox, camera_key(SITE, "*", "live"), LOOKING)
        os.environ["RSENF_CONNECT"] = f"tcp/127.0.0.1:{link.port}"
        where = Path(sys.argv[1]) / f"{os.environ['RSENF_NODE']}.place"
        run_own_node(lambda node: feed(node, Verdicts(inbox), link, where))


if __name__ == "__main__":
    main()

"""How much a recording loses that is killed: real processes, at random moments.

Not a test by itself: ``python -m tests.record.kills 100 1`` sends rows and video over a bus, lets
``rsenf record`` record it, kills it with signal 9 at a random moment, so many times, and recovers
every file. What a message sent that long before the kill counts as lost is told in seconds.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from rsenf.bus.delivery import Delivery
from rsenf.bus.zenoh_bus import BusSettings, ZenohBus, open_bus
from rsenf.messages import encode
from rsenf.record import open_recording
from rsenf.record.examine import examine
from rsenf.record.recover import recover
from rsenf.run.supervisor import free_endpoint

sys.path.insert(0, str(Path(__file__).parent))
from record_samples import ROWS, VIDEO, packet, rows

RATE_HZ = 25.0
START_LIMIT_S = 60.0
LIVE = Delivery(lossless=True, queue=256, history=0)


@dataclass
class Sender:
    """Sends a picture and a block of rows at the rate of a camera, and knows when."""

    bus: ZenohBus
    sent_s: dict[tuple[str, int], float] = field(default_factory=dict)
    content: dict[tuple[str, int], bytes] = field(default_factory=dict)

    def send(self, done: threading.Event) -> None:
        made = {VIDEO: packet, ROWS: rows}
        publishers = {topic: self.bus.publisher(topic, LIVE) for topic in made}
        begun, seq = time.monotonic(), 0
        while not done.wait(max(begun + seq / RATE_HZ - time.monotonic(), 0)):
            for topic, make in made.items():
                message: Any = make(seq, size=4000) if topic == VIDEO else make(seq)
                self.content[topic, seq] = encode(message)
                publishers[topic].send(message)
                self.sent_s[topic, seq] = time.monotonic()
            seq += 1


@contextlib.contextmanager
def sending() -> Iterator[tuple[str, Sender]]:
    """Send over a bus of its own; yields where it is."""
    endpoint, done = free_endpoint(), threading.Event()
    with open_bus(BusSettings(mode="router", listen=(endpoint,))) as bus:
        sender = Sender(bus)
        thread = threading.Thread(target=sender.send, args=(done,))
        thread.start()
        try:
            yield endpoint, sender
        finally:
            done.set()
            thread.join()


@dataclass(frozen=True)
class Killed:
    """What came of a recording that was killed.

    Attributes
    ----------
    messages : int
        Recovered.
    lost_s : float
        How long before the kill the oldest message that is lost was sent.
    """

    messages: int
    lost_s: float


def kill_one(endpoint: str, sender: Sender, out: Path, after_s: float) -> Killed:
    """Record, kill ``after_s`` after the first flush, recover, and see what is left.

    Raises
    ------
    AssertionError
        When what was recovered isn't what was sent, or isn't whole.
    """
    words = [sys.executable, "-m", "rsenf.cli", "record", "--connect", endpoint, "--out", str(out)]
    with subprocess.Popen(words, stderr=subprocess.DEVNULL) as process:
        begun = time.monotonic()
        while not (out.exists() and out.stat().st_size > 3000):
            assert process.poll() is None
            assert time.monotonic() - begun < START_LIMIT_S, "it doesn't begin to record"
            time.sleep(0.02)
        time.sleep(after_s)
        os.kill(process.pid, signal.SIGKILL)
        killed_s = time.monotonic()
        assert process.wait() == -signal.SIGKILL
    assert not examine(out).contents.complete
    saved = out.with_suffix(".saved.mcap")
    recover(out, saved)
    assert examine(saved).whole
    read = {(topic, m.header.seq): encode(m) for topic, m, _ in open_recording(saved).messages()}
    assert all(sender.content[key] == payload for key, payload in read.items())
    lost_s = 0.0
    for topic in (VIDEO, ROWS):
        numbers = [seq for t, seq in read if t == topic]
        assert numbers == list(range(numbers[0], numbers[-1] + 1)), "a gap"
        next_sent_s = sender.sent_s.get((topic, numbers[-1] + 1), killed_s)
        lost_s = max(lost_s, killed_s - next_sent_s)
    return Killed(len(read), lost_s)


def study(count: int, first_seed: int, folder: Path) -> Iterator[Killed]:
    """Kill so many recordings."""
    with sending() as (endpoint, sender):
        for seed in range(first_seed, first_seed + count):
            after_s = float(np.random.default_rng(seed).uniform(0.0, 2.0))
            yield kill_one(endpoint, sender, folder / f"{seed}.mcap", after_s)


def main(count: int, first_seed: int) -> None:
    with tempfile.TemporaryDirectory() as folder:
        lost_s = []
        for killed in study(count, first_seed, Path(folder)):
            lost_s.append(killed.lost_s)
            print(f"{killed.messages} messages recovered, {killed.lost_s:.2f} s lost", flush=True)
    late = sum(seconds > 1.0 for seconds in lost_s)
    print(f"{count} kills, all recovered; lost {np.median(lost_s):.2f} s in the middle, "
          f"{max(lost_s):.2f} s at most, more than 1 s: {late}")  # fmt: skip


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))

"""How much a recording loses that is killed: real processes, at random moments.

Not a test by itself: ``python -m tests.record.kills 100 1`` records pictures and rows at the rate
of a camera in a process of its own, kills it with signal 9 at a random moment, so many times, and
recovers every file. ``… 100 1 verb`` does so with ``rsenf record`` on a bus, which takes longer.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from rsenf.bus.keys import Delivery
from rsenf.bus.zenoh_bus import BusSettings, free_endpoint, open_bus
from rsenf.messages import encode
from rsenf.record import Recorder, open_recording
from rsenf.record.examine import examine
from rsenf.record.recover import recover
from rsenf.run.process import Patience

sys.path.insert(0, str(Path(__file__).parent))
from record_samples import ROWS, VIDEO, packet, rows

RATE_HZ = 25.0
LONGEST_S = 3600
LIMIT_S = 60.0
BEGUN_BYTES = 3000  # a file of this size has had its first flush
LIVE = Delivery(lossless=True, queue=256, history=0)
FORK = multiprocessing.get_context("fork")


@dataclass(frozen=True)
class Camera:
    """Sends a picture and a block of rows for each frame.

    Attributes
    ----------
    sent_s : array of double, shared between processes
        When each frame was sent, on the monotonic clock; 0 for not yet.
    """

    sent_s: Any

    @classmethod
    def new(cls) -> Camera:
        return cls(FORK.RawArray("d", round(LONGEST_S * RATE_HZ)))

    def send(self, put: Callable[[str, Any], Any], done: Callable[[float], bool]) -> None:
        """Send to ``put(topic, message)``; ``done(seconds)`` waits so long, and tells when."""
        begun, seq = time.monotonic(), 0
        while not done(max(begun + seq / RATE_HZ - time.monotonic(), 0)):
            self.sent_s[seq] = time.monotonic()
            for topic in (VIDEO, ROWS):
                put(topic, message_of(topic, seq))
            seq += 1


def message_of(topic: str, seq: int) -> Any:
    """What is sent on a topic."""
    return packet(seq, size=4000) if topic == VIDEO else rows(seq)


class Recording(NamedTuple):
    """A process that records, and whom it records."""

    pid: int
    camera: Camera
    wait: Callable[[], Any]


def recorder_alone(out: Path) -> Recording:
    """Record in a process that does nothing else, with the defaults."""
    camera = Camera.new()

    def record() -> None:
        with Recorder(out, run_info={}, clock_ns=time.time_ns) as recorder:
            camera.send(recorder.write, lambda seconds: bool(time.sleep(seconds)))

    process = FORK.Process(target=record)
    process.start()
    return Recording(process.pid or 0, camera, process.join)


@contextlib.contextmanager
def verb_on_a_bus() -> Iterator[Callable[[Path], Recording]]:
    """Record with ``rsenf record``, all of them on one bus."""
    endpoint, done, camera = free_endpoint(), threading.Event(), Camera.new()
    words = [sys.executable, "-m", "rsenf.cli", "record", "--connect", endpoint, "--out"]

    def start(out: Path) -> Recording:
        process = subprocess.Popen([*words, str(out)], stderr=subprocess.DEVNULL)
        return Recording(process.pid, camera, process.wait)

    with open_bus(BusSettings(mode="router", listen=(endpoint,))) as bus:
        publishers = {topic: bus.publisher(topic, LIVE) for topic in (VIDEO, ROWS)}

        def put(topic: str, message: Any) -> None:
            publishers[topic].send(message)

        sender = threading.Thread(target=camera.send, args=(put, done.wait))
        sender.start()
        try:
            yield start
        finally:
            done.set()
            sender.join()


class Killed(NamedTuple):
    """What came of a recording that was killed.

    Attributes
    ----------
    messages : int
        Recovered.
    lost_s : float
        How long before the kill the first message that is lost was sent.
    late_s : float
        By how much the camera was ever late: on a busy machine, processes stand still.
    """

    messages: int
    lost_s: float
    late_s: float


def kill_one(start: Callable[[Path], Recording], out: Path, after_s: float) -> Killed:
    """Record, kill ``after_s`` after the first flush, recover, and see what is left.

    Raises
    ------
    AssertionError
        When what was recovered isn't what was sent, or isn't whole.
    """
    recording, patience = start(out), Patience(LIMIT_S)
    try:
        while not (out.exists() and out.stat().st_size > BEGUN_BYTES):
            assert not patience.over, "it doesn't begin to record"
            time.sleep(0.01)
        time.sleep(after_s)
    finally:
        os.kill(recording.pid, signal.SIGKILL)
        killed_s = time.monotonic()
        recording.wait()
    assert not examine(out).contents.complete
    saved = out.with_suffix(".saved.mcap")
    recover(out, saved)
    assert examine(saved).whole
    numbers: dict[str, list[int]] = {VIDEO: [], ROWS: []}
    for topic, message, _ in open_recording(saved).messages():
        assert encode(message) == encode(message_of(topic, message.header.seq))
        numbers[topic].append(message.header.seq)
    lost_s = 0.0
    for seqs in numbers.values():
        assert seqs == list(range(seqs[0], seqs[-1] + 1))
        sent_s = recording.camera.sent_s[seqs[-1] + 1] or killed_s
        lost_s = max(lost_s, killed_s - sent_s)
    return Killed(sum(map(len, numbers.values())), lost_s, late_s(recording.camera, killed_s))


def late_s(camera: Camera, killed_s: float) -> float:
    """By how much a camera was late at most, until its recorder was killed."""
    sent_s = np.array(camera.sent_s)
    sent_s = sent_s[(sent_s > 0) & (sent_s < killed_s)]
    due_s = sent_s[0] + np.arange(sent_s.size + 1) / RATE_HZ
    return float(np.max(np.append(sent_s, killed_s) - due_s))


def study(
    start: Callable[[Path], Recording], count: int, first_seed: int, folder: Path
) -> Iterator[Killed]:
    """Kill so many recordings."""
    for seed in range(first_seed, first_seed + count):
        after_s = float(np.random.default_rng(seed).uniform(0.0, 2.0))
        yield kill_one(start, folder / f"{seed}.mcap", after_s)


def main(count: int, first_seed: int, how: str = "") -> None:
    lost_s = []
    with tempfile.TemporaryDirectory() as folder, contextlib.ExitStack() as stack:
        start = stack.enter_context(verb_on_a_bus()) if how == "verb" else recorder_alone
        for killed in study(start, count, first_seed, Path(folder)):
            lost_s.append(killed.lost_s)
            print(f"{killed.messages} messages recovered, {killed.lost_s:.2f} s lost, "
                  f"camera late by {killed.late_s:.2f} s", flush=True)  # fmt: skip
    late = sum(seconds > 1.0 for seconds in lost_s)
    print(f"{count} kills, all recovered; lost {np.median(lost_s):.2f} s in the middle, "
          f"{max(lost_s):.2f} s at most, more than 1 s: {late}")  # fmt: skip


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]), *sys.argv[3:])

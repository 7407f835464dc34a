"""Nodes of running graphs killed or stopped at random: is every frame in a row block, or counted?

By hand: ``python -m tests.run.kills --kills 100 --stops 50 --load 20 --seed 1``. A film goes
through ``rsenf run`` as fast as its nodes take it; three times in each run, the node whose turn it
is gets SIGKILL, or SIGSTOP until the supervisor ends it. Printed, for each node: runs that ended
with the right exit code, frames of the film, those recorded without rows or estimates, those that
the run counted, and the longest time without any progress while every node was up. The exit code is
1 when something hung, or was lost and not told. Ctrl-C ends a node's turn and prints its line.
"""

from __future__ import annotations

import argparse
import os
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import av
import numpy as np

from rsenf.bus.inbox import Inbox
from rsenf.bus.keys import LOOKING, health_key
from rsenf.bus.zenoh_bus import BusSettings, open_bus
from rsenf.errors import EXIT_DONE, EXIT_LOSS
from rsenf.messages import Health
from rsenf.record.reader import open_recording
from rsenf.run.process import wait_until

sys.path.append(str(Path(__file__).parent))
from conftest import Film, made_film
from live_run import LiveRun

VICTIMS = ("rows", "track", "idle", "match", "record", "decode")
BLOCK, RATE_HZ = 8, 30  # frames in a row block, and in a second
EACH = 3  # kills in a run
STALL_S = 5.0
SILENT_S = 3.0  # after which the supervisor ends a stopped node
GRAPH = """\
version: 1
site: lab
restart: {{limit: 50, within_s: 300, backoff_s: 0.1, backoff_max_s: 0.5, silent_s: {silent_s}}}
nodes:
  decode: {{kind: decode, input: "{film.video}", camera: cam, frames: ring}}
  rows:   {{kind: rows, cameras: [cam]}}
  track:  {{kind: track, cameras: [cam], track: {{nominal_hz: 50}}}}
  idle:   {{kind: idle, cameras: [cam], idle: {{nominal_hz: 50}}}}
  grid:   {{kind: reference, grid: ce, input: "{film.reference}"}}
  match:  {{kind: match, cameras: [cam], grid: ce}}
  record: {{kind: record, out: "{folder}/out.mcap"}}
"""


class Progress:
    """The longest time without progress of any node, of times when none is down or waits.

    Attributes
    ----------
    longest_s : float
    disturbed : Event
        Set while a node is down.
    """

    def __init__(self) -> None:
        self.longest_s, self.disturbed = 0.0, threading.Event()
        self._counts: dict[str, int] = {}
        self._states: dict[str, str] = {}
        self._since_s = time.monotonic()

    def take(self, report: Health) -> None:
        """Take a node's health."""
        now_s, count = time.monotonic(), report.messages_in + report.messages_out
        self._states[report.node] = report.state
        goes_on = self._counts.get(report.node) != count
        self._counts[report.node] = count
        is_up = all(state in ("running", "done") for state in self._states.values())
        is_over = all(self._states.get(node) == "done" for node in ("decode", "rows"))
        if goes_on or is_over or not is_up or self.disturbed.is_set():
            self._since_s = now_s
        self.longest_s = max(self.longest_s, now_s - self._since_s)


@contextmanager
def progress_of(run: LiveRun) -> Iterator[Progress]:
    """Watch the health of a run's nodes."""
    progress, done, words = Progress(), threading.Event(), Inbox()

    def look() -> None:
        while not done.is_set():
            if received := words.receive(0.1):
                progress.take(received.message)

    with open_bus(BusSettings(connect=(run.endpoint,))) as bus:
        bus.subscribe(words, health_key("lab", "*"), LOOKING)
        looking = threading.Thread(target=look)
        looking.start()
        try:
            yield progress
        finally:
            done.set()
            looking.join(10)


def frames_of(folder: Path, frames: int) -> tuple[int, int, int]:
    """Return how many frames of a film have no rows, have no estimate; and messages missed."""
    rows, estimated, missed = set[int](), set[int](), 0
    for path in sorted(folder.glob("out*.mcap")):
        for topic, message, _ in open_recording(path).messages():
            header = message.header
            if topic.endswith("/health"):
                missed = max(missed, message.missed)
            elif not header.is_end and topic.endswith(("/rows", "/track")):
                into = rows if topic.endswith("/rows") else estimated
                into |= set(range(header.frame_first, header.frame_last + 1))
    whole = set(range(frames))
    if whole - rows:
        print("no rows:", sorted(whole - rows)[:20], flush=True)
    # The last part of a second has none, and what has no rows is counted there.
    no_estimate = {n for n in rows if n < frames - RATE_HZ} - estimated
    return len(whole - rows), len(no_estimate), missed


def one_run(
    folder: Path, film: Film, victim: str, number: int, rng: np.random.Generator
) -> dict[str, float]:
    """Run the graph once, with its victim killed or stopped; return what came of it."""
    for old in folder.glob("out*"):
        old.unlink()
    graph = folder / "graph.yaml"
    graph.write_text(GRAPH.format(folder=folder, film=film, silent_s=SILENT_S), encoding="utf-8")
    run, done = LiveRun(graph), 0
    run.until("running", *VICTIMS)
    with av.open(str(film.video)) as opened:
        frames = sum(1 for _ in opened.decode(video=0))
    with progress_of(run) as progress:
        for _ in range(EACH):
            time.sleep(float(rng.uniform(0.0, 0.6)))
            pid = run.pids[victim]
            progress.disturbed.set()
            try:
                os.kill(pid, number)
            except ProcessLookupError:  # it has finished
                break
            done += 1

            def is_back(pid: int = pid) -> bool:
                return run.pids[victim] != pid or run.process.poll() is not None

            if not wait_until(is_back, 60):
                break
            progress.disturbed.clear()
        progress.disturbed.clear()
        ended = wait_until(lambda: run.process.poll() is not None, 120)
    code = run.wait() if ended else -1
    no_rows, no_track, missed = frames_of(folder, frames)
    said = "\n".join(run.lines)
    counted = {
        topic: max([0, *map(int, re.findall(rf"(\d+) frames have no {topic}", said))])
        for topic in ("rows", "track")
    }
    # A row block that was on its way when its sender was killed is a message missed.
    is_told = counted["rows"] + BLOCK * missed >= no_rows and counted["track"] >= no_track
    # How much a node lost that came back after the end of its stream isn't known.
    unknown = bool(re.search(rf"{victim}: .*came during a restart", said))
    right = ended and code in (EXIT_DONE, EXIT_LOSS) and (code or not no_rows + no_track)
    if not (right and (is_told or unknown) and progress.longest_s <= STALL_S):
        print(said, f"exit {code}; {no_rows}, {no_track} lost; {counted}, {missed}", sep="\n")
    run.kill()
    return {
        "done": done, "right": bool(right), "told": is_told, "unknown": unknown and not is_told,
        "frames": frames,
        "no_rows": no_rows, "no_track": no_track, **counted, "stall_s": progress.longest_s,
    }  # fmt: skip


def main() -> int:
    """Kill and stop; return the exit code."""
    parser = argparse.ArgumentParser(description="kills of every node")
    parser.add_argument("--kills", type=int, default=9, help="of each node")
    parser.add_argument("--stops", type=int, default=3, help="of each node")
    parser.add_argument("--load", type=int, default=0, help="busy processes beside it")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--nodes", nargs="+", default=VICTIMS, choices=VICTIMS)
    args = parser.parse_args()
    rng = np.random.default_rng(args.seed)
    busy = [subprocess.Popen([sys.executable, "-c", "while 1: pass"]) for _ in range(args.load)]
    bad = 0
    with tempfile.TemporaryDirectory() as text:
        folder = Path(text)
        film = made_film(folder, 75)
        for number, count in ((signal.SIGKILL, args.kills), (signal.SIGSTOP, args.stops)):
            for victim in args.nodes:
                ran: list[dict[str, float]] = []
                with suppress(KeyboardInterrupt):  # Ctrl-C ends this node's turn
                    while sum(r["done"] for r in ran) < count and len(ran) < 2 * count:
                        ran.append(one_run(folder, film, victim, number, rng))
                total = {key: sum(r[key] for r in ran) for key in ran[0]} if ran else {}
                worst_s = max((r["stall_s"] for r in ran), default=0.0)
                bad += sum(not (r["right"] and (r["told"] or r["unknown"])) for r in ran) + (
                    worst_s > STALL_S
                )
                if ran:
                    print(
                        f"{number.name} {victim}: {total['done']} in {len(ran)} runs, "
                        f"{total['right']} right, {total['told']} counted all, {total['unknown']} "
                        f"told that an end was missed; {total['frames']} frames, "
                        f"without rows {total['no_rows']} (counted {total['rows']}), without "
                        f"estimate {total['no_track']} (counted {total['track']}); "
                        f"longest stall {worst_s:.1f} s",
                        flush=True,
                    )
    for process in busy:
        process.kill()
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())

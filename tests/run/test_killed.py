"""A node is killed: it shows at once, the others finish, and nothing is left behind."""

from __future__ import annotations

import json
import os
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from conftest import Film, Graphs
from live_run import LiveRun

from rsenf.bus.inbox import Inbox
from rsenf.bus.keys import LOOKING, health_key
from rsenf.bus.zenoh_bus import BusSettings, open_bus
from rsenf.record import open_recording
from rsenf.run.process import wait_until
from tests.in_time import in_time

pytestmark = pytest.mark.processes

NODES = ("decode", "rows", "track", "match", "record")


@contextmanager
def looking_at_health(endpoint: str) -> Iterator[dict[str, set[str]]]:
    """Collects, for each node, whom it ever called lost."""
    said: dict[str, set[str]] = {}
    words, done = Inbox(), threading.Event()

    def look() -> None:
        while not done.is_set() or words.depth:
            if received := words.receive(0.1):
                report = received.message
                said.setdefault(report.node, set()).update(report.lost_peers)

    with open_bus(BusSettings(connect=(endpoint,))) as bus:
        bus.subscribe(words, health_key("lab", "*"), LOOKING)
        looking = threading.Thread(target=look)
        looking.start()
        try:
            yield said
        finally:
            done.set()
            looking.join(10)


def stopped(run: LiveRun, *names: str) -> bool:
    return all(
        any(state in ("done", "failed", "lost") for state in run.states.get(n, [])) for n in names
    )


@pytest.mark.parametrize("victim", NODES)
def test_a_killed_node_shows_at_once_and_the_rest_finishes(
    short_film: Film, graphs: Graphs, live_run: type[LiveRun], victim: str
) -> None:
    run = live_run(graphs.write(short_film, pace=True), "--json")
    run.until("running", *NODES).until("done", "grid")
    with looking_at_health(run.endpoint) as said:
        shown_after_s = run.kill_node(victim)
        code = run.wait()
    print(f"{victim}: shown as lost after {shown_after_s * 1e3:.0f} ms")
    assert code == 1
    assert run.error == f"rsenf: {victim}: killed by signal 9"
    assert not any("Traceback" in line for line in run.lines)
    assert run.left == []
    # Those that went on for a while have said so; nobody who finished was ever called lost.
    others = set(NODES) - {victim}
    assert victim in said["record" if victim != "record" else "decode"]
    assert set().union(*said.values()) == {victim}
    ends = json.loads(run.process.stdout.read())["nodes"]  # type: ignore[union-attr]
    assert {n: ends[n]["state"] for n in others} == dict.fromkeys(others, "done")
    assert (ends[victim]["state"], ends[victim]["exit_code"]) == ("lost", -9)
    assert in_time(shown_after_s, 2.0)

    recording = open_recording(graphs.out)
    assert recording.complete == (victim != "record")
    received = [m for t, m, _ in recording.messages() if t.endswith("/video")]
    numbers = [m.header.seq for m in received]
    assert numbers == list(range(len(numbers)))
    if victim not in ("decode", "record"):  # the video was recorded to its end
        assert received[-1].header.is_end


def test_a_node_killed_while_it_starts_ends_the_graph(
    short_film: Film, graphs: Graphs, live_run: type[LiveRun]
) -> None:
    """Nobody else could know that it won't come."""
    run = live_run(graphs.write(short_film, pace=True))
    while not run.run_id or len(run.left) < 6:
        assert run.process.poll() is None
    for number in run.left:
        if b"\0--node\0rows\0" in Path(f"/proc/{number}/cmdline").read_bytes():
            os.kill(number, signal.SIGKILL)
    assert run.wait() == 1
    assert "rows: killed by signal 9" in run.error
    assert run.left == []


def test_a_stopped_supervisor_takes_its_nodes_with_it(
    short_film: Film, graphs: Graphs, live_run: type[LiveRun]
) -> None:
    """Killed, it can't tell them: they notice by themselves and close the recording."""
    run = live_run(graphs.write(short_film, pace=True))
    run.until("running", *NODES).until("done", "grid")
    begun = time.monotonic()
    run.process.kill()
    run.process.wait()
    assert wait_until(lambda: not run.left)
    print(f"nodes ended {time.monotonic() - begun:.2f} s after their supervisor was killed")
    assert open_recording(graphs.out).complete
    for ring in Path("/dev/shm").glob(f"rsenf-{run.run_id}*"):
        pytest.fail(f"left behind: {ring}")

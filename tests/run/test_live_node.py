"""The live node: two topics out, silence noticed; a whole graph, recorded and run again."""

from __future__ import annotations

import json
import os
import signal
import threading
import time
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from live_run import LiveRun
from run_samples import end_after, node_on

from rsenf.bus.inbox import Inbox
from rsenf.bus.keys import HEALTH, SIGNALS, camera_key, health_key, reference_key
from rsenf.config import Graph, load_graph
from rsenf.errors import EXIT_DONE, RsenfError
from rsenf.messages import (
    Alarm,
    EnfEstimate,
    Header,
    Health,
    Liveness,
    ReferenceBlock,
    RowBlock,
)
from rsenf.model import synthetic_grid
from rsenf.record import open_recording
from rsenf.regress.rerun import regress
from rsenf.run.process import wait_until
from tests.decode import rtsp_server
from tests.loopback import Loopback

LOOPBACK: dict[str, Any] = {
    "version": 1,
    "site": "lab",
    "nodes": {
        "rows": {"kind": "decode", "camera": "cam", "input": "none.mp4", "frames": "fused"},
        "track": {"kind": "track", "cameras": ["cam"]},
        "grid": {"kind": "reference", "grid": "ce", "input": "none.csv"},
        "live": {"kind": "live", "cameras": ["cam"], "grid": "ce", "live": {"lost_s": 1.5}},
    },
}
MODEL = """\
version: 2
light: {lamp: led}
shutter: {rows: 32, columns: 64, idle_ratio: 0.3}
"""
GRAPH = """\
version: 1
site: lab
nodes:
  decode:
    kind: decode
    camera: cam
    input: {{model: "{folder}/m.yaml", duration_s: 80, reference: "{folder}/g.csv", start_s: 60}}
    frames: fused
    record_video: false
  track:  {{kind: track, cameras: [cam]}}
  mains:  {{kind: reference, grid: mains, input: "{folder}/g.csv"}}
  live:   {{kind: live, cameras: [cam], grid: mains, start: 2026-01-02T03:05:00Z}}
  record: {{kind: record, out: "{folder}/out.mcap"}}
"""


WATCH = """\
version: 1
site: lab
nodes:
  cam:   {{kind: decode, camera: cam, input: "{url}", frames: fused, threads: 1}}
  track: {{kind: track, cameras: [cam]}}
  mains: {{kind: reference, grid: mains, input: "{table}", follow: true}}
  live:  {{kind: live, cameras: [cam], grid: mains, live: {{lost_s: 2}}}}
"""


def rows(second: int) -> RowBlock:
    at_ns = second * 10**9
    return RowBlock(
        header=Header(run_id="r", source="lab/cam", seq=second, pts_ns=at_ns, frame_last=second,
                      frame_first=second, arrival_time_ns=10**18 + at_ns),
        frames=1, rows=2, strips=1, frame_number=np.array([second]),
        frame_pts_ns=np.array([at_ns]), level=np.full((1, 2, 1), 100.0 + second, np.float32),
        kept_px=np.ones((2, 1), np.uint32),
    )  # fmt: skip


class Watched:
    """A live node that has had three pictures, and what it says."""

    def __init__(self) -> None:
        network = Loopback()
        self.told = Inbox()
        for topic in ("live", "alarm"):
            network.bus("listener").subscribe(self.told, camera_key("lab", "cam", topic), SIGNALS)
        self.node = node_on(network, "live", LOOPBACK)
        body, args = self.node.config.body, (self.node,)
        self.thread = threading.Thread(target=body, args=args, daemon=True)
        self.thread.start()
        self.sender = network.bus("sender")
        self.pictures = self.sender.publisher(camera_key("lab", "cam", "rows"), SIGNALS)
        while not self.pictures.is_heard:
            time.sleep(0.01)
        for second in range(3):
            self.pictures.send(rows(second))

    def next_of(self, *kinds: type) -> Any:
        while True:
            received = self.told.receive(10)
            assert received is not None
            if isinstance(received.message, kinds):
                return received.message


def test_verdicts_and_alarms_go_to_topics_of_their_own_and_both_end() -> None:
    watched = Watched()
    next_of, pictures, sender = watched.next_of, watched.pictures, watched.sender
    assert next_of(Liveness).verdict == "undecided"
    lost = next_of(Alarm)
    assert (lost.kind, lost.active) == ("lost", True)
    pictures.send(rows(3))  # which may have been in hand as the pictures stopped
    pictures.send(rows(4))
    back = next_of(Alarm)
    assert (back.kind, back.active, back.header.seq) == ("lost", False, 1)
    pictures.send(end_after(rows(4)))
    track = sender.publisher(camera_key("lab", "cam", "track"), SIGNALS)
    track.send(end_after(EnfEstimate(header=Header(run_id="r"))))
    grid = sender.publisher(reference_key("lab", "ce"), SIGNALS)
    grid.send(end_after(ReferenceBlock(header=Header(run_id="r"))))
    end = next_of(Alarm)
    assert end.header.is_end
    assert end.header.seq == 2
    watched.thread.join(10)
    assert not watched.thread.is_alive()


def test_pictures_that_wait_at_their_sender_are_not_lost() -> None:
    watched = Watched()
    words = watched.sender.publisher(health_key("lab", "rows"), HEALTH)

    def beat(*, waiting: int) -> None:
        words.send(Health(header=Header(seq=words.sent), state="running", queue_depth=waiting))

    assert watched.next_of(Liveness).verdict == "undecided"
    for _ in range(30):  # twice as long as it takes to call it lost
        beat(waiting=7)
        time.sleep(0.1)
    said = [
        received.message for _ in range(watched.told.depth) if (received := watched.told.receive(0))
    ]
    # No verdict hangs on how fast this computer is.
    assert {type(m) for m in said} <= {Liveness}, said
    assert not [m for m in said if "no picture" in m.evidence or "behind" in m.evidence]
    beat(waiting=0)
    lost = watched.next_of(Alarm)
    assert (lost.kind, lost.active) == ("lost", True)
    watched.node.stop.set()
    watched.thread.join(10)


@pytest.mark.processes
def test_a_tracker_that_hangs_is_no_outage_of_its_camera(
    live_run: type[LiveRun], tmp_path: Path
) -> None:
    if lacking := rtsp_server.missing():
        pytest.skip(lacking)
    table, graph = tmp_path / "mains.csv", tmp_path / "graph.yaml"
    table.write_text("time,frequency\n", encoding="utf-8")
    with rtsp_server.RtspServer(width_px=160, height_px=120, rate_hz="120/1") as server:
        graph.write_text(WATCH.format(url=server.url, table=table), encoding="utf-8")
        run = live_run(graph).until("running", "cam", "track", "live")

        def said(words: str) -> bool:
            return wait_until(lambda: any(words in line for line in run.lines), 60)

        assert said("lab/cam: undecided"), run.lines
        os.kill(run.pids["track"], signal.SIGSTOP)
        assert said("track: behind by"), run.lines
        assert said("cam: behind by"), run.lines
        time.sleep(4)  # twice as long as it takes to call it lost
        os.kill(run.pids["track"], signal.SIGCONT)
        assert said("track: caught up"), run.lines
        assert said("cam: caught up"), run.lines
        assert not [line for line in run.lines if "lost" in line]
        server.stall()
        assert said("alarm lost"), run.lines
    run.interrupt()


@pytest.mark.processes
def test_a_graph_tells_that_its_camera_is_live_and_tells_it_again(
    live_run: type[LiveRun], tmp_path: Path
) -> None:
    (tmp_path / "m.yaml").write_text(MODEL, encoding="utf-8")
    cycles = synthetic_grid(5, 202.0).cycles(np.arange(201.0))
    begin = datetime(2026, 1, 2, 3, 4, tzinfo=UTC)
    lines = [
        f"{(begin + timedelta(seconds=k)).isoformat()},{hz:.6f}"
        for k, hz in enumerate(np.diff(cycles))
    ]
    (tmp_path / "g.csv").write_text("\n".join(["time,frequency", *lines]), encoding="utf-8")
    graph = tmp_path / "graph.yaml"
    graph.write_text(GRAPH.format(folder=tmp_path), encoding="utf-8")
    run = live_run(graph, "--json")
    assert run.wait() == EXIT_DONE, run.lines
    printed = json.load(run.process.stdout)  # type: ignore[arg-type]
    verdict = printed["live"]["lab/cam"]
    assert verdict["verdict"] == "live"
    assert abs(verdict["lag_s"]) < 1.0
    assert printed["alarms"] == {}
    recording = tmp_path / "out.mcap"
    topics = open_recording(recording).topics
    assert {"rsenf/lab/cam/live", "rsenf/lab/cam/alarm"} <= set(topics)
    again = {v.topic: v for v in regress(recording).topics}
    assert again["rsenf/lab/cam/live"].passed
    assert again["rsenf/lab/cam/alarm"].passed


def test_a_graph_without_rows_or_reference_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "g.yaml"
    path.write_text(
        "version: 1\nsite: lab\nnodes:\n  live: {kind: live, cameras: [cam], grid: ce}\n",
        encoding="utf-8",
    )
    with pytest.raises(RsenfError) as caught:
        load_graph(path)
    said = str(caught.value)
    for missing in ("the rows of camera 'cam'", "the track of camera 'cam'", "the reference 'ce'"):
        assert f"nobody sends {missing}" in said


def test_a_start_is_utc_unless_it_tells_its_zone() -> None:
    for start, hour in (("2026-01-02T03:00:00", 3), ("2026-01-02T03:00:00+02:00", 1)):
        nodes = LOOPBACK["nodes"] | {"live": LOOPBACK["nodes"]["live"] | {"start": start}}
        graph = Graph.model_validate(LOOPBACK | {"nodes": nodes})
        moment = datetime(2026, 1, 2, hour, tzinfo=UTC)
        assert graph.nodes["live"].start_utc_ns == round(moment.timestamp()) * 10**9  # type: ignore[union-attr]

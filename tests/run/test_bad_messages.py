"""Whatever is sent under whatever key: it is dropped and counted, and who receives it lives."""

from __future__ import annotations

import dataclasses
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from live_run import LiveRun

from rsenf.bus.inbox import Inbox
from rsenf.bus.keys import LOOKING, SIGNALS, TOPICS, camera_key, health_key, reference_key
from rsenf.bus.sequence import Envelope
from rsenf.bus.zenoh_bus import BusSettings, open_bus
from rsenf.errors import SchemaMismatch
from rsenf.idle import make_idle
from rsenf.idle.estimator_state import IdleSettings
from rsenf.live import Live
from rsenf.match.stage import Match
from rsenf.messages import EnfEstimate, Header, ReferenceBlock, RowBlock, encode, encoding_of
from rsenf.messages.plausible import implausible, out_of_place
from rsenf.messages.schema import field_specs
from rsenf.run.process import Patience, wait_until
from rsenf.run.runner import Runner
from rsenf.track import make_tracker
from rsenf.track.method import TrackSettings
from tests.loopback import Loopback

CHEAP = settings(
    max_examples=25, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck)
)
FEW = settings(CHEAP, max_examples=8)


def key_of(topic: str) -> str:
    if topic == "health":
        return health_key("lab", "n")
    return reference_key("lab", "ce") if topic == "reference" else camera_key("lab", "cam", topic)


def inbox_of(topic: str) -> tuple[Inbox, Any]:
    network, inbox = Loopback(), Inbox(10_000)
    network.bus("listener").subscribe(inbox, key_of(topic), SIGNALS)
    return inbox, network.bus("sender").publisher(key_of(topic), SIGNALS)


def send(publisher: Any, encoding: str, payload: bytes) -> None:
    publisher._put(Envelope(publisher.key, encoding, payload, "stranger"))


VALUES = {
    "int64": st.integers(-(2**63), 2**63 - 1), "double": st.floats(), "float": st.floats(width=32),
    "string": st.text(max_size=8), "bool": st.booleans(), "bytes": st.binary(max_size=64),
}  # fmt: skip


def messages_of(cls: type[Any]) -> st.SearchStrategy[Any]:
    """Messages with any values at all in their plain fields."""
    plain = {s.name: VALUES[s.wire] for s in field_specs(cls) if s.kind == "scalar"}
    header = {s.name: VALUES[s.wire] for s in field_specs(Header) if s.kind == "scalar"}
    headers = st.builds(Header, **header)
    return st.builds(cls, header=st.one_of(st.none(), headers), **plain)


@pytest.mark.parametrize("topic", TOPICS)
def test_what_does_not_parse_is_counted_on_every_topic(topic: str) -> None:
    cls = TOPICS[topic]
    whole = encode(cls(header=Header(run_id="true", source="lab/cam", seq=0, frame_last=7)))
    encodings = [encoding_of(cls), encoding_of(cls) + "9", "application/protobuf;rsenf.Nothing/1",
                 "text/plain", "", "application/protobuf;" * 40]  # fmt: skip

    @CHEAP
    @given(st.sampled_from(encodings), st.binary(max_size=200), st.integers(0, len(whole)))
    def check(encoding: str, noise: bytes, cut: int) -> None:
        inbox, publisher = inbox_of(topic)
        for payload in (noise, whole[:cut], whole[:cut] + noise, noise + whole):
            send(publisher, encoding, payload)
        send(publisher, encoding_of(cls), b"\0" * 10_001)  # too large
        publisher.send(cls(header=Header(run_id="true", seq=9)))
        came = []
        while received := inbox.receive(0):
            came.append(received.message)
        assert came[-1].header.seq == 9
        assert all(type(message) is cls for message in came)
        assert len(came) + inbox.counters.rejected + inbox.counters.duplicates == 6
        assert inbox.counters.rejected >= 1
        if encoding != encoding_of(cls):
            assert inbox.counters.rejected == 5

    check()


@pytest.mark.parametrize("topic", TOPICS)
def test_values_that_can_not_be_never_break_the_count(topic: str) -> None:
    cls = TOPICS[topic]

    @CHEAP
    @given(st.lists(messages_of(cls), max_size=4))
    def check(messages: list[Any]) -> None:
        inbox, publisher = inbox_of(topic)
        sent = 0
        for message in messages:
            try:
                payload = encode(message)
            except ValueError:  # dimensions of arrays that there aren't
                continue
            send(publisher, encoding_of(cls), payload)
            sent += 1
        came = 0
        while received := inbox.receive(0):
            came += 1
            assert not implausible(received.message)
        counted = inbox.counters
        assert came + counted.rejected + counted.duplicates == sent
        assert counted.missed < 2**60  # it goes into a message itself

    check()


ODD = st.sampled_from([0, 1, -1, 7, 8, 10**9, 2**40, 2**61, -(2**61)])
FLOATS = st.sampled_from([0.0, -1.0, 50.0, 1e300, -1e300, float("nan"), float("inf"), 1e-300])


@st.composite
def blocks(draw: st.DrawFn, k: int) -> RowBlock:
    """A block of rows that is right, but for some of its values."""
    frames, rows, strips = draw(st.sampled_from([(8, 24, 1)] * 4 + [(1, 7, 2), (3, 1, 1)]))
    number = 8 * k + np.arange(frames)
    if draw(st.integers(0, 4)) == 0:
        number = np.sort(draw(ODD) + np.arange(frames) * draw(st.integers(0, 3)))
    pts_ns = number % 2**40 * 33_333_333 + (draw(ODD) if draw(st.integers(0, 6)) == 0 else 0)
    level = 120 + 30 * np.cos(0.7 * number[:, None, None] + np.zeros((frames, rows, strips)))
    if draw(st.integers(0, 4)) == 0:
        level[:] = draw(FLOATS)
    first, last, start = int(number[0]), int(number[-1]), int(pts_ns[0])
    header = Header(run_id="r", seq=k, frame_first=first, frame_last=last, pts_ns=start)
    return RowBlock(
        header=header, frames=frames, rows=rows, strips=strips,
        frame_number=number.astype("<i8"), frame_pts_ns=pts_ns.astype("<i8"),
        level=level.astype(np.float32), kept_px=np.full((rows, strips), 9, np.uint32),
        steady_ratio=draw(FLOATS), usable=draw(st.booleans()),
    )  # fmt: skip


STAGES = {
    "projection": (blocks, lambda: Runner("track", lambda: make_tracker(TrackSettings()))),
    "stft": (blocks, lambda: Runner("track", lambda: make_tracker(TrackSettings(method="stft")))),
    "idle": (blocks, lambda: Runner("idle", lambda: make_idle(IdleSettings()))),
}


@pytest.mark.parametrize("name", STAGES)
def test_no_stage_stumbles_over_what_is_let_through(name: str) -> None:
    made, make_runner = STAGES[name]

    @FEW
    @given(st.data())
    def check(data: st.DataObject) -> None:
        runner, taken = make_runner(), 0
        for k in range(16):
            message = data.draw(made(k))
            if implausible(message):
                continue
            try:
                out = runner.feed(message)
            except SchemaMismatch:
                continue
            taken += 1
            for completed in out:
                encode(completed)
        for completed in runner.end(Header(run_id="r")):
            encode(completed)

    check()


@pytest.mark.parametrize("level", [np.inf, -np.inf, np.nan, 1e30])
@pytest.mark.parametrize("usable", [True, False])
def test_rows_have_levels(level: float, usable: bool) -> None:
    rows = np.full((2, 3, 1), 100.0, np.float32)
    numbers = {"frame_number": np.arange(2), "frame_pts_ns": np.array([0, 40_000_000])}
    block = RowBlock(
        header=Header(run_id="r", frame_first=0, frame_last=1), frames=2, rows=3, strips=1,
        level=rows, kept_px=np.full((3, 1), 9, np.uint32), usable=usable, **numbers,
    )  # fmt: skip
    assert not implausible(block)
    rows[1, 2] = level
    assert implausible(block) == "levels that aren't"


def test_estimates_and_references_out_of_place_are_refused() -> None:
    match = Match(grid="ce")

    def estimate(start_s: int, **more: Any) -> EnfEstimate:
        times = {"start_pts_ns": start_s * 10**9, "end_pts_ns": (start_s + 20) * 10**9}
        return EnfEstimate(header=Header(run_id="r"), nominal_hz=50.0, **{**times, **more})

    match.update(estimate(5))
    for bad in (estimate(4), estimate(5 + 3601), estimate(6, origin_pts_ns=7)):
        with pytest.raises(SchemaMismatch):
            match.update(bad)
    match.update(estimate(6))
    block = ReferenceBlock(
        header=Header(run_id="r"), grid="ce", step_ns=10**9, samples=3, freq_hz=np.full(3, 50.0)
    )
    match.update(block)
    with pytest.raises(SchemaMismatch):
        match.update(dataclasses.replace(block, step_ns=10**8))
    match.update(dataclasses.replace(block, t0_ns=9, header=Header(run_id="r.mains1")))


def test_one_that_leaps_is_refused_and_the_stage_goes_on() -> None:
    runner = Runner("track", lambda: make_tracker(TrackSettings()))
    header = Header(run_id="r", frame_first=0, frame_last=7)
    runner.feed(RowBlock(header=header))
    leap = dataclasses.replace(header, seq=1, pts_ns=10**15)
    with pytest.raises(SchemaMismatch, match="278 h"):
        runner.feed(RowBlock(header=leap))
    with pytest.raises(SchemaMismatch, match="frame 3 comes after 7"):
        runner.feed(RowBlock(header=dataclasses.replace(header, seq=1, frame_last=3)))
    runner.feed(RowBlock(header=dataclasses.replace(leap, epoch=1)))  # another epoch may
    runner.feed(RowBlock(header=dataclasses.replace(header, epoch=1, pts_ns=10**15, frame_last=9)))


def test_seconds_without_frames_are_taken_and_hide_no_step_back() -> None:
    """A tracker tells of every second of a pause, though no frame is of it."""
    runner = Runner("live", Live)
    frames = (0, 7), (-1, -1), (-1, -1), (1 << 25, 1 << 25), (-1, -1)
    for seq, (first, last) in enumerate(frames):
        header = Header(run_id="r", seq=seq, frame_first=first, frame_last=last)
        if first > 7:
            with pytest.raises(SchemaMismatch, match="comes after 7"):
                runner.feed(EnfEstimate(header=header))
        else:
            runner.feed(EnfEstimate(header=header))
    with pytest.raises(SchemaMismatch, match="frame 3 comes after 7"):
        runner.feed(EnfEstimate(header=Header(run_id="r", seq=5, frame_first=3, frame_last=3)))


def test_before_the_first_frame_no_clock_can_leap() -> None:
    silent, first = Header(run_id="r"), Header(run_id="r", frame_last=7, pts_ns=10**18)
    assert out_of_place(first, silent) == ""
    assert "leaps" in out_of_place(dataclasses.replace(silent, pts_ns=10**18), silent)


GRAPH = """\
version: 1
site: lab
bus: {{largest_mb: 1}}
nodes:
  track: {{kind: track, cameras: [cam], track: {{nominal_hz: 50}}}}
  rows: {{kind: rows, cameras: [cam]}}
  idle: {{kind: idle, cameras: [cam]}}
  match: {{kind: match, cameras: [cam], grid: ce}}
  grid: {{kind: reference, grid: ce, input: "{reference}"}}
  decode: {{kind: decode, camera: cam, pace: true, frames: tcp,
    input: {{model: configs/model/demo_480p.yaml, duration_s: 60}}}}
  record: {{kind: record, out: "{out}"}}
"""


@pytest.mark.processes
def test_real_nodes_live_through_it(tmp_path: Path, live_run: type[LiveRun]) -> None:
    path, grid = tmp_path / "graph.yaml", tmp_path / "grid.csv"
    grid.write_text("\n".join(["time_s,frequency", *(f"{k},50.0" for k in range(300))]))
    path.write_text(GRAPH.format(reference=grid, out=tmp_path / "out.mcap"))
    nodes = ("decode", "rows", "track", "idle", "match", "record")
    run = live_run(path).until("running", *nodes)
    rejected: dict[str, int] = {}
    words = Inbox()
    with open_bus(BusSettings(connect=(run.endpoint,))) as bus:
        bus.subscribe(words, health_key("lab", "*"), LOOKING)
        for topic, cls in TOPICS.items():
            publisher = bus.publisher(key_of(topic), SIGNALS)
            assert wait_until(lambda publisher=publisher: publisher.is_heard)
            right = encoding_of(cls)
            header = Header(run_id=run.run_id, source="lab/cam", seq=2**60, frame_last=7)
            for encoding, payload in (
                (right, b"\xff" * 50), (right + "7", encode(cls(header=Header()))), ("", b""),
                (right, bytes(2_000_000)), (right, encode(cls())),
                (right, encode(cls(header=header))),
            ):  # fmt: skip
                send(publisher, encoding, payload)
        # Each input of a node counts; the recorder reads them all.
        due = dict.fromkeys(nodes[1:4], 6) | {"match": 12, "record": 6 * len(TOPICS)}
        patience = Patience(20)
        while any(rejected.get(name, 0) < count for name, count in due.items()):
            assert not patience.over, rejected
            if received := words.receive(0.5):
                rejected[received.message.node] = received.message.rejected
    assert run.process.poll() is None
    run.interrupt()
    assert run.process.returncode == 0, "\n".join(run.lines)
    assert {name: rejected[name] for name in due} == due
    assert threading.active_count() < 50

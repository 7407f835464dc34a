"""What nodes do beside their stages, on a bus within one process: ends, losses, last words."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from run_samples import GRAPH, Counting, block, end_after, node_on, wall

from rsenf.bus.frames import FrameReceiver
from rsenf.bus.inbox import Inbox
from rsenf.bus.keys import (
    FRAMES_FILE,
    LOOKING,
    SIGNALS,
    TOPICS,
    alive_key,
    camera_key,
    health_key,
    reference_key,
    word_key,
)
from rsenf.errors import InputError
from rsenf.messages import EnfEstimate, Frame, Header, Health, IdleEstimate, RowBlock
from rsenf.rows.stage import Rows
from rsenf.run import peers as peers_module
from rsenf.run import pump as pump_module
from rsenf.run.health import EVERY_S
from rsenf.run.node import NodeProcess
from rsenf.run.peers import Peers
from rsenf.run.pump import Lane, lane_of, pump
from rsenf.run.recording import Ending
from rsenf.run.runner import Runner
from rsenf.stage import StageSpec
from tests.loopback import Loopback

ROWS, TRACK = camera_key("lab", "cam", "rows"), camera_key("lab", "cam", "track")


@pytest.fixture
def network() -> Loopback:
    return Loopback()


@contextmanager
def pumping(node: NodeProcess, lanes: list[Lane]) -> Iterator[threading.Thread]:
    thread = threading.Thread(target=pump, args=(node, lanes), daemon=True)
    thread.start()
    yield thread
    node.stop.set()
    thread.join(10)
    assert not thread.is_alive()


def lane(
    node: NodeProcess, *inputs: str, sender: str = "rows", camera: str = "cam", topic: str = "track"
) -> Lane:
    publisher = node.publisher(camera, topic)
    return Lane(
        node=node,
        runner=Runner(topic, Counting, inputs=len(inputs) or 1),
        publishers=dict.fromkeys((TOPICS[topic], EnfEstimate), publisher),
        inputs={node.subscribe(key): sender for key in inputs or (ROWS,)},
    )


def listen(network: Loopback, key: str) -> Inbox:
    inbox = Inbox()
    network.bus("listener").subscribe(inbox, key, SIGNALS)
    return inbox


def until_end(inbox: Inbox) -> list[Any]:
    out = []
    while not out or not out[-1].header.is_end:
        received = inbox.receive(20)
        assert received is not None, "no END mark"
        out.append(received.message)
    return out


def test_a_lane_pumps_until_its_input_ends(network: Loopback) -> None:
    node, out = node_on(network, "track"), listen(network, TRACK)
    rows = network.bus("rows").publisher(ROWS, SIGNALS)
    with pumping(node, [lane(node)]) as thread:
        for seq in range(5):
            rows.send(block(seq))
        rows.send(end_after(block(4)))
        thread.join(10)
        assert not thread.is_alive()
    assert [m.method for m in until_end(out)] == ["update", "update", "flush", ""]


def test_told_to_stop_it_takes_what_has_arrived_and_ends_its_streams(network: Loopback) -> None:
    node, out = node_on(network, "track"), listen(network, TRACK)
    rows = network.bus("rows").publisher(ROWS, SIGNALS)
    for seq in range(64):
        rows.send(block(seq))  # waits as history
    the_lane = lane(node)
    node.stop.set()
    pump(node, [the_lane])
    assert len(until_end(out)) == 32 + 2


def test_an_input_whose_sender_is_gone_is_given_up_while_others_go_on(
    network: Loopback, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pump_module, "GIVE_UP_S", 0.1)
    both = {"track": {"kind": "track", "cameras": ["cam", "other"]}}
    node = node_on(network, "track", {**GRAPH, "nodes": GRAPH["nodes"] | both})  # type: ignore[operator]
    other, out = camera_key("lab", "other", "rows"), listen(network, TRACK)
    dead, living = network.bus("rows"), network.bus("busy")
    dead.declare_alive(alive_key("lab", "rows"))
    lanes = [lane(node), lane(node, other, sender="busy", camera="other")]
    with pumping(node, lanes):
        dead.publisher(ROWS, SIGNALS).send(block(0))
        busy, ended = living.publisher(other, SIGNALS), threading.Event()

        def keep_busy() -> None:
            for seq in range(10**9):
                busy.send(block(seq))
                if ended.wait(0.005):
                    break

        sending = threading.Thread(target=keep_busy)
        sending.start()
        dead.close()  # killed, without an END mark
        assert [m.method for m in until_end(out)] == ["flush", ""]
        assert lanes[0].inputs == {}
        assert lanes[1].inputs != {}
        ended.set()
        sending.join(10)


def test_a_sender_that_has_gone_is_heard_out_however_long_a_stage_takes(
    network: Loopback, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pump_module, "GIVE_UP_S", 0.1)
    node, out = node_on(network, "track"), listen(network, TRACK)
    the_lane = lane(node)
    quick = the_lane.runner.feed

    def slow(message: Any) -> list[Any]:
        time.sleep(0.25)
        return quick(message)

    the_lane.runner.feed = slow  # type: ignore[method-assign]
    rows = network.bus("rows")
    rows.declare_alive(alive_key("lab", "rows"))
    publisher = rows.publisher(ROWS, SIGNALS)
    with pumping(node, [the_lane]):
        for seq in range(4):
            publisher.send(block(seq))
        publisher.send(end_after(block(3)))
        rows.close()
        assert [m.method for m in until_end(out)] == ["update", "update", "flush", ""]


def test_what_is_under_way_of_a_sender_that_ended_well_is_waited_for(
    network: Loopback, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pump_module, "GIVE_UP_S", 0.1)
    node, out = node_on(network, "track"), listen(network, TRACK)
    rows, late = network.bus("rows"), network.bus("late")
    rows.declare_alive(alive_key("lab", "rows"))
    publisher = late.publisher(ROWS, SIGNALS)  # what a slow link brings after the token is gone
    with pumping(node, [lane(node)]):
        publisher.send(block(0))
        node.peers.on_state("rows", "done")
        rows.close()
        time.sleep(0.5)
        publisher.send(block(1))
        publisher.send(end_after(block(1)))
        assert [m.method for m in until_end(out)] == ["update", "flush", ""]


def test_a_late_end_of_an_input_given_up_ends_nothing_twice(network: Loopback) -> None:
    node = node_on(network, "match")
    reference = reference_key("lab", "ce")
    the_lane = lane(node, TRACK, reference, sender="gone", topic="match")
    out = listen(network, TRACK)
    node.peers = Peers({"gone"}, gone=["gone"])
    node.peers._gone_since["gone"] = -1e9
    the_lane.give_up()  # nothing heard yet: since now
    the_lane._heard = {TRACK: -1e9, reference: time.monotonic()}
    the_lane.give_up()
    assert list(the_lane.inputs) == [reference]
    network.bus("late").publisher(TRACK, SIGNALS).send(
        EnfEstimate(header=end_after(block(3)).header)
    )
    received = node.inbox.receive(1)
    assert received is not None
    the_lane.feed(received)
    assert list(the_lane.inputs) == [reference]
    assert out.depth == 1  # what was sent as the late END mark, and nothing by the lane
    the_lane.end()
    assert the_lane.runner.ended


def test_peers_that_finish_are_not_lost_and_those_that_vanish_are(
    network: Loopback, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(peers_module, "LAST_WORD_S", 0.05)
    node = node_on(network, "record")
    others = {name: network.bus(name) for name in ("decode", "rows", "track")}
    words = {n: b.publisher(word_key("lab", n), SIGNALS) for n, b in others.items()}
    for name, bus in others.items():
        bus.declare_alive(alive_key("lab", name))
    assert node.peers.missing == {"grid", "match"}
    words["decode"].send(Health(header=Header(run_id="r"), node="decode", state="done"))
    others["decode"].close()
    others["track"].close()  # its word comes after its token has gone
    words["track"].send(Health(header=Header(run_id="r"), node="track", state="done"))
    others["rows"].close()
    while node.peers.lost != ("rows",):
        assert set(node.peers.lost) <= {"rows"}
        time.sleep(0.005)
    time.sleep(2 * peers_module.LAST_WORD_S)
    assert node.peers.lost == ("rows",)
    assert all(node.peers.gone_for_s(name) > 0 for name in others)
    network.bus("rows").declare_alive(alive_key("lab", "rows"))  # started again
    assert node.peers.lost == ()
    assert node.peers.gone_for_s("rows") == 0


def test_a_peer_that_failed_before_it_was_ready_is_not_waited_for(network: Loopback) -> None:
    node = node_on(network, "rows")
    for name in ("track", "grid", "match", "record"):
        network.bus(name).declare_alive(alive_key("lab", name))
    failed = Health(header=Header(run_id="r"), node="decode", state="failed")
    network.bus("decode").publisher(word_key("lab", "decode"), SIGNALS).send(failed)
    node.wait_for_peers()
    assert node.peers.lost == ()
    assert node.peers.gone_for_s("decode") > 0


def test_words_are_listened_to_and_all_health_where_a_program_may_send_no_words(
    network: Loopback,
) -> None:
    own = {"kind": "external", "command": ["x"]}
    graph: dict[str, Any] = {**GRAPH, "nodes": {**GRAPH["nodes"], "own": own}}  # type: ignore[dict-item]
    by_words, by_health = node_on(network, "match"), node_on(network, "record", graph)
    done = Health(header=Header(run_id="r"), node="rows", state="done")
    network.bus("rows").publisher(health_key("lab", "rows"), SIGNALS).send(done)
    assert by_health.peers.has_finished("rows")
    assert not by_words.peers.has_finished("rows")
    network.bus("rows").publisher(word_key("lab", "rows"), SIGNALS).send(done)
    assert by_words.peers.has_finished("rows")


def test_a_change_of_state_is_a_word_and_nothing_else_is(network: Loopback) -> None:
    words = Inbox()
    network.bus("looker").subscribe(words, word_key("lab", "track"), LOOKING)
    node = node_on(network, "track")
    for state, detail in (("running", ""), ("running", "more"), ("done", "more")):
        node.say(state, detail)
    said = [words.receive(1).message for _ in range(2)]  # type: ignore[union-attr]
    assert [(word.state, word.header.seq) for word in said] == [("running", 0), ("done", 1)]
    assert words.depth == 0


def test_a_node_says_whom_it_waits_for(network: Loopback, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rsenf.run.node.PATIENCE_S", 0.05)
    node, health = node_on(network, "decode"), health_of(network, "decode")
    for name in ("rows", "track", "grid", "match"):
        network.bus(name).declare_alive(alive_key("lab", name))
    waiting = threading.Thread(target=node.wait_for_peers)
    waiting.start()
    received = health.receive(20)
    assert received is not None
    assert (received.message.state, received.message.detail) == ("waiting", "for record")
    network.bus("record").declare_alive(alive_key("lab", "record"))
    waiting.join(20)
    assert last(health).state == "running"


def test_a_node_told_to_stop_waits_for_nobody(network: Loopback) -> None:
    node = node_on(network, "decode")
    node.stop.set()
    node.wait_for_peers()


def health_of(network: Loopback, name: str) -> Inbox:
    inbox = Inbox()
    network.bus("looker").subscribe(inbox, health_key("lab", name), LOOKING)
    return inbox


def last(inbox: Inbox) -> Health:
    found = None
    while (received := inbox.receive(0)) is not None:
        found = received.message
    assert isinstance(found, Health)
    return found


def test_health_counts_what_happened(network: Loopback) -> None:
    node, health = node_on(network, "track"), health_of(network, "track")
    the_lane = lane(node)
    rows = network.bus("rows").publisher(ROWS, SIGNALS)
    with pumping(node, [the_lane]) as thread:
        for seq in (0, 1, 2, 5):
            rows.send(block(seq))
        rows.send(EnfEstimate(header=Header(run_id="r", seq=6)))  # not what this topic carries
        rows.send(end_after(block(5)))
        thread.join(10)
    node.inbox.counters.dropped += 1
    node.say("running", "seen rtsp://user:hunter2@host/x")
    report = last(health)
    assert (report.messages_in, report.messages_out) == (5, 4)
    assert (report.missed, report.rejected, report.dropped) == (2, 1, 1)
    assert (report.node, report.kind, report.state) == ("track", "track", "running")
    assert report.detail == "seen rtsp://***@host/x"
    assert report.memory_bytes > 1e7
    assert report.cpu_s > 0
    assert report.last_input_ns > 0


def test_health_numbers_are_in_order_though_several_threads_speak(network: Loopback) -> None:
    node, health = node_on(network, "track"), health_of(network, "track")
    speaking = [
        threading.Thread(target=lambda: [node.say("running", str(k)) for k in range(50)])
        for _ in range(4)
    ]
    for thread in speaking:
        thread.start()
    for thread in speaking:
        thread.join(10)
    last(health)
    assert health.counters.received == 200
    assert health.counters.missed == health.counters.duplicates == 0


def test_the_beat_tells_of_a_lost_peer_at_once_and_stops_with_its_supervisor(
    network: Loopback, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(peers_module, "LAST_WORD_S", 0.02)
    monkeypatch.setattr("rsenf.run.heartbeat.BEAT_S", 0.01)
    monkeypatch.setattr("rsenf.run.health.EVERY_S", 3600.0)
    node, health = node_on(network, "track"), health_of(network, "track")
    rows = network.bus("rows")
    rows.declare_alive(alive_key("lab", "rows"))
    with node.reporting():
        rows.close()
        while (received := health.receive(20)) and not received.message.lost_peers:
            pass
        assert received is not None
        assert received.message.lost_peers == ("rows",)
        assert not node.stop.is_set()
    with node.beating(supervisor=1):  # not the process that started this one
        assert node.stop.wait(20)


@pytest.mark.parametrize(
    ("raised", "state"),
    [(None, "done"), (InputError("no frame", "hint"), "failed"), (KeyError("bug"), "failed")],
)
def test_the_last_word(network: Loopback, raised: Exception | None, state: str) -> None:
    node, health = node_on(network, "track"), health_of(network, "track")

    def body(node: NodeProcess) -> None:
        node.ready()
        node.exit_code = 3
        if raised:
            raise raised

    if raised:
        with pytest.raises(type(raised)):
            node.live(body)
    else:
        assert node.live(body) == 3
    word = last(health)
    assert word.state == state
    assert not raised or str(raised.args[0]) in word.detail


def test_a_recording_ends_with_the_streams_it_records(
    network: Loopback, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rsenf.run.recording.GONE_LINGER_S", 0.02)
    keys = {
        "decode": [camera_key("lab", "cam", "frames"), camera_key("lab", "cam", "video")],
        "rows": [ROWS],
        "track": [TRACK],
        "grid": [reference_key("lab", "ce")],
        "match": [camera_key("lab", "cam", "match")],
    }
    node = node_on(network, "record")
    buses = {name: network.bus(name) for name in keys}
    for name, bus in buses.items():
        bus.declare_alive(alive_key("lab", name))
    some = Ending(node, ["rsenf/lab/*/track", "rsenf/lab/reference/**"])
    every = Ending(node, ["rsenf/lab/**"])
    end = end_after(block(0)).header
    for name in ("rows", "track", "grid"):
        for key in keys[name]:
            some.note(key, end)
            every.note(key, end)
    assert some.reached()
    assert not every.reached()
    every.note(keys["match"][0], end)
    every.note(keys["decode"][0], end)
    assert not every.reached()
    buses["decode"].close()  # killed before its video ended
    # What else is heard, such as the health of others, doesn't keep it waiting.
    while not every.reached():
        every.note(health_key("lab", "record"), Header())
    node.stop.set()
    assert Ending(node, ["rsenf/lab/x"]).reached()


def test_a_recording_of_others_alone_ends_when_told_to(
    network: Loopback, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rsenf.run.recording.STOP_LINGER_S", 0.0)
    alone = {**GRAPH, "nodes": {"record": GRAPH["nodes"]["record"]}}  # type: ignore[index]
    node = node_on(network, "record", alone)
    ending = Ending(node, ["rsenf/lab/**"])
    assert not ending.reached()
    node.stop.set()
    assert ending.reached()


def test_frames_of_a_stranger_do_not_end_the_rows_node(network: Loopback) -> None:
    node, out = node_on(network, "rows"), listen(network, ROWS)
    key = node.subscribe(camera_key("lab", "cam", "frames"))
    the_lane = Lane(
        node=node,
        runner=Runner("rows", Rows),
        publishers={RowBlock: node.publisher("cam", "rows")},
        inputs={key: "decode"},
        frames=FrameReceiver(),
    )
    sender = network.bus("decode").publisher(key, FRAMES_FILE)
    frames = list(wall(16))
    with pumping(node, [the_lane]) as thread:
        sender.send(Frame(header=Header(run_id="r", seq=0), height_px=3, width_px=3, pixels=b"x"))
        for frame in frames:
            assert frame.luma is not None
            sent = Frame(
                header=frame.header.numbered(frame.header.seq + 1),
                height_px=24,
                width_px=32,
                pixels=frame.luma.tobytes(),
            )
            sender.send(sent)
        sender.send(end_after(sent))
        thread.join(10)
    assert [m.frames for m in until_end(out)] == [8, 8, 0]
    assert node.inbox.counters.rejected == 1


class Guessing:
    """An idle stage that is refused at first, and knows at the end."""

    def update(self, message: RowBlock) -> list[Any]:
        return [IdleEstimate(header=message.header.numbered(0), verdict="refused", reason="dark")]

    def flush(self) -> list[Any]:
        return [
            IdleEstimate(
                header=Header(seq=1), verdict="estimated", idle_ratio=0.25, idle_ratio_var=1e-6
            )
        ]


def test_what_a_node_shows_is_told_now_and_then_and_with_its_next_beat(
    network: Loopback, monkeypatch: pytest.MonkeyPatch
) -> None:
    now_s = [100.0]
    monkeypatch.setattr("rsenf.run.health.time.monotonic", lambda: now_s[0])
    node, health = node_on(network, "track"), health_of(network, "track")
    details = []
    for count in range(71):  # 64 a second
        node.show(f"estimate {count}")
        now_s[0] += 1 / 64
    node._health.beat()
    now_s[0] += EVERY_S
    node._health.beat()
    while received := health.receive(0.0):
        details.append(received.message.detail)
    assert details == ["estimate 0", "estimate 32", "estimate 64", "estimate 70"]


def test_an_idle_node_says_how_far_it_has_come_with_each_camera(
    network: Loopback, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rsenf.run.health.DETAIL_EVERY_S", 0.0)
    nodes = {"idle": {"kind": "idle", "cameras": ["cam", "yard"]}}
    node = node_on(network, "idle", {"version": 1, "site": "lab", "nodes": nodes})
    health = health_of(network, "idle")
    guess = StageSpec(("idle",), ("rows",), Guessing, shown="idle")
    lanes = [lane_of(node, camera, [guess]) for camera in ("cam", "yard")]
    out = listen(network, camera_key("lab", "yard", "idle"))
    with pumping(node, lanes) as thread:
        for camera in ("cam", "yard"):
            rows = network.bus(camera).publisher(camera_key("lab", camera, "rows"), SIGNALS)
            rows.send(block(0))
            if camera == "yard":
                rows.send(end_after(block(0)))
        assert [m.verdict for m in until_end(out)] == ["refused", "estimated", "no_signal"]
        node.stop.set()
        thread.join(10)
    said = []
    while received := health.receive(0.0):
        said.append(received.message.detail)
    assert said == [
        "cam refused: dark",
        "cam refused: dark; yard refused: dark",
        "cam refused: dark; yard idle 25.000 ± 0.100 %",
        "cam idle 25.000 ± 0.100 %; yard idle 25.000 ± 0.100 %",
    ]


def test_what_is_no_word_of_a_node_is_refused(network: Loopback) -> None:
    """Where its history holds one, too: a node that joins late begins all the same."""
    stranger = network.bus("stranger").publisher(word_key("lab", "track"), SIGNALS)
    stranger.send(EnfEstimate(header=Header(run_id="r", seq=0)))
    node = node_on(network, "rows")
    stranger.send(EnfEstimate(header=Header(run_id="r", seq=1)))
    node_on(network, "track").say("done")
    assert node.peers.has_finished("track")

"""Nodes that die or hang are started again: when, how often, and what the others make of it."""

from __future__ import annotations

import os
import re
import signal
import sys
import time
from collections import deque
from pathlib import Path
from typing import Any

import pytest
from conftest import Film, Graphs, made_film
from live_run import LIMIT_S, LiveRun
from run_samples import GRAPH, block, node_on

from rsenf.bus.inbox import Inbox
from rsenf.bus.keys import LOOKING, SIGNALS, alive_key, camera_key, health_key, start_suffix
from rsenf.bus.zenoh_bus import BusSettings, open_bus
from rsenf.config import Graph
from rsenf.config.node_kind import Restart
from rsenf.config.schemas import RecordSettings
from rsenf.errors import EXIT_DONE, EXIT_FAILED, EXIT_LOSS, EXIT_USAGE
from rsenf.messages import Header, Health, RowBlock, encode
from rsenf.record import open_recording
from rsenf.run.graph_run import GraphRun
from rsenf.run.heartbeat import FIRST_WORD_S, Heartbeat, Progress, send_beat
from rsenf.run.metrics import GraphMetrics
from rsenf.run.outlets import _Departed
from rsenf.run.process import wait_until
from rsenf.run.recording import of_run, open_sink
from rsenf.run.restart_policy import NodeState, RestartPolicy, pause_s
from rsenf.run.roster import Roster
from tests.loopback import Loopback

RULE = {
    "limit": 2,
    "within_s": 60,
    "backoff_s": 1,
    "backoff_max_s": 3,
    "silent_s": 5,
    "stalled_s": 20,
}
AGAIN = {**GRAPH, "restart": RULE}


def test_pauses_grow_and_end_with_the_limit() -> None:
    rule, deaths_s = Restart(limit=4, within_s=60, backoff_s=1, backoff_max_s=3), deque[float]()
    assert [pause_s(rule, deaths_s, t, -9) for t in (0, 1, 2, 3, 4)] == [1, 2, 3, 3, None]
    assert pause_s(rule, deaths_s, 61.5, -9) == 3  # two of the four are long past


def test_what_is_wrongly_set_up_is_not_tried_again() -> None:
    assert pause_s(Restart(), deque(), 0, EXIT_USAGE) is None
    assert pause_s(Restart(), deque(), 0, EXIT_FAILED) == 0.5
    assert pause_s(None, deque(), 0, EXIT_FAILED) is None


def test_a_node_has_its_own_rule_or_the_graphs() -> None:
    own = {"kind": "rows", "cameras": ["cam"], "restart": {"limit": 9}}
    graph = Graph.model_validate({**AGAIN, "nodes": {**GRAPH["nodes"], "rows": own}})  # type: ignore[dict-item]
    limits = [rule.limit if (rule := graph.restart_of(n)) else None for n in ("rows", "track")]
    assert limits == [9, 2]
    assert Graph.model_validate(GRAPH).restart_of("rows") is None


class Process:
    """Stands for a node's process."""

    def __init__(self, pid: int) -> None:
        self.pid, self.code, self.signals = pid, None, list[int]()

    def poll(self) -> int | None:
        return self.code

    def send_signal(self, number: int) -> None:
        self.signals.append(number)


class Run:
    """A run of the graph with a clock and processes of its own."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, of: dict[str, Any] = AGAIN) -> None:
        self.now_s, self.started = 0.0, list[str]()
        graph = Graph.model_validate(of)
        self.nodes = {name: NodeState(name, config.kind) for name, config in graph.nodes.items()}
        self.network = Loopback()
        bus = self.network.bus("supervisor")
        self.run = GraphRun(graph, "r", "", self.nodes, lambda node: None, self._spawn, bus)
        self.run._revival = RestartPolicy(graph, self.nodes, self._spawn, lambda: self.now_s)
        monkeypatch.setattr("rsenf.run.graph_run.POLL_S", 0.0)
        self.run.start()
        self.seq = 0

    def _spawn(self, node: NodeState) -> Any:
        self.started.append(node.name)
        return Process(100 + len(self.started))

    def word(self, name: str, state: str = "running", **more: Any) -> None:
        process = self.nodes[name].process
        assert process is not None
        bus, self.seq = self.network.bus(name), self.seq + 1
        said = Health(
            header=Header(run_id="r" + start_suffix(name, self.nodes[name].restarts), seq=self.seq),
            node=name,
            state=state,
            pid=process.pid,
            **more,
        )
        bus.publisher(health_key("lab", name), SIGNALS).send(said)
        self.run.watch(0)

    def beat(self, but: str = "", **progress: tuple[int, int, int]) -> None:
        """Let all nodes send a heartbeat but one; those named, with this progress."""
        for name in set(self.nodes) - {but}:
            heartbeat = self.nodes[name].heartbeat
            assert heartbeat is not None
            send_beat(heartbeat.writer, Progress(*progress.get(name, (0, 0, 0))))

    def after(self, seconds: float) -> None:
        """Let time pass in steps that are none of a supervisor that is held up."""
        for _ in range(round(seconds * 2)):
            self.now_s += 0.5
            while self.run._words.depth:  # what it says itself comes back to it
                self.run.watch(0)
            self.run.watch(0)

    def talk(self, seconds: float, **stuck: dict[str, Any]) -> None:
        """Let all nodes send health every second; those named, with these counts."""
        for _ in range(round(seconds)):
            for name in self.nodes:
                self.word(name, **stuck.get(name, {}))
            self.after(1)

    @property
    def killed(self) -> list[str]:
        return [n.name for n in self.nodes.values() if n.process and n.process.signals]  # type: ignore[attr-defined]

    def dies(self, name: str, code: int = -9) -> None:
        self.nodes[name].process.code = code  # type: ignore[union-attr, assignment]
        self.run.watch(0)


@pytest.fixture
def supervised(monkeypatch: pytest.MonkeyPatch) -> Run:
    run = Run(monkeypatch)
    for name in run.nodes:
        run.word(name)
    run.started.clear()
    return run


def test_a_dead_node_is_started_again_until_the_limit(supervised: Run) -> None:
    peers = node_on(supervised.network, "match", AGAIN).peers
    token = supervised.network.bus("track")
    token.declare_alive(alive_key("lab", "track"))
    token.close()
    supervised.dies("track")
    assert supervised.nodes["track"].state == "restarting"
    supervised.after(1.5)
    assert supervised.started == ["track"]
    assert (supervised.nodes["track"].state, supervised.nodes["track"].restarts) == ("starting", 1)
    assert peers.gone_for_s("track") == 0  # it comes back
    supervised.dies("track", EXIT_FAILED)
    supervised.after(2.5)
    assert supervised.started == ["track", "track"]
    supervised.dies("track")
    assert supervised.nodes["track"].state == "lost"
    assert not supervised.run.never_began
    supervised.after(10)
    assert len(supervised.started) == 2
    assert wait_until(lambda: peers.gone_for_s("track") > 0)  # told that it doesn't


def test_words_of_the_process_before_are_not_taken_for_the_new_ones(supervised: Run) -> None:
    supervised.dies("track")
    supervised.after(1.5)
    late = Health(header=Header(run_id="r", seq=99), node="track", state="running", pid=103)
    supervised.network.bus("x").publisher(health_key("lab", "track"), SIGNALS).send(late)
    supervised.run.watch(0)
    assert supervised.nodes["track"].state == "starting"


def test_a_reference_that_was_sent_whole_is_sent_again_to_who_needs_it(supervised: Run) -> None:
    supervised.word("grid", "done")
    supervised.dies("grid", 0)
    supervised.dies("track")
    supervised.after(1.5)
    assert supervised.started == ["track"]
    supervised.dies("match")
    supervised.after(1.5)
    assert supervised.started == ["track", "match", "grid"]


def test_each_start_of_a_sender_has_a_number_of_its_own(supervised: Run) -> None:
    supervised.word("grid", "done")
    supervised.dies("grid", 0)
    supervised.dies("match")
    supervised.after(1.5)
    grid = supervised.nodes["grid"]
    assert grid.restarts == 1
    supervised.run._revival.begin(grid)  # as a reload does
    supervised.after(1)
    assert grid.restarts == 2


def test_a_sender_that_a_reload_begins_is_not_started_twice(supervised: Run) -> None:
    supervised.word("grid", "done")
    supervised.dies("grid", 0)
    supervised.dies("match")
    supervised.now_s += 1.5
    supervised.run._revival.begin(supervised.nodes["grid"])  # as a reload does
    supervised.run.watch(0)
    assert sorted(supervised.started) == ["grid", "match"]


def test_only_the_first_that_falls_silent_is_killed(supervised: Run) -> None:
    for _ in range(4):
        for name in set(supervised.nodes) - {"record"}:
            supervised.word(name)
        supervised.after(1)
    supervised.after(1.5)  # the others wait for it, and have been silent for a while too
    signals = {n.name: n.process.signals for n in supervised.nodes.values()}  # type: ignore[union-attr]
    assert signals == {**{name: [] for name in supervised.nodes}, "record": [signal.SIGKILL]}
    supervised.after(3)
    assert signals["record"] == [signal.SIGKILL]


@pytest.fixture
def beating(supervised: Run) -> Run:
    """The same, with heartbeats."""
    for node in supervised.nodes.values():
        node.heartbeat = Heartbeat()
    return supervised


def test_who_lives_but_is_held_up_is_not_silent(beating: Run) -> None:
    """A recorder that catches up holds up everybody, and its own health as well."""
    roster = Roster(beating.network.bus("x"), "lab")
    for taken in range(2 * RULE["stalled_s"]):
        beating.beat(record=(taken, 0, 500))
        beating.after(1)
        while roster.listen(0):
            pass
    assert beating.killed == []
    assert GraphMetrics(beating.run).down == []
    states = {s.name: s.health.detail for s in roster.nodes() if s.health}
    assert set(states) == set(beating.nodes)
    assert all("its health is held up by record" in detail for detail in states.values())


def test_who_hangs_is_found_however_many_messages_come(beating: Run) -> None:
    for _ in range(2 * RULE["silent_s"]):
        for _ in range(10):  # one for each look at the processes
            beating.now_s += 0.1
            beating.beat(but="rows")
            beating.word("track")
    assert beating.killed == ["rows"]


def test_who_dies_is_started_again_on_a_bus_that_is_never_quiet(
    supervised: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(supervised.run, "_listen", lambda timeout_s: True)
    supervised.dies("track")
    assert supervised.nodes["track"].state == "restarting"


def test_two_recorders_that_hang_do_not_excuse_each_other(monkeypatch: pytest.MonkeyPatch) -> None:
    second = {"kind": "record", "out": "second.mcap"}
    run = Run(monkeypatch, {**AGAIN, "nodes": {**GRAPH["nodes"], "second": second}})  # type: ignore[dict-item]
    for node in run.nodes.values():
        run.word(node.name)
        node.heartbeat = Heartbeat()
    for _ in range(3 * RULE["stalled_s"]):
        run.beat(record=(7, 0, 500), second=(9, 0, 500))
        run.after(1)
    assert {"record", "second"} == set(run.killed)


def test_a_process_that_has_ended_has_no_heartbeat(beating: Run) -> None:
    beating.dies("track")
    assert beating.nodes["track"].heartbeat is None


def test_a_stopped_process_is_silent_whoever_is_behind(beating: Run) -> None:
    for taken in range(RULE["silent_s"] + 2):
        beating.beat(but="rows", record=(taken, 0, 500))
        beating.after(1)
    assert beating.killed == ["rows"]
    assert beating.nodes["rows"].state == "silent"


@pytest.mark.parametrize("has_beaten", [True, False])
def test_a_program_is_silent_while_readers_are_behind_only_if_it_has_sent_a_heartbeat(
    supervised: Run, has_beaten: bool
) -> None:
    for node in supervised.nodes.values():
        node.heartbeat = Heartbeat(is_sent=node.name != "rows")
    for taken in range(12 + RULE["silent_s"] + 2):
        lives = taken < 12  # meanwhile the recorder falls behind
        supervised.beat(but="" if lives and has_beaten else "rows", record=(taken, 0, 500))
        if lives:
            supervised.word("rows")
        supervised.after(1)
    assert supervised.killed == ["rows"] * has_beaten


def test_only_who_takes_none_is_killed_of_those_that_it_holds_up(beating: Run) -> None:
    for _ in range(RULE["stalled_s"] + 2):
        beating.beat(record=(7, 0, 500), rows=(8, 8, 1), decode=(0, 9, 1))
        beating.after(1)
    assert beating.killed == ["record"]


def test_whose_health_never_comes_though_no_reader_is_behind_is_stalled(beating: Run) -> None:
    for taken in range(RULE["stalled_s"] + 2):
        for name in set(beating.nodes) - {"match"}:
            beating.word(name)
        beating.beat(match=(taken, 0, 0))
        beating.after(1)
    assert beating.killed == ["match"]
    assert "no word of its health" in beating.nodes["match"].detail


def test_a_supervisor_that_was_held_up_kills_nobody(supervised: Run) -> None:
    supervised.now_s += 100
    supervised.run.watch(0)
    assert not any(n.process.signals for n in supervised.nodes.values())  # type: ignore[union-attr]


def test_a_lost_recorder_is_an_alarm_of_its_cameras(monkeypatch: pytest.MonkeyPatch) -> None:
    for rule in ("alarm", "stop"):
        run, heard = Run(monkeypatch, {**GRAPH, "on_record_loss": rule}), Inbox()
        run.network.bus("ear").subscribe(heard, camera_key("lab", "*", "alarm"), LOOKING)
        for name in run.nodes:
            run.word(name)
        run.dies("rows")
        assert heard.receive(0.1) is None
        run.dies("record")
        told = heard.receive(1)
        assert told is not None
        assert (told.message.kind, told.message.active) == ("unrecorded", True)
        assert told.message.text == "record: killed by signal 9"
        run.run.watch(0)
        assert [alarm.kind for alarm in run.run.alarms["lab/cam"]] == ["unrecorded"]
        assert heard.receive(0.1) is None  # of the grid's reference there is none
        assert "record: lost killed by signal 9" in GraphMetrics(run.run).down
        assert run.run.stops == (rule == "stop")


STUCK = {"messages_in": 40, "queue_depth": 3}


def test_a_node_that_takes_none_of_what_waits_is_stalled_and_started_again(
    supervised: Run,
) -> None:
    supervised.talk(RULE["stalled_s"], track=STUCK)
    assert (supervised.nodes["track"].state, supervised.killed) == ("running", [])
    supervised.talk(2, track=STUCK)
    assert supervised.killed == ["track"]
    assert supervised.nodes["track"].state == "stalled"
    supervised.dies("track")
    supervised.after(1.5)
    assert supervised.nodes["track"].state == "starting"


def test_its_senders_wait_for_it_and_are_not_to_blame(supervised: Run) -> None:
    """They come to a stop a moment later; with all of them seen at once, order tells nothing."""
    supervised.talk(RULE["stalled_s"] + 2, decode=STUCK, rows=STUCK, track=STUCK)
    assert supervised.killed == ["track"]
    assert [n.name for n in supervised.nodes.values() if n.state == "stalled"] == ["track"]


def test_a_source_whose_readers_take_none_is_stalled(supervised: Run) -> None:
    """Such as one that waits for planes of a reader that was started again, and never got them."""
    supervised.talk(RULE["stalled_s"] + 2, decode={**STUCK, "queue_depth": 1})
    assert supervised.killed == ["decode"]


@pytest.mark.parametrize(
    "fine",
    [
        {"messages_in": 40, "queue_depth": 0},  # a camera that pauses, a source that is finished
        {"state": "waiting", "queue_depth": 0},
    ],
)
def test_who_has_nothing_to_do_is_not_stalled(supervised: Run, fine: dict[str, Any]) -> None:
    supervised.talk(RULE["stalled_s"] + 30, decode=fine, track=fine)
    assert supervised.killed == []


def test_who_is_slow_is_not_stalled(supervised: Run) -> None:
    """A recorder on a slow disk takes a message now and then; rows that wait for it send some."""
    for taken in range(6):
        slow = {"messages_in": taken, "queue_depth": 500}
        waits = {"messages_in": 7, "messages_out": taken, "queue_depth": 1}
        supervised.talk(RULE["stalled_s"] - 2, record=slow, track=slow, rows=waits)
    assert supervised.killed == []


def test_without_a_rule_a_stalled_node_is_only_named(monkeypatch: pytest.MonkeyPatch) -> None:
    run = Run(monkeypatch, GRAPH)
    run.talk(Restart().stalled_s + 2, track=STUCK)
    assert run.killed == []
    assert GraphMetrics(run.run).down == [
        "track: stalled messages wait, none taken or sent for 120 s"
    ]
    run.talk(1, track={**STUCK, "messages_in": 41})
    assert GraphMetrics(run.run).down == []


def test_who_is_behind_a_camera_is_named_and_who_holds_it_up(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    camera = GRAPH["nodes"]["decode"] | {"input": "rtsp://127.0.0.1:9/1"}  # type: ignore[index]
    run = Run(monkeypatch, {**GRAPH, "nodes": {**GRAPH["nodes"], "decode": camera}})  # type: ignore[dict-item]
    told: list[tuple[str, str]] = []
    run.run.on_change = lambda node: told.append((node.name, node.behind))

    def goes_on(seconds: int, **late_s: float) -> list[tuple[str, str]]:
        told.clear()
        for _ in range(seconds):
            late = {
                name: {"queue_depth": 9, "latency_s": s, "last_input_ns": time.time_ns()}
                for name, s in late_s.items()
            }
            run.talk(1, **late)
        return [of for i, of in enumerate(told) if of[1] and of not in told[:i]]

    assert goes_on(4, track=7.2) == []  # it may be for a moment
    assert goes_on(4, track=7.2) == [("track", "behind by 6 s")]
    assert goes_on(3, track=14.0) == []
    # That was not yet twice as long. What it holds up isn't to blame.
    held_up = ("rows", "behind by 6 s, held up by track")
    assert goes_on(8, track=30.0, rows=6.0) == [("track", "behind by 12 s"), held_up]
    assert goes_on(2) == []
    assert set(told) == {("track", ""), ("rows", "")}
    assert GraphMetrics(run.run).behind == []
    run.word("rows", dropped=60)
    assert run.nodes["rows"].behind == "behind, 60 frames dropped"
    assert GraphMetrics(run.run).behind == ["rows: behind, 60 frames dropped"]
    # Times of arrival by another clock are none to go by.
    assert goes_on(2) == []
    (_, words), *_ = goes_on(8, track=3.6e7)
    assert re.fullmatch("behind by [56] s", words)
    # A file waits for its readers, which may take their time.
    run = Run(monkeypatch, GRAPH)
    goes_on(8, track=7.2)
    assert GraphMetrics(run.run).behind == []


def test_a_node_may_take_long_until_its_first_word(monkeypatch: pytest.MonkeyPatch) -> None:
    run = Run(monkeypatch)
    run.after(FIRST_WORD_S)
    assert not any(n.process.signals for n in run.nodes.values())  # type: ignore[union-attr]
    run.after(RULE["silent_s"] + 1)
    assert sum(len(n.process.signals) for n in run.nodes.values()) == 1  # type: ignore[union-attr]


def test_a_node_started_again_numbers_its_messages_as_another_run() -> None:
    network, inbox = Loopback(), Inbox()
    key = camera_key("lab", "cam", "rows")
    network.bus("listener").subscribe(inbox, key, SIGNALS)
    for restarts, first in ((0, 7), (2, 0)):
        node = node_on(network, "rows", restarts=restarts)
        publisher = node.publisher("cam", "rows")
        for seq in (first, first + 1):
            publisher.send(block(seq))
    runs = [
        (r.message.header.run_id, r.message.header.seq)
        for r in iter(lambda: inbox.receive(0.3), None)
    ]
    assert runs == [("r", 7), ("r", 8), ("r.rows2", 0), ("r.rows2", 1)]
    assert inbox.counters.duplicates == inbox.counters.missed == 0


def test_a_node_started_again_does_not_wait_for_those_that_have_ended(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("rsenf.run.node.PATIENCE_S", 0.05)
    node = node_on(Loopback(), "decode", AGAIN, restarts=1, gone=["grid"])
    node.wait_for_peers()
    assert node.peers.gone_for_s("grid") > 0
    assert node.peers.gone_for_s("track") == 0


def test_a_recorder_takes_the_health_of_a_node_that_was_started_again() -> None:
    """Under a name of its own: its numbers begin at 0 again."""
    network, heard = Loopback(), Inbox()
    network.bus("ear").subscribe(heard, health_key("lab", "rows"), LOOKING)
    for restarts in (0, 1):
        node_on(network, "rows", AGAIN, restarts=restarts).say("running")
    first, second = (heard.receive(1).message.header for _ in range(2))  # type: ignore[union-attr]
    assert (first.run_id, first.seq) == ("r", 0)
    assert (second.run_id, second.seq) == ("r.rows1", 0)


def test_planes_that_a_reader_took_along_are_taken_back_once() -> None:
    network = Loopback()
    departed = _Departed(node_on(network, "decode", AGAIN).peers, "rows")
    for again in (False, True):
        rows = network.bus("rows")
        rows.declare_alive(alive_key("lab", "rows"))
        assert [departed(), departed()] == [again, False]
        rows.close()
        # Asked while it is away; what is written until it is back isn't read by anybody either.
        assert wait_until(lambda: departed())
        assert departed()


def test_a_recorder_started_again_leaves_its_file_alone() -> None:
    config = RecordSettings(out="/data/site.mcap", overwrite=True)
    assert of_run(config, 0).out == "/data/site.mcap"
    assert of_run(config, 2).out == "/data/site.2.mcap"
    archive = RecordSettings(archive="/data")
    assert of_run(archive, 2) is archive


def test_it_leaves_those_of_an_earlier_run_alone_too(tmp_path: Path) -> None:
    (tmp_path / "site.1.mcap").touch()
    config = RecordSettings(out=str(tmp_path / "site.mcap"))
    assert of_run(config, 1).out == str(tmp_path / "site.2.mcap")


def test_it_records_nothing_again_that_is_in_the_file_it_left(tmp_path: Path) -> None:
    config, held = RecordSettings(out=str(tmp_path / "site.mcap")), list[list[int]]()
    for restarts, first in enumerate((0, 6, 12)):
        with open_sink(config, {}, str, restarts) as sink:
            for seq in range(first, first + 10):
                sink.write_encoded(
                    "rsenf/lab/cam/rows", RowBlock, encode(block(seq)), block(seq).header
                )
        found = open_recording(sink.path).messages()
        held.append([message.header.seq for _, message, _ in found])
    assert held == [list(range(10)), list(range(10, 16)), list(range(16, 22))]


@pytest.mark.processes
def test_one_that_hangs_at_the_end_of_a_film_misses_nothing(
    film: Film, graphs: Graphs, live_run: type[LiveRun]
) -> None:
    """What it had received is lost with it: those that have sent it stay and send it again."""
    path = graphs.write(film)
    rule = "restart: {backoff_s: 0.1, silent_s: 3}\nnodes:"
    path.write_text(path.read_text().replace("nodes:", rule, 1))
    run = live_run(path).until("running", "decode", "rows", "track")
    with open_bus(BusSettings(connect=(run.endpoint,))) as bus:
        heard = Inbox()
        bus.subscribe(heard, camera_key("lab", "cam", "rows"), LOOKING)
        last = 0
        while last < 75 * 24:  # late, so that what is left fits into the buffers on the way
            if received := heard.receive(1.0):
                last = received.message.header.frame_last
        os.kill(run.pids["track"], signal.SIGSTOP)
    assert run.wait() == EXIT_DONE, "\n".join(run.lines)
    assert run.states["track"].count("restarting") == 1
    assert {n for n in covered(graphs.out, "rows") if n < 75 * 29} <= covered(graphs.out, "track")


def covered(out: Path, topic: str) -> set[int]:
    """Frames that the recorded messages of a topic cover."""
    headers = [m.header for t, m, _ in open_recording(out).messages() if t.endswith(f"/{topic}")]
    assert headers[-1].is_end
    return {n for h in headers[:-1] for n in range(h.frame_first, h.frame_last + 1)}


@pytest.mark.processes
def test_killed_and_hung_nodes_come_back_and_the_stream_goes_on(
    film: Film, graphs: Graphs, live_run: type[LiveRun]
) -> None:
    path = graphs.write(film, pace=True)
    rule = "restart: {backoff_s: 0.1, silent_s: 3}\nnodes:"
    path.write_text(path.read_text().replace("nodes:", rule, 1))
    nodes = ("decode", "rows", "track", "idle", "match", "record")
    run = live_run(path).until("running", *nodes).until("done", "grid")
    first = dict(run.pids)
    os.kill(first["idle"], signal.SIGSTOP)
    for name in ("rows", "match", "record", "decode", "idle"):
        if name != "idle":
            os.kill(first[name], signal.SIGKILL)
        back = wait_until(lambda name=name: run.pids[name] != first[name], 60)
        assert back, "\n".join(run.lines)
    with open_bus(BusSettings(connect=(run.endpoint,))) as bus:
        heard, told = Inbox(), [""]
        bus.subscribe(heard, camera_key("lab", "cam", "track"), LOOKING)

        def goes_on() -> bool:
            told.extend(r.message.header.run_id for r in iter(lambda: heard.receive(0.1), None))
            return told[-1].endswith("decode1.rows1")

        assert wait_until(goes_on, 60), told[-1]
    run.interrupt()
    said = "\n".join(run.lines)
    assert run.process.returncode == 0, said
    assert "idle: restarting killed by signal 9; started again in 0.1 s, 1 of 5 within 300" in said
    # The recorder left its first file, whose last words are lost, and went on in another.
    assert not open_recording(graphs.out).complete
    after = open_recording(graphs.folder / "out.1.mcap")
    assert after.complete
    runs: dict[str, list[str]] = {}
    for topic, message, _ in after.messages():
        runs.setdefault(topic.split("/")[-1], []).append(message.header.run_id.partition(".")[2])
    assert runs["frames"][-1] == "decode1"
    assert runs["rows"][-1] == "decode1.rows1"
    assert runs["track"][-1] == "decode1.rows1"
    assert runs["match"][-1].endswith("match1")


STUCK_READER = """\
import sys

from rsenf.run.own_node import run_own_node


def body(node):
    node.subscribe(f"rsenf/lab/cam/{sys.argv[1]}")
    node.ready()
    while not node.restarts:  # takes one message, and no more
        if received := node.inbox.receive(0.1):
            node.note_input(received.message.header)
            node.stop.wait()


run_own_node(body)
"""


def stuck_node(graphs: Graphs, topic: str, stalled_s: int) -> str:
    """Return the line of a graph for a node that takes one message of the camera, and no more."""
    (graphs.folder / "stuck.py").write_text(STUCK_READER)
    command = f'["{sys.executable}", "{graphs.folder / "stuck.py"}", {topic}]'
    rule = f"restart: {{stalled_s: {stalled_s}}}"
    return f"  stuck: {{kind: external, command: {command}, reads: [cam/{topic}], {rule}}}\n"


@pytest.mark.processes
def test_a_reader_that_is_stuck_but_sends_health_is_started_again(
    film: Film, graphs: Graphs, live_run: type[LiveRun]
) -> None:
    path = graphs.write(film)
    path.write_text(f"{path.read_text()}{stuck_node(graphs, 'rows', 3)}")
    run = live_run(path).until("stalled", "stuck")
    assert run.wait() == 0, "\n".join(run.lines)
    said = "\n".join(run.lines)
    assert "stuck: stalled messages wait, none taken or sent for 3 s" in said
    assert "stuck: restarting killed by signal 9; started again in 0.5 s" in said
    assert not {name for name, states in run.states.items() if "stalled" in states} - {"stuck"}


@pytest.mark.processes
def test_those_that_a_stuck_reader_holds_up_for_longer_than_silent_s_live_on(
    tmp_path: Path, graphs: Graphs, live_run: type[LiveRun]
) -> None:
    """Nothing of `decode` gets through: the queues hold some 140 MB, the film has 276.

    It is played at its own pace: nobody waits until a program of others reads.
    """
    path = graphs.write(made_film(tmp_path, 30, "640x480"), "tcp", pace=True)
    rule = "restart: {silent_s: 3}\nnodes:"
    text = path.read_text().replace("nodes:", rule, 1)
    path.write_text(f"{text}{stuck_node(graphs, 'frames', 600)}")
    run = live_run(path).until("running", "decode", "stuck")
    with open_bus(BusSettings(connect=(run.endpoint,))) as bus:
        heard = Inbox()
        bus.subscribe(heard, health_key("lab", "decode"), LOOKING)

        def held_up() -> bool:
            told = (r.message.detail for r in iter(lambda: heard.receive(0.1), None))
            ages = (re.match(r"its health is held up.*\((\d+) s\)", detail) for detail in told)
            return any(age and int(age[1]) > 6 for age in ages)

        assert wait_until(held_up, LIMIT_S), "\n".join(run.lines)
    run.kill_node_and_wait("stuck", run.pids["stuck"])
    assert run.wait() == 0, "\n".join(run.lines)
    assert {n for n, s in run.states.items() if {"silent", "stalled", "restarting"} & {*s}} == {
        "stuck"
    }


def run_with_kills(path: Path, live_run: type[LiveRun], node: str, kills: int) -> tuple[int, str]:
    """Run a graph, killing a node each time it has begun to send; its exit code and its words."""
    path.write_text(path.read_text().replace("nodes:", "restart: {backoff_s: 0.1}\nnodes:", 1))
    run = live_run(path).until("running", node)
    with open_bus(BusSettings(connect=(run.endpoint,))) as bus:
        heard = Inbox()
        bus.subscribe(heard, camera_key("lab", "cam", node), LOOKING)
        for suffix in ("", f".{node}1", f".{node}2")[:kills]:

            def sends(told: str = run.run_id + suffix) -> bool:
                received = iter(lambda: heard.receive(0.1), None)
                return any(r.message.header.run_id == told for r in received)

            assert wait_until(sends, 60), "\n".join(run.lines)
            run.kill_node_and_wait(node, run.pids[node])
    return run.wait(), "\n".join(run.lines)


@pytest.mark.processes
@pytest.mark.parametrize(("frames", "kills"), [("ring", 3), ("tcp", 1)])
def test_what_a_killed_row_sampler_had_in_hand_is_counted(
    film: Film, graphs: Graphs, live_run: type[LiveRun], frames: str, kills: int
) -> None:
    path = graphs.write(film, frames)
    code, said = run_with_kills(path, live_run, "rows", kills)
    decoded = sampled = missed = 0
    for topic, message, _ in open_recording(graphs.out).messages():
        if topic.endswith("/frames"):
            decoded += not message.header.is_end
        elif topic.endswith("/rows"):
            sampled += message.frames
        elif topic.endswith("/track/health"):
            missed = message.missed
    lost = decoded - sampled
    print(f"{frames}: of {decoded} frames {sampled} have rows")
    assert 0 < lost < decoded / 2
    told = f"lab/cam: {lost} frames have no rows, as a node was restarted"
    assert any("track: " in line and told in line for line in said.splitlines()), said
    assert missed >= lost // 8 - 3  # blocks of eight frames, of which some came in part
    assert code == EXIT_LOSS, said


@pytest.mark.processes
@pytest.mark.parametrize("kills", [1, 3])
def test_what_a_killed_tracker_had_in_hand_is_estimated_again_or_counted(
    film: Film, graphs: Graphs, live_run: type[LiveRun], kills: int
) -> None:
    path = graphs.write(film)
    code, said = run_with_kills(path, live_run, "track", kills)
    estimated, last = set[int](), -1
    for topic, message, _ in open_recording(graphs.out).messages():
        if topic.endswith("/rows"):
            last = max(last, message.header.frame_last)
        elif topic.endswith("/track") and not message.header.is_end:
            estimated |= set(range(message.header.frame_first, message.header.frame_last + 1))
    lost = len(set(range(max(estimated) + 1)) - estimated)
    print(f"of {last + 1} frames {lost} have no estimate")
    assert max(estimated) > last - 60
    if lost:
        assert f"{lost} frames have no track, as a node was restarted" in said
    assert code == (EXIT_LOSS if lost else 0), said

"""The record node with an archive: on a bus within the process, alarms from a message or a call."""

from __future__ import annotations

import os
import signal
import threading
from pathlib import Path
from typing import Any

import pytest
from run_samples import GRAPH, block, end_after, node_on

from rsenf.bus.keys import SIGNALS, VIDEO_LIVE
from rsenf.config import Graph
from rsenf.config.load import problems
from rsenf.errors import RecordingError
from rsenf.messages import Alarm, Header, RowBlock
from rsenf.record import open_recording
from rsenf.record.archive.alarms import alarms_of
from rsenf.record.archive.layout import Camera
from rsenf.record.limits import Usage
from rsenf.run import recording
from rsenf.run.recording import AlarmWatch
from tests.loopback import Loopback

ROWS, ALARM = "rsenf/lab/cam/rows", "rsenf/lab/cam/alarm"


def graph_with(**record: Any) -> dict[str, Any]:
    """A graph that records only; the rows come from elsewhere."""
    nodes = {"rows": GRAPH["nodes"]["rows"], "record": {"kind": "record", **record}}  # type: ignore[index]
    return {**GRAPH, "nodes": nodes}


def recorded(tmp_path: Path, **record: Any) -> list[Path]:
    """Send ten row blocks, an alarm in their midst that ends again; return the files of cam."""
    network = Loopback()
    node = node_on(network, "record", graph_with(archive=str(tmp_path), topics=["cam/*"], **record))
    rows, alarm = (network.bus("rows").publisher(key, SIGNALS) for key in (ROWS, ALARM))
    for seq in range(10):
        rows.send(block(seq))
        if seq in (4, 6):
            header = Header(source="lab/cam", seq=seq // 2 - 2)
            alarm.send(Alarm(header=header, kind="test", active=seq == 4, text="look"))
    rows.send(end_after(block(9)))
    node.config.body(node)
    return sorted(tmp_path.glob("lab/cam/*/*.mcap"))


def test_it_records_to_an_archive(tmp_path: Path) -> None:
    (path,) = recorded(tmp_path, alarms={"before_s": 5})
    found = open_recording(path)
    assert found.complete
    assert found.topics[ROWS].messages == 11
    assert found.metadata["rsenf"]["site"] == "lab"
    (span,) = alarms_of(tmp_path, Camera("lab", "cam"))
    assert span.why == f"{ALARM} look"


def test_of_alarms_only(tmp_path: Path) -> None:
    (path,) = recorded(tmp_path, alarms={"only": True})
    assert path.name.endswith(".alarm.mcap")
    assert open_recording(path).topics[ROWS].messages == 11


def test_a_trigger_that_never_comes(tmp_path: Path) -> None:
    assert recorded(tmp_path, alarms={"only": True, "trigger": "*/discover"}) == []


def test_any_key_may_be_the_trigger(tmp_path: Path) -> None:
    (path,) = recorded(tmp_path, alarms={"only": True, "trigger": "cam/rows"})
    assert open_recording(path).topics[ROWS].messages == 11


def test_what_is_sent_while_it_opens_its_files_is_recorded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Video is sent once; a recorder started again reads first where its last file ended."""
    network, real = Loopback(), recording.open_sink
    node = node_on(network, "record", graph_with(archive=str(tmp_path), topics=["cam/rows"]))
    rows = network.bus("rows").publisher(ROWS, VIDEO_LIVE)

    def slow(*args: Any) -> Any:
        rows.send(block(0))
        rows.send(end_after(block(0)))
        node.stop.set()
        return real(*args)

    monkeypatch.setattr(recording, "open_sink", slow)
    node.config.body(node)
    (path,) = tmp_path.glob("lab/cam/*/*.mcap")
    assert open_recording(path).topics[ROWS].messages == 2


@pytest.mark.parametrize("settings", [{"archive": "."}, {"archive": ".", "alarms": {"only": True}}])
def test_what_waits_for_a_restarted_one_is_on_the_disk_before_it_says_that_it_is_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, settings: dict[str, Any]
) -> None:
    """Senders that have ended leave then, with what they have kept for it."""
    monkeypatch.chdir(tmp_path)
    network, held = Loopback(), list[int]()
    graph = graph_with(topics=["cam/rows", "cam/alarm"], **settings)
    node = node_on(network, "record", graph, restarts=1)
    alarm = network.bus("rows").publisher(ALARM, SIGNALS)
    alarm.send(Alarm(header=Header(source="lab/cam"), kind="test", active=True, text="look"))
    rows = network.bus("rows").publisher(ROWS, SIGNALS)
    for seq in range(10):
        rows.send(block(seq))

    def ready() -> None:
        (path,) = tmp_path.glob("lab/cam/*/*.mcap")
        held.append(open_recording(path).topics[ROWS].messages)
        node.stop.set()

    monkeypatch.setattr(node, "ready", ready)
    node.config.body(node)
    assert held == [10]


@pytest.mark.parametrize(
    ("settings", "missed"),
    [
        ({"archive": "."}, 10),
        ({"out": "r.mcap"}, 10),
        ({"archive": ".", "alarms": {"only": True}}, 0),
    ],
)
def test_what_is_no_longer_kept_for_a_restarted_one_is_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, settings: dict[str, Any], missed: int
) -> None:
    monkeypatch.chdir(tmp_path)
    for restarts, seqs in enumerate((range(10), range(20, 30))):
        network = Loopback()
        graph = graph_with(topics=["cam/rows"], **settings)
        node = node_on(network, "record", graph, restarts=restarts)
        rows = network.bus("rows").publisher(ROWS, SIGNALS)
        for seq in seqs:
            frames = {"frame_first": 8 * seq, "frame_last": 8 * seq + 7}
            rows.send(RowBlock(header=Header(run_id="r", source="lab/cam", seq=seq, **frames)))
        node.stop.set()
        node.config.body(node)
        assert node.inbox.counters.received >= 10
    assert node.inbox.counters.missed == missed
    assert node.inbox.counters.uncovered[ROWS] == 8 * missed


def test_a_disk_that_fills_ends_it_in_order(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = recording.DiskGuard
    monkeypatch.setattr(
        recording, "DiskGuard", lambda *given: real(*given, usage=lambda _: Usage(10**12, 10**6))
    )
    with pytest.raises(RecordingError, match="the disk is full but for"):
        recorded(tmp_path)
    (path,) = tmp_path.glob("lab/*/*/*.mcap")
    assert open_recording(path).complete


def test_what_a_graph_may_not_say() -> None:
    def said(**record: Any) -> list[str]:
        graph = Graph.model_validate(graph_with(**record))
        return [text for at, text in problems(graph) if at[:2] == ("nodes", "record")]

    assert said(archive="a", rotation={"every_s": 60}) == []
    assert said(out="a.mcap", archive="a") == said()
    assert said() == ["name a file with 'out', or a folder with 'archive': one of the two"]
    assert said(out="a.mcap", retention={"days": 3}) == [
        "retention is of an archive; name a folder with 'archive', not a file"
    ]
    assert "'a//b' is no key expression" in said(archive="a", alarms={"trigger": "a//b"})[0]


def test_a_signal_is_an_alarm_of_all_cameras() -> None:
    asked: list[tuple[Any, str]] = []

    class Archive(recording.ArchiveRecorder):
        def __init__(self) -> None:
            pass

        def alarm(self, topic: str | None, why: str) -> None:
            asked.append((topic, why))

    assert threading.current_thread() is threading.main_thread()
    watch = AlarmWatch(Archive(), ["rsenf/lab/*/alarm"])
    with watch.on_signal():
        watch.check()
        assert asked == []
        os.kill(os.getpid(), signal.SIGUSR1)
        watch.check()
        watch.check()
    assert asked == [(None, "SIGUSR1")]

"""Looking at a bus: who is there, what is sent, and how often."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from rsenf.bus.inbox import Received
from rsenf.bus.keys import HEALTH, SIGNALS, alive_key, health_key
from rsenf.bus.zenoh_bus import BusSettings, ZenohBus, free_endpoint, open_bus
from rsenf.cli import main
from rsenf.errors import EXIT_DONE, EXIT_FAILED, RsenfError
from rsenf.messages import EnfEstimate, Header, Health, RowBlock, VideoPacket
from rsenf.messages.codec import plain
from rsenf.run.health import LastMinute
from rsenf.run.roster import Rates, Roster
from tests.loopback import Loopback, LoopbackBus


def say(
    bus: LoopbackBus | ZenohBus, name: str, state: str, time_ns: int = 1, **more: float
) -> None:
    word = Health(
        header=Header(run_id="r", seq=time_ns), node=name, kind=name, state=state, time_ns=time_ns,
        **more,  # type: ignore[arg-type]
    )  # fmt: skip
    bus.publisher(health_key("lab", name), HEALTH).send(word)


def states(roster: Roster) -> dict[str, str]:
    while roster.listen(0):
        pass
    return {entry["node"]: entry["state"] for entry in roster.as_json()}


def test_who_is_there_who_hangs_and_who_is_gone() -> None:
    network, now_s = Loopback(), 0.0
    buses = {name: network.bus(name) for name in ("track", "rows", "grid", "mute")}
    for name, bus in buses.items():
        bus.declare_alive(alive_key("lab", name))
        if name != "mute":
            say(bus, name, "running", 5)
    roster = Roster(network.bus("looker"), "*", lambda: now_s)
    roster.expect("lab", ["match", "rows"])
    running = dict.fromkeys(("grid", "rows", "track"), "running")
    assert states(roster) == {**running, "match": "absent", "mute": "silent"}
    say(buses["grid"], "grid", "done", 6)
    say(network.bus("supervisor"), "track", "restarting", 3)  # kept since long ago
    buses["grid"].close()
    buses["rows"].close()
    now_s += 2
    assert states(roster) == {
        "grid": "done", "rows": "lost", "track": "running", "match": "absent", "mute": "silent"
    }  # fmt: skip
    now_s += 2
    assert states(roster)["track"] == "silent"
    say(network.bus("supervisor"), "track", "restarting", 7)
    assert states(roster)["track"] == "restarting"


def test_rates_and_the_longest_gap() -> None:
    rates = Rates(10.0)
    for now_s in (10.5, 11.0, 13.0):
        rates.note(
            Received("rsenf/lab/cam/track", EnfEstimate(header=Header()), b"12345678"), now_s
        )
    (rate,) = rates.found(14.0)
    assert (rate.rate_hz, rate.longest_gap_s) == (0.75, 2.0)
    assert rate.as_json()["bytes_per_s"] == 6.0


def test_a_message_as_plain_data() -> None:
    block = RowBlock(
        header=Header(arrival_time_ns=2**60 + 1), frames=1, rows=2, strips=1,
        frame_number=np.array([4], "<i8"), frame_pts_ns=np.array([7], "<i8"),
        level=np.array([[[1.5], [np.nan]]], np.float32), steady_ratio=float("inf"),
    )  # fmt: skip
    shown = plain(block)
    assert shown["header"]["arrival_time_ns"] == str(2**60 + 1)
    assert shown["level"] == [1.5, None]
    assert shown["frame_pts_ns"] == ["7"]
    assert shown["steady_ratio"] is None
    assert plain(block, longest=1)["level"] == "2 values"
    assert plain(VideoPacket(header=Header(), data=b"secret"))["data"] == 6
    json.dumps(shown, allow_nan=False)


def test_latency_is_of_the_last_minute() -> None:
    last = LastMinute()
    assert all(np.isnan(last.p50_p95_s(0.0)))
    last.note(0.0, 9.0)
    for k in range(100):
        last.note(30.0 + k / 10, k / 100)
    assert last.p50_p95_s(61.0) == (0.49, 0.94)
    assert all(np.isnan(last.p50_p95_s(200.0)))


@pytest.fixture(scope="module")
def router() -> Iterator[tuple[str, ZenohBus]]:
    """A bus of this process, with a node on it, and where it is."""
    endpoint = free_endpoint()
    with open_bus(BusSettings(mode="router", listen=(endpoint,))) as bus:
        bus.declare_alive(alive_key("lab", "track"))
        say(bus, "track", "running", latency_p50_s=0.25, latency_p95_s=1.5)
        estimates = bus.publisher("rsenf/lab/cam/track", SIGNALS)
        for seq in range(3):
            estimates.send(EnfEstimate(header=Header(run_id="r", seq=seq), enf_hz=50.0))
        yield endpoint, bus


def test_the_verb_nodes(
    router: tuple[str, ZenohBus],
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    waiting = ["--wait-s", "20", "--for-s", "0.5"]
    assert main(["nodes", "--connect", router[0], *waiting]) == 0
    head, line = capsys.readouterr().out.splitlines()
    assert line.split()[:3] == ["lab/track", "track", "running"]
    assert line[head.index("arrival s") :].startswith("0.25 / 1.50")
    monkeypatch.setenv("RSENF_CONNECT", router[0])
    assert main(["nodes", "--json", *waiting]) == 0
    (node,) = json.loads(capsys.readouterr().out)
    assert (node["node"], node["state"], node["exposure_p50_s"]) == ("track", "running", None)


def test_the_verb_nodes_waits_until_all_run(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Past a bus that isn't there yet, and a node that starts."""
    network = Loopback()
    bus, roster = network.bus("track"), Roster(network.bus("looker"), "*")
    told = iter(enumerate(["", "starting", "running"]))

    def look(_args: object) -> Roster:
        number, state = next(told)
        if not state:
            raise RsenfError("no bus")
        bus.declare_alive(alive_key("lab", "track"))
        say(bus, "track", state, number)
        assert roster.listen(0)
        return roster

    monkeypatch.setattr("rsenf.cli.nodes._look", look)
    assert main(["nodes", "--connect", "x", "--wait-s", "60"]) == EXIT_DONE
    assert capsys.readouterr().out.splitlines()[1].split()[2] == "running"
    assert next(told, None) is None


def test_the_verb_nodes_says_who_does_not_run(
    router: tuple[str, ZenohBus], capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    graph = tmp_path / "graph.yaml"
    graph.write_text(
        f"version: 1\nsite: lab\nbus: {{listen: ['{router[0]}']}}\nnodes:\n"
        "  track: {kind: track, cameras: [cam]}\n"
        "  decode: {kind: decode, camera: cam, input: a.mp4, frames: fused}\n"
    )
    assert main(["nodes", str(graph), "--wait-s", "1"]) == EXIT_FAILED
    assert capsys.readouterr().err == "rsenf: lab/decode is absent\n"


def test_the_verb_topic(router: tuple[str, ZenohBus], capsys: pytest.CaptureFixture[str]) -> None:
    where = ["--connect", router[0], "--for-s", "0.4"]
    assert main(["topic", "list", *where]) == 0
    assert "rsenf/lab/cam/track  EnfEstimate" in capsys.readouterr().out.splitlines()
    assert main(["topic", "echo", "cam/track", "--history", "--count", "2", *where]) == 0
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [line["header"]["seq"] for line in lines] == [0, 1]
    assert lines[0]["enf_hz"] == 50.0
    assert main(["topic", "hz", "cam/*", *where]) == 0
    assert "nothing was sent" in capsys.readouterr().err


def test_which_bus_is_a_question_of_usage(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("RSENF_CONNECT", raising=False)
    assert main(["nodes"]) == 2
    assert main(["topic", "list", "--graph", "configs/rtsp.yaml"]) == 2
    assert "--connect" in capsys.readouterr().err
    assert main(["nodes", "--connect", "here"]) == 2
    said = capsys.readouterr().err
    assert said.startswith("rsenf: bus setting connect/endpoints: no setting of Zenoh: Endpoints")

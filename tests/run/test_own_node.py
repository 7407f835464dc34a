"""A node of one's own: the contract, the one to begin with, and 'kind: external' in a graph."""

from __future__ import annotations

import json
import os
import runpy
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from live_run import LiveRun

from rsenf.bus.inbox import Inbox
from rsenf.bus.keys import SIGNALS, alive_key
from rsenf.bus.zenoh_bus import BusSettings, free_endpoint, open_bus
from rsenf.cli import main
from rsenf.config import Graph, load_graph
from rsenf.errors import EXIT_DONE, EXIT_FAILED, EXIT_USAGE, RsenfError
from rsenf.messages import EnfEstimate, Header, Mark
from rsenf.run import supervisor
from rsenf.run.heartbeat import Heartbeat, inherited_pipe, name_of_pipe
from rsenf.run.node import NodeProcess
from rsenf.run.process import wait_until
from rsenf.run.restart_policy import NodeState
from tests.loopback import Loopback

OWN = Path("rsenf/run/node_template.py")


def test_it_loads_nothing_of_what_runs_a_graph() -> None:
    loaded = "import sys, rsenf.run.own_node; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", loaded], capture_output=True, check=True)
    heavy = {f"rsenf.run.{name}" for name in ("supervisor", "graph_run", "access")}
    assert not heavy & {*done.stdout.decode().split()}


def test_its_stage_alone() -> None:
    stage = runpy.run_path(str(OWN))["Band"]()

    def update(enf_hz: float, *, usable: bool = True) -> list[float]:
        message = EnfEstimate(header=Header(), nominal_hz=50.0, enf_hz=enf_hz, usable=usable)
        return [alarm.value for alarm in stage.update(message)]

    assert update(50.1) == update(49.0, usable=False) == []
    assert update(49.5) == [0.5]


def test_its_alarms_are_numbered_anew_by_epoch_and_end_with_the_stream() -> None:
    own = {"kind": "external", "command": ["x"], "reads": ["cam/track"], "sends": ["cam/alarm"]}
    graph = Graph.model_validate({"version": 1, "site": "lab", "nodes": {"band": own}})
    network, inbox = Loopback(), Inbox()
    network.bus("ear").subscribe(inbox, "rsenf/lab/cam/alarm", SIGNALS)
    estimates = network.bus("track").publisher("rsenf/lab/cam/track", SIGNALS)
    for epoch, seq, mark in ((0, 0, 0), (0, 1, 0), (1, 0, 0), (1, 1, Mark.END)):
        header = Header(run_id="r", epoch=epoch, seq=seq, mark=mark)
        estimates.send(EnfEstimate(header=header, nominal_hz=50.0, enf_hz=49.5, usable=True))
    node = NodeProcess(graph, "band", "r", network.bus("band"))
    body = threading.Thread(target=runpy.run_path(str(OWN))["body"], args=(node,), daemon=True)
    body.start()
    body.join(5)
    assert not body.is_alive()
    heard = [received.message.header for _ in range(4) if (received := inbox.receive(1))]
    told = [(header.epoch, header.seq, header.mark) for header in heard]
    assert told == [(0, 0, 0), (0, 1, 0), (1, 0, 0), (1, 1, Mark.END)]


@pytest.mark.processes
def test_it_ends_with_what_started_it() -> None:
    with open_bus(BusSettings(mode="router", listen=(endpoint := free_endpoint(),))) as bus:
        alive: list[bool] = []
        bus.watch_alive(alive_key("lab", "band"), lambda _, is_there: alive.append(is_there))
        told = {"RSENF_CONNECT": endpoint, "RSENF_SITE": "lab", "RSENF_NODE": "band"}
        with subprocess.Popen(
            ["sh", "-c", f"{sys.executable} {OWN} & wait"], env={**os.environ, **told}
        ) as shell:
            assert wait_until(lambda: alive == [True])
            shell.kill()
        assert wait_until(lambda: alive == [True, False])


@pytest.mark.processes
def test_it_sends_a_heartbeat_through_the_pipe_that_it_inherits() -> None:
    with open_bus(BusSettings(mode="router", listen=(endpoint := free_endpoint(),))):
        told = {"RSENF_CONNECT": endpoint, "RSENF_SITE": "lab", "RSENF_NODE": "band"}
        told |= {"RSENF_READS": "cam/track", "RSENF_SENDS": "cam/alarm"}  # else it ends at once
        node = NodeState("band", "external")
        process = supervisor._start(node, [sys.executable, str(OWN)], told)
        assert node.heartbeat is not None
        try:
            assert not node.beats
            assert wait_until(lambda: node.heartbeat.newest() is not None)
            assert node.beats
        finally:
            process.kill()
            process.wait()


def test_a_pipe_that_was_not_inherited_is_not_written_to() -> None:
    heartbeat = Heartbeat(is_sent=False)
    with heartbeat.inherited() as writer:
        name = name_of_pipe(writer)
        assert inherited_pipe(name) == writer
    other = os.open(os.devnull, os.O_WRONLY)
    os.dup2(other, writer)
    assert inherited_pipe(name) is inherited_pipe("") is None
    for descriptor in {other, writer}:
        os.close(descriptor)


def test_what_it_prints_is_shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with (tmp_path / "shown").open("w", encoding="utf-8") as shown:
        monkeypatch.setattr(sys, "stdout", shown)  # led elsewhere, as while refusals are told
        assert supervisor._start(NodeState("own", "external"), ["echo", "hello"], {}).wait(10) == 0
    assert (tmp_path / "shown").read_text(encoding="utf-8") == "hello\n"


def test_a_run_that_breaks_stops_its_nodes_in_order(tmp_path: Path) -> None:
    begun, closed, path = (tmp_path / name for name in ("begun", "closed", "graph.yaml"))
    program = f"trap 'touch {closed}; exit 0' TERM; touch {begun}; while :; do sleep 0.05; done"
    own = {"kind": "external", "command": ["sh", "-c", program]}
    path.write_text(json.dumps({"version": 1, "site": "lab", "nodes": {"own": own}}))

    def broken() -> None:
        with supervisor.start_graph(load_graph(path), path):
            assert wait_until(begun.exists)
            raise RsenfError("no port")

    with pytest.raises(RsenfError, match="no port"):
        broken()
    assert closed.exists()


def test_the_contract_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["explain", "contract"]) == 0
    said = capsys.readouterr().out
    assert all(word in said for word in ("RSENF_CONNECT", "seq", "epoch", "health", "SIGTERM"))


def test_one_is_written_and_never_over_another(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["new-node", "my_band", "--dir", str(tmp_path)]) == EXIT_DONE
    path = tmp_path / "my_band.py"
    assert f"python {path}" in capsys.readouterr().out
    text = path.read_text(encoding="utf-8")
    assert "python my_band.py" in text
    assert "own_node.py" not in text
    path.write_text("mine")
    assert main(["new-node", "my_band", "--dir", str(tmp_path)]) == EXIT_USAGE
    assert path.read_text() == "mine"
    for name in ("../elsewhere", "my-band", "class", "rsenf"):
        assert main(["new-node", name, "--dir", str(tmp_path)]) == EXIT_USAGE
    assert main(["new-node", "band", "--dir", str(tmp_path / "nowhere")]) == EXIT_USAGE
    assert "my_band.py exists already" in capsys.readouterr().err
    assert [p.name for p in tmp_path.iterdir()] == ["my_band.py"]


@pytest.mark.processes
def test_what_is_written_keeps_the_contract(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["new-node", "band", "--dir", str(tmp_path)]) == EXIT_DONE
    node = [sys.executable, str(tmp_path / "band.py")]
    words = ["--reads", "cam/track", "--sends", "cam/alarm", "--", *node]
    assert main(["contract", *words]) == EXIT_DONE
    assert "BROKEN" not in capsys.readouterr().out


@pytest.mark.processes
def test_one_that_does_not_is_told_so(capsys: pytest.CaptureFixture[str]) -> None:
    deaf = [sys.executable, "-c", "import sys; sys.exit(3)"]
    assert main(["contract", "--", *deaf]) == EXIT_FAILED
    assert "BROKEN  shows its liveliness token" in capsys.readouterr().out
    assert main(["contract", "--", "/nowhere/node"]) == EXIT_USAGE


@pytest.mark.processes
def test_a_graph_starts_it_again_and_stops_it(tmp_path: Path, live_run: type[LiveRun]) -> None:
    path = tmp_path / "graph.yaml"
    path.write_text(
        "version: 1\nsite: lab\nrestart: {backoff_s: 0.1}\nnodes:\n"
        "  track: {kind: track, cameras: [cam]}\n"
        "  decode: {kind: decode, camera: cam, frames: fused, pace: true,\n"
        "    input: {model: configs/model/demo_480p.yaml, duration_s: 60}}\n"
        f"  band: {{kind: external, command: ['{sys.executable}', {OWN}],\n"
        "    reads: [cam/track], sends: [cam/alarm]}\n"
    )
    assert load_graph(path).nodes["band"].outputs() == [("alarm", "cam")]
    run = live_run(path).until("running", "decode", "track", "band")
    first = run.pids["band"]
    run.kill_node_and_wait("band", first)
    run.interrupt()
    assert run.process.returncode == EXIT_DONE, "\n".join(run.lines)
    assert run.states["band"][-1] == "done"


def test_who_follows_with_the_schema_alone_counts_what_is_missing() -> None:
    streams = runpy.run_path("configs/follow_enf.py")["Streams"]()

    def take(seq: int, run_id: str = "r", mark: int = 0) -> bool:
        header = Header(run_id=run_id, seq=seq, mark=mark)
        return bool(streams.is_new("rsenf/lab/cam/track", "a", header))

    assert [take(seq) for seq in (0, 1, 1, 0, 4)] == [True, True, False, False, True]
    assert streams.missed == 2
    assert take(0, "r.track1")  # started again
    assert not streams.all_ended
    assert take(1, "r.track1", mark=2)
    assert (streams.missed, streams.all_ended) == (2, True)

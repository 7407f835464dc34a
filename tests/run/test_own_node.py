"""A node of one's own: the contract, the one to begin with, and 'kind: external' in a graph."""

from __future__ import annotations

import runpy
import sys
from pathlib import Path

import pytest
from live_run import LiveRun

from rsenf.cli import main
from rsenf.config import load_graph
from rsenf.config.graph import outputs
from rsenf.errors import EXIT_DONE, EXIT_FAILED, EXIT_USAGE
from rsenf.messages import EnfEstimate, Header

OWN = Path("configs/own_node.py")


def test_its_stage_alone() -> None:
    stage = runpy.run_path(str(OWN))["Band"]()

    def update(enf_hz: float, *, usable: bool = True) -> list[float]:
        message = EnfEstimate(header=Header(), nominal_hz=50.0, enf_hz=enf_hz, usable=usable)
        return [alarm.value for alarm in stage.update(message)]

    assert update(50.1) == update(49.0, usable=False) == []
    assert update(49.5) == [0.5]


def test_the_contract_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["explain", "contract"]) == 0
    said = capsys.readouterr().out
    assert all(word in said for word in ("RSENF_CONNECT", "seq", "epoch", "health", "SIGTERM"))


@pytest.mark.processes
def test_the_one_to_begin_with_keeps_the_contract(capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--reads", "cam/track", "--sends", "cam/alarm", "--", sys.executable, str(OWN)]
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
    assert outputs(load_graph(path).nodes["band"]) == [("alarm", "cam")]
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

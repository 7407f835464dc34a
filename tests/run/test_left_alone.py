"""A node whose supervisor is gone ends, even where it waits for a bus that is gone too."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import yaml
from run_samples import GRAPH, node_on

from rsenf.bus.inbox import CallbackInbox
from rsenf.bus.keys import HEALTH, health_key
from rsenf.bus.zenoh_bus import BusSettings
from rsenf.errors import EXIT_DONE, EXIT_FAILED
from rsenf.run.heartbeat import Heartbeat
from rsenf.run.node import _arguments, _run
from rsenf.run.process import wait_until
from tests.loopback import Loopback, LoopbackBus


@pytest.mark.parametrize("held_up", [False, True])
def test_it_ends_by_itself(monkeypatch: pytest.MonkeyPatch, *, held_up: bool) -> None:
    ended, codes, network = threading.Event(), [], Loopback()
    if held_up:  # its health doesn't get through either
        reader = CallbackInbox(lambda _: ended.wait(20) and None)
        network.bus("x").subscribe(reader, health_key("lab", "track"), HEALTH)
        monkeypatch.setattr("rsenf.run.health.EVERY_S", 0.0)

    def end(code: int) -> None:
        codes.append(code)
        ended.set()

    monkeypatch.setattr("rsenf.run.heartbeat.end_process", end)
    monkeypatch.setattr("rsenf.run.heartbeat.ALONE_S", 0.2)
    node = node_on(network, "track")
    with node.beating(supervisor=1 << 30), node.reporting():
        assert node.stop.wait(20)
        assert ended.wait(20)  # the body never comes to see that it should stop
    assert set(codes) == {EXIT_FAILED}


def test_its_heart_beats_until_the_bus_is_closed(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """What it has sent last may be held up longer than its supervisor lets it be silent."""
    heartbeat, beats = Heartbeat(), []

    @contextmanager
    def slow_to_close(_settings: BusSettings) -> Iterator[LoopbackBus]:
        yield Loopback().bus("track")
        heartbeat.newest()
        beats.append(wait_until(lambda: heartbeat.newest() is not None))

    monkeypatch.setattr("rsenf.run.node.open_bus", slow_to_close)
    monkeypatch.setattr("rsenf.run.node.install_signals", lambda node: node.stop.set())
    monkeypatch.setattr("sys.argv", ["", "--graph", str(tmp_path / "graph.yaml"), "--node", "track",
                                     "--heartbeat", str(heartbeat.writer)])  # fmt: skip
    (tmp_path / "graph.yaml").write_text(yaml.safe_dump(GRAPH), encoding="utf-8")
    (tmp_path / "none.mp4").touch()
    (tmp_path / "none.csv").touch()
    assert _run(_arguments()) == EXIT_DONE
    assert beats == [True]

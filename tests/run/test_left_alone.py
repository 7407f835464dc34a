"""A node whose supervisor is gone ends, even where it waits for a bus that is gone too."""

from __future__ import annotations

import threading

import pytest
from run_samples import node_on

from rsenf.bus.inbox import CallbackInbox
from rsenf.bus.keys import HEALTH, health_key
from rsenf.bus.loopback import Loopback
from rsenf.errors import EXIT_FAILED


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
    with node.beating(supervisor=1 << 30):
        assert node.stop.wait(20)
        assert ended.wait(20)  # the body never comes to see that it should stop
    assert set(codes) == {EXIT_FAILED}

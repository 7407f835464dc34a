"""A node whose supervisor is gone ends, even where it waits for a bus that is gone too."""

from __future__ import annotations

import threading

import pytest
from run_samples import node_on

from rsenf.bus.loopback import Loopback
from rsenf.errors import EXIT_FAILED


def test_it_ends_by_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    ended, codes = threading.Event(), []

    def end(code: int) -> None:
        codes.append(code)
        ended.set()

    monkeypatch.setattr("rsenf.run.node.end_process", end)
    monkeypatch.setattr("rsenf.run.node.ALONE_S", 0.2)
    node = node_on(Loopback(), "track")
    with node.beating(supervisor=1 << 30):
        assert node.stop.wait(5)
        assert ended.wait(5)  # the body never comes to see that it should stop
    assert set(codes) == {EXIT_FAILED}

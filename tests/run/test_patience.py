"""Time limits that scale with how slow the machine is, and only for who runs into them."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from rsenf.run import own_node, process
from rsenf.run.own_node import check_contract
from rsenf.run.process import Patience, slowness, wait_until

TEMPLATE = Path("rsenf/run/node_template.py")


class Machine:
    """A clock that moves by what is waited, and how slow the machine is: asking takes a second."""

    def __init__(self, slowness: float) -> None:
        self.now_s, self.slowness, self.asked = 1000.0, slowness, 0

    def monotonic(self) -> float:
        return self.now_s

    def sleep(self, duration_s: float) -> None:
        self.now_s += duration_s

    def measured(self) -> float:
        self.asked += 1
        self.now_s += 1.0
        return self.slowness


@pytest.fixture
def machine(monkeypatch: pytest.MonkeyPatch) -> Machine:
    made = Machine(1.0)
    monkeypatch.setattr(process, "time", made)
    monkeypatch.setattr(process, "slowness", made.measured)
    return made


def test_an_idle_machine_has_what_was_said(machine: Machine) -> None:
    assert not wait_until(lambda: False, 10.0)
    assert machine.now_s == pytest.approx(1011.0, abs=0.1)


def test_a_slow_one_has_longer(machine: Machine) -> None:
    machine.slowness = 6.0
    assert wait_until(lambda: machine.now_s > 1059.0, 10.0)
    assert not wait_until(lambda: False, 10.0)


def test_one_that_becomes_slower_is_asked_again(machine: Machine) -> None:
    limit = Patience(10.0)
    machine.now_s += 11.0
    machine.slowness = 2.0
    assert not limit.over
    machine.now_s += 11.0
    machine.slowness = 4.0
    assert not limit.over
    machine.now_s += 20.0
    assert limit.over


def test_who_is_in_time_pays_nothing(machine: Machine) -> None:
    machine.slowness = 9.0
    assert wait_until(lambda: machine.now_s > 1009.0, 10.0)
    assert machine.asked == 0


@pytest.mark.processes
@pytest.mark.parametrize("kept", [True, False])
def test_a_node_that_starts_slowly_keeps_the_contract_on_a_slow_machine(
    monkeypatch: pytest.MonkeyPatch, kept: bool
) -> None:
    """It needs longer than it has on an idle machine; a process starts as slowly here, or not."""
    for limit in ("READY_S", "TWO_WORDS_S", "STOP_S"):
        monkeypatch.setattr(own_node, limit, 0.1)
    if kept:
        monkeypatch.setattr(process, "START_S", 0.001)
        assert slowness() > 50
    else:
        monkeypatch.setattr(process, "slowness", lambda: 1.0)
    checks = check_contract([sys.executable, str(TEMPLATE)], ["cam/track"], ["cam/alarm"])
    assert all(check.passed for check in checks) == kept
    assert checks[0].passed == kept

"""A test's own time limit: once it is over, the machine is asked whether it is a slow one."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from types import SimpleNamespace

import pytest

from rsenf.run.process import wait_until
from tests import conftest


@pytest.fixture
def rings() -> Iterator[list[int]]:
    """What the limit does to a test, noted instead; this test's own is laid aside meanwhile."""
    rung: list[int] = []
    left = signal.setitimer(signal.ITIMER_REAL, 0)
    before = signal.signal(signal.SIGALRM, lambda number, _frame: rung.append(number))
    yield rung
    signal.signal(signal.SIGALRM, before)
    signal.setitimer(signal.ITIMER_REAL, *left)


@pytest.mark.parametrize("times_slow", [0, 2])
def test_it_is_longer_on_a_slow_machine(
    rings: list[int], monkeypatch: pytest.MonkeyPatch, times_slow: int
) -> None:
    answers = iter([False] * times_slow + [True])
    asked: list[bool] = []

    class Slow:
        left_s = 0.01

        @property
        def over(self) -> bool:
            asked.append(next(answers))
            return asked[-1]

    monkeypatch.setattr(conftest, "Patience", lambda _limit_s: Slow())
    hook = conftest.pytest_timeout_set_timer(SimpleNamespace(timeout=0.01))
    next(hook)
    with pytest.raises(StopIteration):
        hook.send(True)
    signal.setitimer(signal.ITIMER_REAL, 0.01)  # as pytest-timeout does
    assert wait_until(lambda: bool(rings))
    assert asked == [False] * times_slow + [True]
    assert len(rings) == 1

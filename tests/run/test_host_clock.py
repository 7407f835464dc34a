"""A clock that is set is noticed once, and told from one that only goes."""

from __future__ import annotations

from rsenf.run.process import HostClock
from rsenf.timebase import NS_PER_S


def test_setting_is_told_once_and_going_is_not() -> None:
    said: list[str] = []
    now = {"wall": 10**18, "steady": 5}
    clock = HostClock(said.append, lambda: now["wall"], lambda: now["steady"])

    def go(wall_s: float, steady_s: float) -> int:
        now["wall"] += round(wall_s * NS_PER_S)
        now["steady"] += round(steady_s * NS_PER_S)
        return clock()

    assert go(100.0, 100.0) == 10**18 + 100 * NS_PER_S
    go(3600.2, 3600.0)  # slewed
    assert said == []
    go(-3599.0, 1.0)
    go(1.0, 1.0)
    go(8.5, 1.0)
    assert said == [
        "this host's clock was set by -3600.0 s",
        "this host's clock was set by +7.5 s",
    ]

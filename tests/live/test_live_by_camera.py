"""Another camera as the reference: it bears witness for a feed, and against one."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from live_feeds import AHEAD_S, NS, Camera, looped, said

from rsenf.reference.live import CameraReference


def together(witness: Camera, judged: Camera, seconds: int) -> Iterator[Any]:
    """What the judge of one camera is told, and the reference that the other makes."""
    stage = CameraReference("ce")

    def witnessed() -> Iterator[tuple[int, int, Any]]:
        for message in witness.messages(seconds):
            for block in stage.update(message):
                yield message.header.arrival_time_ns, 0, block

    def own() -> Iterator[tuple[int, int, Any]]:
        for message in judged.messages(seconds):
            yield message.header.arrival_time_ns, 1, message

    for _, _, message in heapq.merge(witnessed(), own(), key=lambda told: told[:2]):
        yield message


@pytest.mark.parametrize("apart_s", [0.0, 0.4])
def test_a_feed_of_the_same_grid_is_live(apart_s: float) -> None:
    witness = Camera(seed=7, clock_ppm=-40.0)
    judged = Camera(start_s=Camera.start_s + apart_s, late_s=0.5)
    told = said(together(witness, judged, 240))
    assert told.story == ["undecided", "live"]
    assert told.alarms == []
    end = told.verdicts[-1]
    # When a picture was taken is known but for what its way takes at least: 0.3 and 0.5 s here.
    assert abs(end.lag_s - 0.2) < 4 * end.lag_std_s + 0.1
    assert abs(end.clock_ppm - 60.0) < 4 * end.clock_std_ppm + 2.0  # of one against the other


@pytest.mark.parametrize("filmed", [looped(160, 100), lambda t: t - (300.0 if t > 160 else 0.0)])
def test_a_feed_of_another_time_is_stale(filmed: Callable[[float], float]) -> None:
    told = said(together(Camera(seed=7), Camera(filmed=filmed), 300))
    assert told.story == ["undecided", "live", "stale"]
    assert told.first("stale").header.pts_ns < (160 + AHEAD_S + 90) * NS


def test_a_witness_that_is_away_decides_nothing() -> None:
    witness = Camera(seed=7, usable=lambda t: t < 120)
    told = said(together(witness, Camera(filmed=looped(160, 100)), 260))
    assert told.story == ["undecided", "live", "undecided"]
    assert [a.kind for a in told.alarms if a.kind == "stale"] == []

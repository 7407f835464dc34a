"""Feeds of the live study: what they show when, and that a monitor gets it in the right order."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from rsenf.bench.live import ATTACKS, FROZEN, HONEST, KINDS, LOOP, ROUND, DrawnFeed, LivePlan
from rsenf.bench.live.watched import LATE_S, T0_NS, Shown, _show, watch
from rsenf.errors import UsageError
from rsenf.messages import EnfEstimate, IdleEstimate, ReferenceBlock, RowBlock
from rsenf.timebase import nanoseconds


def shown(kind: str, seed: int = 7) -> Shown:
    return _show(DrawnFeed(kind, "test", seed, 60.0), None)


def levels(of: Shown) -> np.ndarray:
    return np.concatenate([block.level for block in of.blocks])[:, :, 0]


def first_false(of: Shown, kind: str) -> int:
    rate_hz = 1e9 / np.diff(of.blocks[0].frame_pts_ns).mean()
    attack_s = DrawnFeed(kind, "test", 7, 60.0).attack_s
    assert attack_s is not None
    return round(attack_s * rate_hz)


def test_kinds_take_turns_and_every_feed_has_its_seed() -> None:
    feeds = LivePlan(first_seed=100, clips=2 * ROUND).feeds()
    assert [f.seed for f in feeds] == list(range(100, 100 + 2 * ROUND))
    counts = Counter(f.kind for f in feeds)
    assert counts[HONEST] == 8
    assert all(counts[kind] == 2 for kind in ATTACKS)
    assert len({f.key for f in feeds}) == len(feeds)


def test_feeds_too_short_to_judge_are_refused() -> None:
    with pytest.raises(UsageError):
        LivePlan(duration_s=20.0)


def test_attacks_leave_what_was_before_them_alone() -> None:
    first, *others = (levels(shown(kind)) for kind in ATTACKS)
    begin = first_false(shown(FROZEN), FROZEN)
    for other in others:
        np.testing.assert_array_equal(first[:begin], other[:begin])
        assert (first[begin:] != other[begin:]).any()


def test_a_frozen_feed_repeats_its_last_picture() -> None:
    of = shown(FROZEN)
    level, first = levels(of), first_false(of, FROZEN)
    assert (level[first:] == level[first - 1]).all()
    assert not (level[first - 1] == level[first - 2]).all()


def test_a_loop_comes_round() -> None:
    of = shown(LOOP, seed=7)
    level, first = levels(of), first_false(of, LOOP)
    away = float(of.truth["away_s"])
    period = round(away * 1e9 / np.diff(of.blocks[0].frame_pts_ns).mean())
    noise = 0.5 if of.truth["recoded"] else 0.0
    np.testing.assert_allclose(level[first], level[first - period], atol=noise)
    np.testing.assert_allclose(level[first + period], level[first], atol=2 * noise)


@pytest.mark.parametrize("kind", KINDS)
def test_frames_are_numbered_and_stamped_as_if_nothing_had_happened(kind: str) -> None:
    of = shown(kind)
    number = np.concatenate([block.frame_number for block in of.blocks])
    pts_ns = np.concatenate([block.frame_pts_ns for block in of.blocks])
    np.testing.assert_array_equal(number, np.arange(number.size))
    assert np.ptp(np.diff(pts_ns)) <= 2
    arrival_ns = [block.header.arrival_time_ns for block in of.blocks]
    assert arrival_ns == sorted(arrival_ns)


def test_a_monitor_gets_all_in_the_order_of_arrival() -> None:
    feed = DrawnFeed(HONEST, "test", 7, 60.0)
    of, messages = watch(feed, None)
    arrival_ns = [m.header.arrival_time_ns for m in messages]
    assert arrival_ns == sorted(arrival_ns)
    kinds = Counter(type(m) for m in messages)
    assert kinds[RowBlock] == len(of.blocks)
    assert kinds[EnfEstimate] > 20
    assert kinds[IdleEstimate] >= 1
    for block in (m for m in messages if isinstance(m, ReferenceBlock)):
        end_ns = block.t0_ns + (block.first + block.samples) * block.step_ns
        assert block.header.arrival_time_ns == end_ns + nanoseconds(LATE_S)
        assert block.t0_ns > T0_NS

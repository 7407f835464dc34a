"""A follower that two stages share: both are told what each would have found alone."""

from __future__ import annotations

import dataclasses
import weakref
from typing import Any

import numpy as np
import pytest

from rsenf.flicker.follower import FlickerFollower, shared
from rsenf.idle import IdleSettings
from rsenf.messages import Header, Mark, RowBlock, encode
from rsenf.messages.plausible import implausible
from rsenf.model import CaptureModel, Shutter, simulate_rows, synthetic_grid
from rsenf.rows.stage import blocks_from_luminance
from rsenf.run.runner import Branches, Runner
from rsenf.run.stages import flicker_stages
from rsenf.stage import StageContext
from rsenf.track import TrackSettings


def blocks(seconds: float) -> list[RowBlock]:
    shutter = Shutter(rows=60, columns=80)
    clip = simulate_rows(CaptureModel(shutter=shutter), synthetic_grid(7, 60.0), seconds, 7)
    return list(blocks_from_luminance(clip.level, clip.frame_time_s, Header(source="t/c")))


def test_both_are_told_what_one_alone_finds() -> None:
    """Whoever comes first, and however far ahead."""
    given = blocks(36.0)
    alone = FlickerFollower()
    expected = [alone.update(block) for block in given] + [alone.flush()]
    one, other = shared(FlickerFollower())
    found_by_one = [one.update(block) for block in given[:60]]
    found_by_other = [other.update(block) for block in given] + [other.flush()]
    found_by_one += [one.update(block) for block in given[60:]] + [one.flush()]
    assert one.origin_ns == other.origin_ns == alone.origin_ns
    assert sum(map(len, expected)) == 36
    for a, b, c in zip(expected, found_by_one, found_by_other, strict=True):
        assert [s.index for s in a] == [s.index for s in b]
        assert all(x is y for x, y in zip(b, c, strict=True))
        assert all(
            np.array_equal(x.phase_rad, y.phase_rad) and x.f0_var_hz2 == y.f0_var_hz2
            for x, y in zip(a, b, strict=True)
        )


def test_levels_are_not_kept() -> None:
    """While the flicker is looked for, and after: a camera's are 1 MB a second."""
    specs = flicker_stages(TrackSettings(), IdleSettings(), StageContext())
    stages, levels = [spec.make() for spec in specs], []
    for block in blocks(36.0):
        copy = dataclasses.replace(block, level=block.level.copy())
        levels.append(weakref.ref(copy.level))
        for stage in stages:
            stage.update(copy)
        assert sum(level() is not None for level in levels) <= 4


def test_other_blocks_are_no_company() -> None:
    one, other = shared(FlickerFollower())
    first, second = blocks(1.0)[:2]
    one.update(first)
    with pytest.raises(RuntimeError, match="fed differently"):
        other.update(second)


def without_frames(block: RowBlock) -> RowBlock:
    return dataclasses.replace(
        block, frames=0, frame_number=block.frame_number[:0], frame_pts_ns=block.frame_pts_ns[:0],
        level=block.level[:0],
    )  # fmt: skip


def of_other_rows(block: RowBlock) -> RowBlock:
    return dataclasses.replace(
        block, rows=block.rows // 2, level=block.level[:, ::2], kept_px=block.kept_px[::2]
    )


@pytest.mark.parametrize("odd", [without_frames, of_other_rows])
def test_a_block_of_no_use_parts_no_tracker_from_its_idle_estimator(odd: Any) -> None:
    given = blocks(30.0)
    given[40] = odd(given[40])
    assert not implausible(given[40])

    def told(context: StageContext) -> list[bytes]:
        stages = flicker_stages(TrackSettings(), IdleSettings(), context)
        both = Branches(*((stage.reads, Runner.of(stage, 1)) for stage in stages))
        sent = [message for block in given for message in both.feed(block)]
        end = RowBlock(header=Header(mark=Mark.END))
        return [encode(message) for message in (*sent, *both.feed(end))]

    apart = StageContext()
    apart.is_shared = False
    assert told(StageContext()) == told(apart)

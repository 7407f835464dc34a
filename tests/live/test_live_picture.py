"""Pictures that stand or come again, as codecs send them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from rsenf.live.picture import PictureFacts, RepeatDetector
from rsenf.messages import Header, RowBlock

RATE = 25


def facts(picture_of: Callable[[int], float], seconds: list[int]) -> list[PictureFacts]:
    """What is known after each second, of frames whose pictures are numbered."""
    picture, out = RepeatDetector(5.0, 1.0), []
    for second in seconds:
        frame = second * RATE + np.arange(RATE)
        level = [np.random.default_rng(round(picture_of(n))).normal(120, 1, (4, 1)) for n in frame]
        block = RowBlock(
            header=Header(), frames=RATE, rows=4, strips=1, frame_number=frame,
            frame_pts_ns=frame * (10**9 // RATE), level=np.array(level, np.float32),
            kept_px=np.ones((4, 1), np.uint32),
        )  # fmt: skip
        picture.add(block)
        out.append(picture.facts)
    return out


@pytest.mark.parametrize("gop", [12, 25, 50])
@pytest.mark.parametrize("better", [0, 1, 4])
def test_a_picture_that_stands_is_no_loop_for_all_its_key_frames(gop: int, better: int) -> None:
    """Each key frame is the same, and the frames after it bring the picture nearer to it."""
    told = facts(lambda n: n if n < 200 else 9000 + min(n % gop, better), list(range(25)))
    assert all(f.loop_since_ns is None for f in told)
    assert [f.frozen_since_ns is not None for f in told[8:]] == [False] * 4 + [True] * 13


def test_a_loop_is_seen_at_once_and_isn_t_frozen() -> None:
    told = facts(lambda n: n if n < 200 else 100 + n % 100, list(range(16)))
    assert [f.loop_since_ns is not None for f in told[7:]] == [False] * 2 + [True] * 7
    assert told[-1].period_s == pytest.approx(4.0)
    assert all(f.frozen_since_ns is None for f in told)


def test_the_first_pictures_after_a_pause_are_not_frozen() -> None:
    picture = RepeatDetector(5.0, 1.0)
    for t_s in [*range(10), 40, 41]:
        level = np.full((1, 4, 1), 100.0 + t_s, np.float32)
        block = RowBlock(
            header=Header(), frames=1, rows=4, strips=1, frame_number=np.array([t_s]),
            frame_pts_ns=np.array([t_s * 10**9]), level=level, kept_px=np.ones((4, 1), np.uint32),
        )  # fmt: skip
        picture.add(block)
        assert picture.facts.frozen_since_ns is None

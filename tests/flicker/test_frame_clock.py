"""The frame rate that an idle period is a share of."""

from __future__ import annotations

import numpy as np
import pytest

from rsenf.flicker.slow_time import FrameCounter
from rsenf.messages import Header, RowBlock

PERIOD_NS = 33_333_333


@pytest.mark.parametrize("start_ns", [0, -1, -7_000_000, -500_000_000, -60_000_000_000])
def test_a_clock_may_begin_anywhere(start_ns: int) -> None:
    """An RTSP camera's first picture is put one declared period before its second, at 0 or so."""
    clock = FrameCounter()
    assert clock.span_s == 0.0
    for k in range(40):
        number = np.arange(8 * k, 8 * k + 8)
        clock.add(
            RowBlock(
                header=Header(),
                frames=8,
                frame_number=number,
                frame_pts_ns=start_ns + PERIOD_NS * number,
            )
        )
    assert clock.span_s == pytest.approx(319 * PERIOD_NS / 1e9)
    assert clock.frame_rate_hz == pytest.approx(1e9 / PERIOD_NS)

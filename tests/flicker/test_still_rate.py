"""The frame rate where the alias is at 0 Hz: what is off there is off in the ENF."""

from __future__ import annotations

import numpy as np
import pytest

from rsenf.flicker.slow_time import frame_rate


@pytest.mark.parametrize("numbered", [False, True])
def test_frames_that_never_came_leave_the_rate_as_it_is(numbered: bool) -> None:
    rng = np.random.default_rng(5)
    frame = np.arange(3000)
    t_s = frame / 25.002 + 3e-4 * rng.standard_normal(frame.size)
    came = (frame < 1000) | (frame > 1032)
    came &= frame != 2001
    t_s, number = t_s[came], (frame[came] if numbered else np.arange(came.sum()))
    into = (t_s * 4).astype(int)
    _, into = np.unique(into, return_inverse=True)
    frames = np.bincount(into)
    rate, std = frame_rate(np.bincount(into, t_s) / frames, np.bincount(into, number) / frames)
    assert rate == pytest.approx(25.002, abs=1e-4)
    assert 0.0 < std < 1e-4
    assert abs(rate - 25.002) < 4.0 * std

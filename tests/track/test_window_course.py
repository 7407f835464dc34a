"""A tone's phase through a window: even, or with a jump; ramps that disagree about it."""

from __future__ import annotations

import numpy as np

from rsenf.track.window import MIN_SHARE, apart_hz2, course_of

T_S = np.arange(600) / 30.0 - 10.0


def test_a_jump_of_the_phase_is_no_grids() -> None:
    rng = np.random.default_rng(1)
    noise = rng.normal(0.0, 0.02, (T_S.size, 2)) @ [1.0, 1.0j]
    even = np.exp(2j * np.pi * 10.1 * T_S) + 3.0 + noise
    jumped = np.where(T_S > 1.0, even * np.exp(2.0j), even)
    assert course_of(even, T_S, 10.1, 20.0).excess < 2.0
    assert course_of(jumped, T_S, 10.1, 20.0).excess > 12.0
    # A frequency that is off by a bit is no stray.
    assert course_of(even, T_S, 10.12, 20.0).excess < 2.0


def test_what_never_moves_is_steady() -> None:
    rng = np.random.default_rng(2)
    noise = rng.normal(0.0, 0.01, (T_S.size, 2)) @ [1.0, 1.0j]
    assert course_of(np.exp(2j * np.pi * 10.0 * T_S) + noise, T_S, 10.0, 20.0).wander.is_steady


def test_ramps_that_disagree_are_told() -> None:
    tone, other = (np.exp(2j * np.pi * hz * T_S) for hz in (10.0, 10.03))
    agree = np.column_stack([tone, 0.5 * tone])
    assert apart_hz2(agree, 0, T_S, 10.0, 20.0) < 1e-12
    assert apart_hz2(np.column_stack([tone, 0.5 * other]), 0, T_S, 10.0, 20.0) > 5e-3**2
    faint = np.column_stack([tone, 0.5 * MIN_SHARE * other])
    assert apart_hz2(faint, 0, T_S, 10.0, 20.0) == 0.0

"""Filters side by side: what a long time without a phase must not do to them."""

from __future__ import annotations

import numpy as np
import pytest

from rsenf.live.bank import UNKNOWN_RAD2, Bank, Noise
from rsenf.live.cusum import NullModel


def drifting() -> Bank:
    """Return one filter of a phase and its drift."""
    noise = Noise(np.ones(1), np.full(1, 0.03))
    return Bank(np.diag([0.0, 4.0])[None], noise, np.ones(1), 0.0)


def test_a_phase_is_never_less_known_than_not_at_all() -> None:
    bank, turn = drifting(), np.array([[1.0, 600.0], [0.0, 1.0]])
    bank.update(0.0, 1e-4)
    bank.predict(turn, np.zeros((1, 2, 2)), 0.0)
    assert bank.cov[0, 0, 0] == pytest.approx(UNKNOWN_RAD2)
    assert np.linalg.eigvalsh(bank.cov[0]).min() >= -1e-9


def test_gaps_of_minutes_leave_the_filters_sound() -> None:
    grid, rng = NullModel(), np.random.default_rng(3)
    for _ in range(40):
        for passed_s in (*[1.0] * 5, 120.0):
            grid.update(passed_s, float(rng.uniform(-3, 3)), 1e-4)
    mean, var = grid.phase_after(1.0)
    assert abs(mean) < 1e4
    assert var > 0

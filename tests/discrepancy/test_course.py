"""The form of a course over time is named, with its parameters."""

from __future__ import annotations

import numpy as np
import pytest

from rsenf.discrepancy.result import form_of

T_S = np.arange(0.0, 60.0, 1 / 25)


@pytest.mark.parametrize(
    ("course", "form", "told"),
    [
        (0.002 * T_S, "even", {"rise_per_min": 0.12}),
        (np.exp(-T_S / 12.0), "exponential", {"time_constant_s": 12.0, "size": 1.0}),
        (0.3 * np.sin(2 * np.pi * 0.21 * T_S), "periodic", {"freq_hz": 0.21, "size": 0.3}),
        (1.0 * (T_S > 20) - 2.0 * (T_S > 41), "steps", {"at_s": [20.0, 41.0]}),
    ],
)
def test_its_form_is_named(course: np.ndarray, form: str, told: dict[str, object]) -> None:
    noise = 0.05 * course.std() * np.random.default_rng(5).standard_normal(T_S.size)
    found = form_of(T_S, course + noise)
    assert found["form"] == form
    for name, value in told.items():
        assert found[name] == pytest.approx(value, rel=0.05, abs=0.1 if name == "at_s" else 0)


def test_any_other_is_a_random_walk_that_is_drawn_back() -> None:
    rng, walk = np.random.default_rng(6), [0.0]
    for _ in range(40 * T_S.size - 1):
        walk.append(walk[-1] * np.exp(-0.04 / 3.0) + 0.1 * rng.standard_normal())
    found = form_of(np.arange(len(walk)) * 0.04, np.array(walk))
    assert found["form"] == "random walk"
    assert found["time_constant_s"] == pytest.approx(3.0, rel=0.3)

"""What only looks like an effect hasn't its size everywhere, and isn't named."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from rsenf.discrepancy.fit import Fit
from rsenf.discrepancy.forward_selection import UNEVEN, heterogeneity
from rsenf.discrepancy.measured import measured_of
from rsenf.discrepancy.series import all_as_declared
from rsenf.discrepancy.start import PLAIN
from rsenf.discrepancy.verdict import Discovery, discover
from rsenf.messages import Header
from rsenf.model.effects.catalogue import CATALOGUE
from rsenf.rows.stage import blocks_from_luminance
from tests.discrepancy.foreign_camera import Case, film


def found(hidden: str, seed: int) -> Discovery:
    case = Case(hidden=(hidden,), seed=seed, times=3.0, duration_s=30.0, rows=240, lamp="led")
    made = film(case)
    blocks = blocks_from_luminance(made.level, made.stamp_s, Header())
    return discover(PLAIN, measured_of(list(blocks)))


@pytest.fixture(scope="module")
def lamps() -> Fit:
    """A fit that has found a second lamp, and all there is."""
    said = found("second_lamp", 702)
    assert said.verdict == "explained"
    assert [step.equivalents for step in said.steps][-1] == ("second_lamp",)
    return said.last.restored()


@pytest.mark.parametrize(
    ("part", "size"),
    [
        (np.s_[:, :60], 2.0),
        (np.s_[:, :, 1:], 2.0),
        (np.s_[::2], 2.0),
        (np.s_[:, :60], 0.0),
    ],
)
def test_another_size_in_a_part_is_seen(lamps: Fit, part: tuple[slice, ...], size: float) -> None:
    model = lamps.forward.model.without("second_lamp")
    does = lamps.rows - lamps.forward.with_model(model).rows(lamps.data)
    left = lamps.residual.copy()
    left[part] += (size - 1.0) * does[part]
    other = dataclasses.replace(lamps, residual=left)
    assert heterogeneity(other, "second_lamp") > UNEVEN
    assert heterogeneity(lamps, "second_lamp") < UNEVEN / 10.0


@pytest.mark.parametrize("hidden", ["pulsating_part", "local_dimming"])
def test_what_is_only_like_an_effect_is_not_named(hidden: str) -> None:
    said = found(hidden, 702)
    assert said.verdict == "unexplained"
    assert [step.equivalents for step in said.steps] == [("harmonics",)]


@pytest.mark.parametrize(
    ("pattern", "is_banding"),
    [
        (lambda row, wall: np.sin(40 * row), True),
        (lambda row, wall: np.sin(8 * row), True),
        (lambda row, wall: 1 / wall, False),  # black drifts
        (lambda row, wall: (1 + 0.4 * row) / wall, False),
        (lambda row, wall: 1 - 0.5 * row, False),  # a lamp at the top sags
    ],
)
def test_a_pattern_that_grows_evenly_down_the_frame_is_no_banding(
    pattern: Callable[..., np.ndarray], is_banding: bool
) -> None:
    row, rng = np.linspace(-1.0, 1.0, 240), np.random.default_rng(2)
    wall = 100.0 + 30.0 * np.sin(3.0 * row)
    gains = pattern(row, wall) / np.std(pattern(row, wall)) + 0.05 * rng.normal(size=row.size)
    effect: Any = CATALOGUE["row_banding"]
    with_course = effect(gain_ratios=tuple(0.01 * gains), course=(1.0, -1.0))
    assert all_as_declared((with_course,), 10, wall[:, None]) is is_banding

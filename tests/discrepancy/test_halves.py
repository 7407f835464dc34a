"""What is systematic, in spite of noise that rows share: the halves of a frame."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from rsenf.discrepancy.gap import gap_of
from rsenf.discrepancy.measured import LINES, STRIPS, Measured, apart_of

FRAMES, ROWS = 900, 64


def _measured(apart: int, strips: int = 5) -> Measured:
    rate = Fraction(30)
    slot = np.arange(FRAMES)
    level = np.zeros((FRAMES, ROWS, strips), np.float32)
    return Measured(level, slot / float(rate), slot, rate, 50.0, apart=apart)


@pytest.mark.parametrize("apart", [LINES, STRIPS])
def test_halves_are_neighbours_along_their_axis(apart: int) -> None:
    data = _measured(apart)
    place = np.broadcast_to(np.arange(5)[: data.strips], (1, 5, 5)).copy()
    place = place if apart == STRIPS else place.transpose(0, 2, 1)
    first, second = data.halves(place)
    assert first.shape == second.shape
    assert np.all(second - first == 1)
    assert set(np.unique(first)) == {0, 2}
    assert (data.every(LINES), data.every(STRIPS)) == ((2, 1) if apart == LINES else (1, 2))


def test_noise_that_rows_share_is_a_gap_between_rows_but_not_between_strips() -> None:
    rng = np.random.default_rng(3)
    blocks = rng.standard_normal((FRAMES, ROWS // 8, 4)).astype(np.float32)
    noise = np.repeat(blocks, 8, axis=1)
    every, lit = np.ones(FRAMES, bool), np.ones_like(noise)
    rows = gap_of(noise, lit, _measured(LINES, 4), every)
    strips = gap_of(noise, lit, _measured(STRIPS, 4), every)
    assert rows.value == pytest.approx(1.0, rel=0.05)
    assert abs(strips.value) < 4.0 * strips.stderr


def test_which_it_is_is_seen_in_the_noise() -> None:
    rng = np.random.default_rng(4)
    white = rng.standard_normal((FRAMES, ROWS, 2)).astype(np.float32)
    turns = (
        np.arange(ROWS)[:, None] / 30.0
        + np.array([0.0, 0.1])
        + np.arange(FRAMES)[:, None, None] / 7
    )
    lit = 100.0 * (1.0 + 0.1 * np.cos(2 * np.pi * turns)).astype(np.float32)
    coded = white + 0.2 * np.roll(white, 1, axis=1)  # fine detail is what codecs take
    assert apart_of(lit + 0.1 * white) == LINES
    assert apart_of(lit + 0.1 * coded) == STRIPS
    assert apart_of((lit + 0.1 * coded)[:, :, :1]) == LINES  # which can't be told

"""Slices by the page are the slices, and what was read is not read again."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from rsenf.match import forecast
from rsenf.match.forecast import PAGE, Pages, in_pages
from tests.match.match_clips import grid_from

VALUES = np.random.default_rng(1).standard_normal(5 * PAGE + 77)


class OnDisk:
    """A series that counts what is read of it."""

    def __init__(self, values):
        self._values, self.size, self.read = values, values.size, 0

    def __getitem__(self, part):
        out = self._values[part]
        self.read += out.size
        return out


@given(st.integers(0, VALUES.size - 1), st.integers(1, 3 * PAGE))
def test_a_slice_is_the_slice(start, length):
    stop = min(start + length, VALUES.size)
    np.testing.assert_array_equal(Pages(OnDisk(VALUES))[start:stop], VALUES[start:stop])


def test_what_was_read_is_kept_but_not_for_ever(monkeypatch):
    monkeypatch.setattr(forecast, "KEPT", 2)
    series = OnDisk(VALUES)
    paged = Pages(series)
    for _ in range(3):
        paged[10:20]
        paged[PAGE - 5 : PAGE + 5]
    assert series.read == 2 * PAGE
    paged[3 * PAGE : 5 * PAGE]
    paged[10:20]
    assert series.read == 5 * PAGE


def test_a_reference_in_memory_stays_as_it_is():
    grid = grid_from(VALUES)
    assert in_pages(grid) is grid
    lazy = grid_from(VALUES[:10])
    object.__setattr__(lazy, "freq_hz", OnDisk(VALUES))
    assert isinstance(in_pages(lazy).freq_hz, Pages)
    assert in_pages(lazy).duration_s == VALUES.size

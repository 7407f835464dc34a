"""Samples of the store read in slices: the same as the whole, and bounded."""

from __future__ import annotations

import inspect

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rsenf.errors import UsageError
from rsenf.match.series import Grid
from rsenf.reference import Reference, open_reference, reference_blocks
from rsenf.reference.store.sample_file import BLOCK
from rsenf.reference.store.stored import CACHED_BLOCKS
from tests.reference.joined import joined
from tests.reference.reference_files import values
from tests.reference.store_files import BORDER, S, bring, write_csv

N = 400
YEAR_S = 31_557_600
FREQ = values(N)
FREQ[100:130] = np.nan


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    """400 s about a block's border in two overlapping imports; a year later 50 s more."""
    folder = tmp_path_factory.mktemp("slices")
    seconds, there = BORDER - 150 + np.arange(N), np.flatnonzero(np.isfinite(FREQ))
    for name, part in (("a", there[there < 250]), ("b", there[there >= 200])):
        bring(folder / "store", write_csv(folder / f"{name}.csv", seconds[part], FREQ[part]))
    later = BORDER + YEAR_S + np.arange(50)
    bring(folder / "store", write_csv(folder / "later.csv", later, FREQ[:50]))
    return folder / "store"


@pytest.fixture(scope="module")
def stretch(store):
    """The 400 s alone."""
    end = np.datetime64((BORDER + 1000) * S, "ns")
    return open_reference(f"store:ce@1?to={str(end)[:19]}Z", store=store)


def test_the_whole(stretch):
    np.testing.assert_array_equal(np.asarray(stretch.freq_hz), FREQ)
    readings = 1 * np.isfinite(FREQ) + ((np.arange(N) >= 200) & (np.arange(N) < 250))
    np.testing.assert_array_equal(np.asarray(stretch.readings), readings)
    assert (stretch.t0_ns, stretch.duration_s) == ((BORDER - 150) * S, N)
    assert stretch.end_ns == (BORDER - 150 + N) * S
    assert (stretch.grid, stretch.nominal_hz, stretch.step_s) == ("ce", 50.0, 1.0)
    f = stretch.freq_hz
    assert (f.size, len(f), f.shape, f.ndim, f.dtype) == (N, N, (N,), 1, np.float64)


ENDS = st.one_of(st.none(), st.integers(-450, 450))


@settings(max_examples=200, deadline=None)
@given(start=ENDS, stop=ENDS, step=st.sampled_from([None, 1, 2, 7, -1, -3]))
def test_slices_are_those_of_an_array(stretch, start, stop, step):
    part = stretch.freq_hz[start:stop:step]
    assert isinstance(part, np.ndarray)
    assert part.dtype == np.float64
    np.testing.assert_array_equal(part, FREQ[start:stop:step])
    np.testing.assert_array_equal(
        stretch.readings[start:stop:step], np.asarray(stretch.readings)[start:stop:step]
    )


def test_a_slice_is_nobody_else_s(stretch):
    part = stretch.freq_hz[10:20]
    part[:] = 0.0
    np.testing.assert_array_equal(stretch.freq_hz[10:20], FREQ[10:20])


def test_numpy_sees_an_array(stretch):
    np.testing.assert_array_equal(np.isnan(stretch.freq_hz), np.isnan(FREQ))
    assert np.asarray(stretch.freq_hz, np.float32).dtype == np.float32
    np.testing.assert_array_equal(np.fromiter(stretch.freq_hz, float), FREQ)
    with pytest.raises(TypeError, match="slices"):
        stretch.freq_hz[3]


def test_it_does_for_a_grid_to_match(stretch):
    grid = Grid(stretch.grid, stretch.nominal_hz, stretch.t0_ns, stretch.step_s, stretch.freq_hz)
    assert grid.duration_s == N
    np.testing.assert_array_equal(grid.freq_hz[90:140], FREQ[90:140])


def test_blocks_of_it_are_those_of_a_file(stretch):
    back = joined(reference_blocks(stretch, source="reference/ce", block=77))
    np.testing.assert_array_equal(back.freq_hz, FREQ)
    np.testing.assert_array_equal(back.readings, np.asarray(stretch.readings))
    assert (back.grid, back.t0_ns, back.step_s) == ("ce", stretch.t0_ns, 1.0)


def test_a_long_hole_is_neither_read_nor_kept(store, monkeypatch):
    reference = open_reference("store:ce", store=store)
    assert reference.freq_hz.size == YEAR_S + 150 + 50
    assert reference.measured.tolist() == [[0, N], [YEAR_S + 150, YEAR_S + 200]]
    read = []
    series = reference.freq_hz._series
    whole = type(series).block
    monkeypatch.setattr(type(series), "block", lambda s, n: read.append(n) or whole(s, n))
    there = 0
    for a in range(0, reference.freq_hz.size, 1_000_000):
        there += int(np.isfinite(reference.freq_hz[a : a + 1_000_000]).sum())
    assert there == N - 30 + 50
    assert read == [BORDER // BLOCK - 1, BORDER // BLOCK, (BORDER + YEAR_S) // BLOCK]


def test_only_the_last_blocks_are_kept(tmp_path):
    for n in range(CACHED_BLOCKS + 4):
        path = write_csv(tmp_path / f"{n}.csv", BORDER + BLOCK * n + np.arange(5), values(5))
        bring(tmp_path / "store", path)
    reference = open_reference("store:ce", store=tmp_path / "store")
    for a in range(0, reference.freq_hz.size, 1_000_000):
        _ = reference.freq_hz[a : a + 1_000_000]
    dense = inspect.getclosurevars(reference.freq_hz._block).nonlocals["dense"]
    assert dense.cache_info().currsize == CACHED_BLOCKS


@pytest.mark.parametrize(
    ("limits", "first", "size"),
    [
        ({}, 0, N),
        ({"from": 10}, 10, N - 10),
        ({"to": 10}, 0, 10),
        ({"from": 90.5, "to": 300.5}, 91, 210),
        ({"from": -1000, "to": 1}, 0, 1),
        ({"from": 110, "to": 140}, 110, 30),
    ],
)
def test_limits(store, limits, first, size):
    whole = {"to": 1000} | limits
    texts = [
        f"{key}={np.datetime64(int((BORDER - 150 + at) * S), 'ns').astype('datetime64[ms]')}Z"
        for key, at in whole.items()
    ]
    reference = open_reference(f"store:ce?{'&'.join(texts)}", store=store)
    assert reference.t0_ns == (BORDER - 150 + first) * S
    np.testing.assert_array_equal(np.asarray(reference.freq_hz), FREQ[first : first + size])


def test_limits_in_another_zone(store):
    at = str(np.datetime64((BORDER + 7200) * S, "ns"))[:19]
    reference = open_reference(f"store:ce?to={at}+02:00", store=store)
    assert reference.freq_hz.size == 150


@pytest.mark.parametrize(
    ("spec", "says", "hint"),
    [
        ("store:us", "no grid 'us' in the store", "rsenf reference import"),
        ("store:us", "there are ce", ""),
        ("store:", "'' is no name for a grid", "letters"),
        ("store:ce@2", "no ce@2 in the store", "there is ce@1"),
        ("store:ce@fast", "'fast' is no step in seconds", "ce@0.1"),
        ("store:ce?since=2024", "'since' is no limit", "from=2024-08-01"),
        ("store:ce?from=soon", "from= 'soon' is not a time", "2022-09-17T14:05:00Z"),
        ("store:ce?from=2024-02-01&to=2024-01-01", "ends before it begins", "from"),
        ("store:ce?from=2050-01-01", "nothing of ce then", "it has ce@1, "),
    ],
)
def test_what_is_not_there(store, spec, says, hint):
    with pytest.raises(UsageError) as caught:
        open_reference(spec, store=store)
    assert says in caught.value.message
    assert hint in caught.value.hint
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "options", [{"timezone": "UTC"}, {"column": "f"}, {"step_s": 1.0}, {"stamp": "centre"}]
)
def test_options_that_are_for_files(store, options):
    """A store may stand beside a file that they are for."""
    plain, told = (open_reference("store:ce", store=store, **o) for o in ({}, options))
    assert told.t0_ns == plain.t0_ns
    (line,) = set(told.notes) - set(plain.notes)
    assert "no bearing on the store" in line


def test_what_it_is_called_and_what_it_must_be(store):
    reference = open_reference("store:ce", store=store, grid="continent", nominal_hz=50.0)
    assert (reference.grid, reference.name) == ("continent", "store:ce@1")
    assert {r.name for r in reference.imports} == {"a.csv", "b.csv", "later.csv"}
    assert len(reference.sha256) == 64
    with pytest.raises(UsageError, match="of a 50 Hz grid, not of one of 60 Hz"):
        open_reference("store:ce", store=store, nominal_hz=60.0)


def test_the_store_of_the_user(store, monkeypatch, tmp_path):
    monkeypatch.setenv("RSENF_STORE", str(store))
    assert open_reference("store:ce").grid == "ce"
    monkeypatch.delenv("RSENF_STORE")
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    with pytest.raises(UsageError, match="it is empty") as caught:
        open_reference("store:ce")
    assert str(tmp_path / "rsenf" / "store") in caught.value.message


def test_a_file_is_a_file(tmp_path):
    path = write_csv(tmp_path / "a.csv", BORDER + np.arange(50), values(50))
    reference = open_reference(path, grid="ce")
    assert isinstance(reference, Reference)
    np.testing.assert_array_equal(reference.freq_hz, values(50))

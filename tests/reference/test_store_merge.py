"""Whatever the imports, their order and their overlaps: the store holds what one file would."""

from __future__ import annotations

import itertools
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rsenf.reference import read_reference
from rsenf.reference.axis import gathered, merged
from rsenf.reference.store import SampleFile, sample_file
from tests.reference.store_files import BORDER, bring, files_in, held, write_csv


def some_readings(rng):
    """Seconds about a block's border, some missing, some several times, some contradicting."""
    seconds = BORDER - 60 + np.flatnonzero(rng.random(120) < 0.7)
    seconds = np.concatenate([seconds, rng.choice(seconds, 40)])
    rng.shuffle(seconds)
    uhz = rng.integers(-30_000, 30_000, 120)[seconds - seconds.min()]
    uhz = uhz + rng.choice([0, 0, 1, 4_999, 5_000, 5_001], seconds.size)
    return seconds, (50_000_000 + uhz) / 1e6


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), parts=st.integers(1, 5))
def test_parts_in_any_order_are_the_whole(seed, parts):
    rng = np.random.default_rng(seed)
    seconds, freq = some_readings(rng)
    chosen = np.array_split(rng.permutation(seconds.size), parts)
    with tempfile.TemporaryDirectory() as folder:
        store = Path(folder) / "store"
        for n, rows in enumerate(chosen):
            path = write_csv(Path(folder) / f"{n}.csv", seconds[rows], freq[rows])
            assert bring(store, path, step_s=1.0).new
        whole = read_reference(write_csv(Path(folder) / "whole.csv", seconds, freq), step_s=1.0)
        t_ns, stored, readings = held(store)
    assert (t_ns[0], t_ns.size) == (whole.t0_ns, whole.freq_hz.size)
    np.testing.assert_array_equal(readings, whole.readings)
    np.testing.assert_array_equal(np.isnan(stored), np.isnan(whole.freq_hz))
    once = readings == 1
    np.testing.assert_array_equal(stored[once], whole.freq_hz[once])
    # A mean of several is rounded to the store's unit.
    np.testing.assert_allclose(stored, whole.freq_hz, rtol=0, atol=0.51e-6)


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), cuts=st.lists(st.integers(0, 160), max_size=4))
def test_samples_merge_to_the_same_however_they_are_cut(seed, cuts):
    seconds, freq = some_readings(np.random.default_rng(seed))
    units = np.rint(freq * 1e6).astype(np.int64)
    whole = gathered(seconds, units, 1e-6)
    edges = [0, *sorted(min(c, seconds.size) for c in cuts), seconds.size]
    pieces = [gathered(seconds[a:b], units[a:b], 1e-6) for a, b in itertools.pairwise(edges)]
    again = merged([merged(pieces[::-1][:2]), *pieces[::-1][2:]])
    for name in ("index", "total", "readings", "low", "high"):
        np.testing.assert_array_equal(getattr(again, name), getattr(whole, name))

    told: dict[int, list[int]] = {}
    for second, unit in zip(seconds.tolist(), units.tolist(), strict=True):
        told.setdefault(second, []).append(unit)
    assert whole.index.tolist() == sorted(told)
    for k, second in enumerate(whole.index.tolist()):
        values = told[second]
        assert (whole.total[k], whole.readings[k]) == (sum(values), len(values))
        assert whole.agree[k] == (max(values) - min(values) <= 5_000)


def test_the_same_file_again_changes_nothing(tmp_path):
    store = tmp_path / "store"
    path = write_csv(tmp_path / "a.csv", BORDER + np.arange(100), np.full(100, 50.01))
    first = bring(store, path)
    before = {p: (store / p).stat().st_mtime_ns for p in files_in(store)}
    copy = tmp_path / "copy-of-a.csv"
    copy.write_bytes(path.read_bytes())
    for again in (path, copy):
        done = bring(store, again)
        assert not done.new
        assert (done.path, done.record) == (first.path, first.record)
    assert {p: (store / p).stat().st_mtime_ns for p in files_in(store)} == before
    assert held(store)[2].tolist() == [1] * 100


@pytest.mark.parametrize(("pending", "groups"), [(1, range(3, 100)), (1 << 21, [2])])
def test_a_file_in_no_order_is_the_same_file(tmp_path, monkeypatch, pending, groups):
    """However much of it is held back: blocks may be written in parts."""
    monkeypatch.setattr(sample_file, "PENDING_ROWS", pending)
    monkeypatch.setattr("rsenf.reference.table.BLOCK_CHARS", 400)
    monkeypatch.setattr("rsenf.reference.readings.HEAD_VALUES", 3)
    rng = np.random.default_rng(5)
    seconds = BORDER - 200 + np.arange(400)
    freq = np.round(50 + 0.02 * rng.standard_normal(400), 6)
    order = rng.permutation(400)
    done = bring(
        tmp_path / "store", write_csv(tmp_path / "a.csv", seconds[order], freq[order]), step_s=1.0
    )
    t_ns, stored, readings = held(tmp_path / "store")
    np.testing.assert_array_equal(t_ns, seconds * 10**9)
    np.testing.assert_array_equal(stored, freq)
    assert set(readings) == {1}
    assert len(SampleFile(done.path).groups) in groups
    assert "rows not in the order of time: sorted" in done.record.notes

"""Gaps, duplicates, jitter and disorder on the way to one axis, against a plain dictionary."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rsenf.errors import ReferenceFormatError
from rsenf.reference.axis import Piece, find_raster, to_axis
from tests.reference.reference_files import T0_NS, read_rows, read_stamped, stamps, values

S = 10**9


@settings(max_examples=80, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(5, 120), keep=st.floats(0.3, 1.0))
def test_axis_is_what_a_dictionary_of_seconds_holds(seed, n, keep):
    rng = np.random.default_rng(seed)
    seconds = np.flatnonzero(rng.random(n) < keep)
    if seconds.size < 3:
        seconds = np.arange(3)
    seconds = np.concatenate([seconds, rng.choice(seconds, seconds.size // 4)])
    rng.shuffle(seconds)
    jitter_ns = rng.integers(-10_000_000, 10_000_000, seconds.size)
    freq = 50 + np.round(0.004 * rng.random(seconds.size), 4)
    freq[rng.random(seconds.size) < 0.1] += 0.02
    freq[rng.random(seconds.size) < 0.1] = np.nan
    t_ns = T0_NS + seconds * S + jitter_ns
    axis = to_axis([Piece(t_ns, freq, find_raster(t_ns, 1.0, "x"))], "x")

    held: dict[int, list[float]] = {}
    for second, value in zip(seconds, freq, strict=True):
        held.setdefault(int(second), []).extend([] if np.isnan(value) else [value])
    first, last = min(held), max(held)
    assert axis.freq_hz.size == last - first + 1
    assert abs(axis.t0_ns - (T0_NS + first * S)) <= 20_000_000
    for k in range(first, last + 1):
        readings = held.get(k, [])
        assert axis.readings[k - first] == len(readings)
        if readings and max(readings) - min(readings) <= 0.005:
            assert axis.freq_hz[k - first] == pytest.approx(np.mean(readings), abs=1e-12)
        else:
            assert np.isnan(axis.freq_hz[k - first])


def test_gaps_are_counted_and_kept(tmp_path):
    times, freq = stamps(300), values(300)
    keep = [i for i in range(300) if not (100 <= i < 130 or i == 200)]
    reference = read_stamped(tmp_path, [times[i] for i in keep], freq[keep])
    assert reference.freq_hz.size == 300
    assert reference.gaps == 2
    assert np.isnan(reference.freq_hz[100:130]).all()
    assert reference.valid_samples == 269
    assert "gaps: 2, 31 s in all (10%), the longest 30 s" in reference.notes
    assert reference.duration_s == 300
    assert reference.end_ns == T0_NS + 300 * S


def test_duplicates_are_averaged_or_distrusted(tmp_path):
    times, freq = stamps(50), values(50)
    more = [f"{times[10]},{freq[10] + 0.002:.4f}", f"{times[20]},{freq[20] + 0.02:.4f}"]
    rows = [f"{t},{f:.4f}" for t, f in zip(times, freq, strict=True)]
    reference = read_rows(tmp_path, [*rows, *more])
    assert reference.freq_hz[10] == pytest.approx(freq[10] + 0.001)
    assert np.isnan(reference.freq_hz[20])
    assert reference.readings[[9, 10, 20]].tolist() == [1, 2, 2]
    assert reference.duplicates == 2
    notes = " / ".join(reference.notes)
    assert "samples with more than one reading, averaged: 2" in notes
    assert "disagree by more than 5 mHz, taken as gaps: 1" in notes
    assert "sorted" in notes


def test_jitter_goes_to_the_nearest_sample(tmp_path):
    rng = np.random.default_rng(4)
    at_s = np.arange(400) + rng.uniform(-0.3, 0.3, 400)
    times = [str(np.datetime64(T0_NS + round(s * S), "ns").astype("datetime64[ms]")) for s in at_s]
    freq = values(400)
    reference = read_stamped(tmp_path, times, freq)
    np.testing.assert_array_equal(reference.freq_hz, freq)
    assert abs(reference.t0_ns - T0_NS) < 0.1 * S
    assert any("off the 1 s grid by up to 0.3" in note for note in reference.notes)


def test_what_is_no_number_is_a_gap(tmp_path):
    freq = [f"{f:.4f}" for f in values(50)]
    freq[3], freq[7], freq[8], freq[30] = "n/a", "", "--", "999"
    reference = read_stamped(tmp_path, stamps(50), freq)
    assert np.flatnonzero(np.isnan(reference.freq_hz)).tolist() == [3, 7, 8, 30]
    assert reference.readings[[3, 7, 8, 30]].tolist() == [0, 0, 0, 0]
    assert "values that are no numbers, taken as gaps: 3" in reference.notes
    assert "values over 1.5 Hz from 50 Hz, taken as gaps: 1" in reference.notes


def test_what_is_no_time_is_left_out(tmp_path):
    times = stamps(50)
    times[5], times[6] = "yesterday", ""
    reference = read_stamped(tmp_path, times, values(50))
    assert np.flatnonzero(np.isnan(reference.freq_hz)).tolist() == [5, 6]
    assert any(
        "rows without a time that can be used, left out: 2" in note for note in reference.notes
    )


def test_a_wrong_date_does_not_fill_the_memory(tmp_path):
    times = stamps(50)
    times[25] = "1922-09-17 00:00:25"
    with pytest.raises(ReferenceFormatError, match="50 values span 36525 days"):
        read_stamped(tmp_path, times, values(50))


def test_all_at_the_same_time(tmp_path):
    with pytest.raises(ReferenceFormatError, match="all values have the same time"):
        read_stamped(tmp_path, stamps(1) * 20, values(20))

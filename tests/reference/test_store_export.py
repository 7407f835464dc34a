"""Out of the store and back: the same values at the same times."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rsenf.errors import RecordingError, UsageError
from rsenf.reference import open_reference, read_reference
from rsenf.reference.store import export
from tests.reference.reference_files import values
from tests.reference.store_files import BORDER, bring, held, write_csv


def to_microhertz(freq_hz):
    """Some values of the measured week are 50.010000000000005 and the like."""
    return np.rint(freq_hz * 1e6) / 1e6


def exported(store, path, spec="store:ce"):
    export(open_reference(spec, store=store), path)
    return path


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    step_ms=st.sampled_from([100, 1000, 2000]),
    nominal_hz=st.sampled_from([50.0, 60.0]),
    decimals=st.integers(1, 6),
    centre=st.booleans(),
    ending=st.sampled_from([".csv", ".parquet"]),
)
def test_round_trip(seed, step_ms, nominal_hz, decimals, centre, ending):
    rng = np.random.default_rng(seed)
    border = BORDER * max(1, 1000 // step_ms)  # before 2262, the last year of ns in 64 bits
    index = border - 40 + np.flatnonzero(rng.random(80) < 0.6)
    index = index if index.size > 1 else border + np.arange(2)
    freq = np.round(nominal_hz + rng.uniform(-0.2, 0.2, index.size), decimals)
    times = (index * step_ms).astype("datetime64[ms]").astype(str)
    options = {"step_s": step_ms / 1000}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        source = folder / "source.csv"
        rows = [f"{t},{f}" for t, f in zip(times, freq.tolist(), strict=True)]
        source.write_text("\n".join(["time,frequency", *rows]))
        read = read_reference(source, stamp="centre" if centre else "start", **options)
        bring(folder / "a", source, stamp="centre" if centre else "start", **options)
        path = exported(folder / "a", folder / f"out{ending}")
        back = read_reference(path, **options)
        bring(folder / "b", path, **options)
        first, second = held(folder / "a"), held(folder / "b")
    assert (back.t0_ns, back.step_s, back.nominal_hz) == (read.t0_ns, read.step_s, nominal_hz)
    np.testing.assert_array_equal(back.freq_hz, read.freq_hz)
    np.testing.assert_array_equal(back.readings, read.readings)
    for one, other in zip(first, second, strict=True):
        np.testing.assert_array_equal(one, other)


def test_what_was_averaged_comes_back_as_it_was_read(tmp_path):
    """The store rounds to whole microhertz, so that a file of six decimals holds it."""
    store = tmp_path / "store"
    for n, microhertz in enumerate((0, 1, 3)):
        freq = np.round(values(50) + 1e-6 * microhertz * (np.arange(50) % 3), 6)
        bring(store, write_csv(tmp_path / f"{n}.csv", BORDER + np.arange(50), freq))
    _, stored, readings = held(store)
    assert set(readings) == {3}
    np.testing.assert_array_equal(stored, to_microhertz(stored))
    back = read_reference(exported(store, tmp_path / "out.csv"))
    np.testing.assert_array_equal(back.freq_hz, stored)


def test_a_part_and_a_long_hole(tmp_path):
    store = tmp_path / "store"
    for n, start in enumerate((BORDER, BORDER + 50_000_000)):
        path = write_csv(tmp_path / f"{n}.csv", start + np.arange(100), values(100))
        bring(store, path)
    path = exported(store, tmp_path / "out.csv")
    assert len(path.read_text().splitlines()) == 201
    at = str(np.datetime64(BORDER + 90, "s"))
    part = read_reference(exported(store, tmp_path / "part.parquet", f"store:ce@1?to={at}"))
    np.testing.assert_array_equal(part.freq_hz, values(100)[:90])


def test_where_it_cannot_go(tmp_path):
    store = tmp_path / "store"
    bring(store, write_csv(tmp_path / "a.csv", BORDER + np.arange(50), values(50)))
    with pytest.raises(UsageError, match=r"neither \.csv nor \.parquet"):
        exported(store, tmp_path / "out.xlsx")
    with pytest.raises(RecordingError, match="can't write"):
        exported(store, tmp_path / "none" / "out.csv")


@pytest.mark.measured
@pytest.mark.parametrize("ending", [".csv", ".parquet"])
def test_measured_week_with_its_gaps_comes_back(measured_data, tmp_path, ending):
    source = measured_data / "grid_ce_2024-08-13_to_21_gappy_1s.csv.gz"
    read = read_reference(source)
    bring(tmp_path / "store", source)
    back = read_reference(exported(tmp_path / "store", tmp_path / f"out{ending}"))
    stored = open_reference("store:ce", store=tmp_path / "store")
    for other in (back, stored):
        assert (other.t0_ns, other.step_s) == (read.t0_ns, 1.0)
        np.testing.assert_array_equal(np.asarray(other.freq_hz), to_microhertz(read.freq_hz))
        np.testing.assert_array_equal(np.asarray(other.readings), read.readings)


@pytest.mark.measured
def test_measured_days_of_another_grid(measured_data, tmp_path):
    source = measured_data / "grid_us_60hz_2022-07_2s.npz"
    read = read_reference(source, timezone="America/New_York")
    assert (read.nominal_hz, read.step_s, read.gaps) == (60.0, 2.0, 0)
    assert read.t0_ns == int(np.datetime64("2022-07-01T04:00", "ns").astype(np.int64))
    assert read.freq_hz.size == 21 * 43_200
    assert np.std(read.freq_hz) == pytest.approx(16e-3, abs=1e-3)
    bring(tmp_path / "store", source, "us", timezone="America/New_York")
    spec = "store:us@2?from=2022-07-02&to=2022-07-03"
    back = read_reference(exported(tmp_path / "store", tmp_path / "out.csv", spec))
    day = read.freq_hz[20 * 1800 :][: 24 * 1800]
    # Its float32 are decimals of six places that lost their last bits.
    np.testing.assert_allclose(back.freq_hz, day, rtol=0, atol=0.51e-6)
    np.testing.assert_array_equal(back.freq_hz.astype(np.float32), day.astype(np.float32))


@pytest.mark.measured
def test_measured_minutes_within_the_week_are_duplicates(measured_data, tmp_path):
    for name in ("grid_ce_2024-08-13_to_21_gappy_1s.csv.gz", "grid_ce_2024-08-19_152602_1s.csv"):
        bring(tmp_path / "store", measured_data / name)
    _, stored, readings = held(tmp_path / "store")
    assert (readings == 2).sum() == 517
    assert np.isfinite(stored).sum() == 448_035

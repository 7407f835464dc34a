"""Plain Parquet files, and days in a NumPy archive."""

from __future__ import annotations

import decimal
import zipfile

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet

from rsenf.errors import ReferenceFormatError, RsenfError
from rsenf.reference import read_reference
from tests.reference.reference_files import T0, T0_NS, stamps, values

N = 120
FREQ = values(N)
UTC = T0 + np.arange(N) * np.timedelta64(1, "s")
LOCAL = UTC + np.timedelta64(2, "h")


def written(folder, name="grid.parquet", **columns):
    path = folder / name
    parquet.write_table(pa.table(columns), path)
    return path


@pytest.mark.parametrize(
    "columns",
    [
        {"time": pa.array(UTC), "frequency": FREQ},
        {"Timestamp": pa.array(UTC.astype("datetime64[ms]"), pa.timestamp("ms", "UTC")), "f": FREQ},
        {"utc": pa.array(UTC, pa.timestamp("ns", "Europe/Berlin")), "Hz": FREQ},
        {"__index_level_0__": pa.array(UTC), "frequency": FREQ},
        {"time": pa.array(stamps(N)), "frequency": FREQ},
        {"time": pa.array([f"{t}Z" for t in stamps(N)]), "frequency": FREQ},
        {"time": UTC.astype(np.int64) // 10**9, "frequency": FREQ},
        {"unix": UTC.astype(np.int64) / 1e9, "value": FREQ.astype(str)},
        {"time": pa.array(UTC), "frequency": [decimal.Decimal(str(f)) for f in FREQ]},
        {"time": pa.array(stamps(N)).dictionary_encode(), "frequency": FREQ},
        {"time": pa.array([t.encode() for t in stamps(N)]), "frequency": FREQ},
        {"time": pa.array(UTC), "frequency": pa.array(FREQ).dictionary_encode()},
    ],
)
def test_columns_as_of_a_csv(tmp_path, columns):
    reference = read_reference(written(tmp_path, **columns))
    np.testing.assert_array_equal(reference.freq_hz, FREQ)
    assert (reference.t0_ns, reference.step_s, reference.nominal_hz) == (T0_NS, 1.0, 50.0)
    assert (reference.grid, reference.name) == ("grid", "grid.parquet")


def test_local_times_and_nulls(tmp_path):
    freq = [None if i in (5, 6, 40) else f for i, f in enumerate(FREQ)]
    times = [None if i == 50 else t for i, t in enumerate(LOCAL.astype("datetime64[us]").tolist())]
    path = written(tmp_path, time=pa.array(times), frequency=freq)
    reference = read_reference(path, timezone="Europe/Berlin")
    assert reference.t0_ns == T0_NS
    assert np.flatnonzero(np.isnan(reference.freq_hz)).tolist() == [5, 6, 40, 50]
    assert "values that are no numbers, taken as gaps: 3" in reference.notes
    assert "rows without a time that can be used, left out: 1" in reference.notes


def test_batches_are_the_whole(tmp_path, monkeypatch):
    path = written(tmp_path, time=pa.array(UTC), frequency=FREQ)
    whole = read_reference(path)
    monkeypatch.setattr("rsenf.reference.table.BATCH_ROWS", 7)
    np.testing.assert_array_equal(read_reference(path).freq_hz, whole.freq_hz)


def test_values_alone_and_a_named_column(tmp_path):
    path = written(tmp_path, boston=FREQ + 10, frequency=FREQ)
    assert read_reference(path, step_s=2.0).step_s == 2.0
    assert read_reference(path, step_s=2.0, column="Boston").nominal_hz == 60.0


@pytest.mark.parametrize(
    ("columns", "says"),
    [
        ({"time": pa.array(UTC), "volts": FREQ}, "no frequency column in grid.parquet"),
        ({"time": pa.array(UTC), "frequency": pa.array(UTC)}, r"holds timestamp\[ns\], no numbers"),
        ({"time": pa.nulls(N), "frequency": FREQ}, "'time' holds null, no times"),
        ({"time": pa.array(UTC - T0), "frequency": FREQ}, r"holds duration\[ns\], no times"),
        ({"frequency": FREQ}, "no time column"),
        ({"time": pa.array(UTC)[:0], "frequency": FREQ[:0]}, "holds no values"),
    ],
)
def test_parquet_that_is_no_reference(tmp_path, columns, says):
    with pytest.raises(ReferenceFormatError, match=says):
        read_reference(written(tmp_path, **columns))


def test_what_is_no_parquet(tmp_path):
    path = tmp_path / "x.parquet"
    path.write_bytes(b"PAR1 and no more")
    with pytest.raises(ReferenceFormatError, match="no Parquet file that can be read") as caught:
        read_reference(path)
    assert "\n" not in str(caught.value)


def days(folder, **held):
    path = folder / "days.npz"
    np.savez(path, **held)
    return path


def test_days_follow_each_other_in_their_zone(tmp_path):
    """The 30th of October 2022 has 25 hours in Berlin, the file 24 of them."""
    freq = np.round(50 + 0.01 * np.random.default_rng(1).standard_normal((3, 2880)), 4)
    names = np.array(["2022-10-29", "2022-10-30", "2022-10-31"])
    path = days(tmp_path, frequency=freq, day=names, step_s=30.0)
    reference = read_reference(path)
    np.testing.assert_array_equal(reference.freq_hz, freq.ravel())
    assert "days taken to begin at midnight UTC" in reference.notes
    local = read_reference(path, timezone="Europe/Berlin")
    assert local.t0_ns == reference.t0_ns - 2 * 3600 * 10**9
    assert local.freq_hz.size == 3 * 2880 + 120
    assert np.isnan(local.freq_hz[2 * 2880 : 2 * 2880 + 120]).all()
    np.testing.assert_array_equal(local.freq_hz[-2880:], freq[2])


def test_one_series_without_days(tmp_path):
    path = days(tmp_path, frequency=FREQ, step_s=2)
    reference = read_reference(path)
    assert (reference.t0_ns, reference.step_s) == (0, 2.0)
    np.testing.assert_array_equal(reference.freq_hz, FREQ)
    assert read_reference(path, step_s=1.0, start_utc_ns=T0_NS).end_ns == T0_NS + N * 10**9


@pytest.mark.parametrize(
    ("held", "says"),
    [
        ({"rows": FREQ, "frame_time_s": FREQ}, "it holds: rows, frame_time_s"),
        ({"frequency": FREQ}, "has no step_s"),
        ({"frequency": [FREQ, FREQ], "step_s": 1}, "2 rows and no names of their days"),
        ({"frequency": [FREQ, FREQ], "step_s": 1, "day": ["2022-01-01"]}, "day names no dates"),
        ({"frequency": [FREQ], "step_s": 1, "day": ["Monday"]}, "day names no dates"),
        ({"frequency": [FREQ], "step_s": 1, "day": [20220101]}, "day names no dates"),
        ({"frequency": [FREQ], "step_s": 1, "day": ["2622-01-01"]}, "day names no dates"),
        ({"frequency": [FREQ], "step_s": 1000, "day": ["2022-01-01"]}, "more than a day"),
        ({"frequency": FREQ, "step_s": np.nan}, "one in nan s"),
        ({"frequency": FREQ, "step_s": 1e-300}, "one in 1e-300 s"),
        ({"frequency": FREQ, "step_s": [1, 2]}, "has no step_s"),
        ({"frequency": ["fifty"], "step_s": 1}, "frequency holds <U5, not numbers"),
    ],
)
def test_archives_that_are_no_reference(tmp_path, held, says):
    with pytest.raises(ReferenceFormatError, match=says):
        read_reference(days(tmp_path, **{k: np.asarray(v) for k, v in held.items()}))


def test_what_is_no_archive(tmp_path):
    path = tmp_path / "x.npz"
    path.write_bytes(b"PK and no more")
    with pytest.raises(ReferenceFormatError, match=r"is no \.npz file"):
        read_reference(path)
    with zipfile.ZipFile(path, "w") as archive:  # NumPy gives back the bytes of such a part
        archive.writestr("frequency.npy", b"no array")
    with pytest.raises(ReferenceFormatError, match=r"is no \.npz file"):
        read_reference(path)


@pytest.mark.parametrize("text", [True, False])
def test_damaged_parquet_is_read_or_refused(tmp_path, text):
    rng = np.random.default_rng(5)
    freq = pa.array(50.0 + 0.01 * rng.standard_normal(400))
    times = pa.array((10**9 * np.arange(400) + 17 * 10**17).astype("datetime64[ns]"))
    columns = {"time": times, "freq_hz": freq.cast(pa.string()) if text else freq}
    whole = written(tmp_path, **columns).read_bytes()
    path, refused = tmp_path / "damaged.parquet", 0
    for _ in range(200):
        damaged = bytearray(whole)
        for at in rng.integers(0, len(whole), int(rng.choice([1, 2, 8]))):
            damaged[at] = rng.integers(256)
        path.write_bytes(damaged)
        try:
            read_reference(path)
        except RsenfError:
            refused += 1
    assert 20 < refused < 200


def test_times_beyond_nanoseconds(tmp_path):
    years = pa.array([10**13, 10**13 + 1, 10**13 + 2], pa.timestamp("s"))
    with pytest.raises(ReferenceFormatError, match="years 1677 to 2262"):
        read_reference(written(tmp_path, time=years, freq_hz=[50.0, 50.0, 50.0]))

"""What an import keeps, what it refuses, and what is left of one that was killed."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import asdict

import numpy as np
import pytest

from rsenf.errors import RecordingError, ReferenceFormatError, SchemaMismatch, UsageError
from rsenf.reference import open_reference
from rsenf.reference.store import all_series, facts, find_series
from rsenf.reference.store.sample_file import KEY, record_in
from rsenf.timebase import NO_ZONE
from tests.reference.reference_files import T0_NS, stamps, values, write_wav
from tests.reference.store_files import TODAY, S, bring, files_in, held, write_csv
from tests.reference.test_times import local_stamps

DAY = T0_NS // S


def test_where_an_import_comes_from_is_kept(tmp_path):
    path = write_csv(tmp_path / "grid.csv", DAY + np.delete(np.arange(50), 7), values(49))
    done = bring(tmp_path / "store", path, step_s=1.0, stamp="centre")
    (series,) = all_series(tmp_path / "store")
    (file,) = series.files
    assert file.record == done.record
    r = done.record
    assert (r.grid, r.name, r.size_bytes) == ("ce", "grid.csv", path.stat().st_size)
    assert (r.rows, r.samples, r.imported_utc) == (49, 49, TODAY)
    assert r.options == {
        "timezone": None, "step_s": 1.0, "column": None, "time_column": None, "time_format": None,
        "nominal_hz": None, "stamp": "centre", "assumed_hz": None, "start_utc_ns": 0,
    }  # fmt: skip
    assert files_in(tmp_path / "store") == [f"ce/1s/{r.sha256[:16]}.parquet"]


def test_gaps_duplicates_and_contradictions_are_told(tmp_path):
    store, freq = tmp_path / "store", np.full(100, 50.0)
    there = np.r_[0:20, 25:60, 70:100]
    bring(store, write_csv(tmp_path / "a.csv", DAY + there, freq[there]))
    again = np.arange(40, 64)
    bring(store, write_csv(tmp_path / "b.csv", DAY + again, freq[again] + 0.004))
    wrong = np.arange(50, 52)
    bring(store, write_csv(tmp_path / "c.csv", DAY + wrong, freq[wrong] + 0.3), step_s=1.0)
    (series,) = find_series(store, "ce")
    told = facts(series)
    assert (told.total, told.valid) == (100, 100 - 5 - 6 - 2)
    assert (told.repeated, told.contradicted, told.gaps) == (20, 2, 3)
    starts = [(gap.samples, gap.first - DAY) for gap in told.longest]
    assert starts == [(6, 64), (5, 20), (2, 50)]
    _, stored, readings = held(store)
    assert np.flatnonzero(np.isnan(stored)).tolist() == [*range(20, 25), 50, 51, *range(64, 70)]
    assert readings[[0, 22, 45, 50, 61, 66]].tolist() == [1, 0, 2, 3, 1, 0]
    assert stored[45] == 50.002
    assert told.mean_hz == pytest.approx(np.nanmean(stored), abs=1e-9)
    assert told.std_hz == pytest.approx(np.nanstd(stored), abs=1e-9)


def test_contradictions_at_the_ends_are_gaps_too(tmp_path):
    store, freq = tmp_path / "store", values(20)
    bring(store, write_csv(tmp_path / "a.csv", DAY + np.arange(20), freq))
    ends = [0, 1, 18, 19]
    bring(store, write_csv(tmp_path / "b.csv", DAY + np.array(ends), freq[ends] + 0.1), step_s=1)
    told = facts(*find_series(store, "ce"))
    assert (told.gaps, told.valid, told.contradicted) == (2, 16, 4)


def test_what_contradicts_itself_is_not_healed_by_what_comes_later(tmp_path):
    store = tmp_path / "store"
    for n, value in enumerate((50.0, 50.1, 50.05, 50.05)):
        freq = np.full(10 + n, 50.05)
        freq[4] = value
        bring(store, write_csv(tmp_path / f"{n}.csv", DAY + np.arange(10 + n), freq))
    assert np.flatnonzero(np.isnan(held(store)[1])).tolist() == [4]


def test_a_zone_that_is_unknown_stays_so_in_the_store(tmp_path):
    store = tmp_path / "store"
    for n, (end, options) in enumerate(
        [("Z", {}), ("", {"timezone": "UTC"}), ("", {}), ("+01:00", {})]
    ):
        path = tmp_path / f"{n}.csv"
        rows = [f"{t}{end},{f}" for t, f in zip(stamps(60), values(60), strict=True)]
        path.write_text("\n".join(["time,frequency", *rows]))
        done = bring(store, path, f"grid{n}", **options)
        assert done.record.zone_unknown == (n == 2)
        assert open_reference(f"store:grid{n}", store=store).zone_unknown == (n == 2)


def test_an_import_of_before_there_were_these_options(tmp_path):
    """Its record has no such options, nor a note of the zone."""
    path = tmp_path / "grid.csv"
    rows = [f"{t},{f}" for t, f in zip(stamps(60), values(60), strict=True)]
    path.write_text("\n".join(["time,frequency", *rows]))
    done = bring(tmp_path / "store", path)
    old = asdict(done.record)
    del old["options"]["time_format"], old["options"]["time_column"]
    old["notes"] = [line for line in old["notes"] if line != NO_ZONE]
    metadata = {KEY.encode(): json.dumps({"version": 1, **old}).encode()}
    read = record_in(metadata, done.path)
    assert read.options == done.record.options
    assert read.zone_unknown


def test_steps_and_grids_stand_side_by_side(tmp_path):
    store = tmp_path / "store"
    for step_ms in (100, 1000, 2000):
        rows = [f"{t},{f}" for t, f in zip(stamps(60, step_ms), values(60), strict=True)]
        path = tmp_path / f"{step_ms}.csv"
        path.write_text("\n".join(["time,frequency", *rows]))
        bring(store, path)
    bring(store, write_csv(tmp_path / "us.csv", DAY + np.arange(30), values(30) + 10), grid="us")
    assert [s.name for s in all_series(store)] == ["ce@0.1", "ce@1", "ce@2", "us@1"]
    assert [s.nominal_hz for s in all_series(store)] == [50, 50, 50, 60]
    for name, step_s in (("ce", 0.1), ("ce@1", 1), ("ce@2s", 2), ("ce@0.1", 0.1)):
        reference = open_reference(f"store:{name}", store=store)
        assert reference.step_s == step_s
        np.testing.assert_array_equal(np.asarray(reference.freq_hz), values(60))
        assert any("there is also ce@1, ce@2" in note for note in reference.notes) == (name == "ce")


def test_local_times_through_an_autumn(tmp_path):
    """01:00 UTC on 30 October 2022 in two files, cut in the hour that comes twice."""
    times = local_stamps("2022-10-30 00:00:00", 3 * 3600)
    freq = values(len(times))
    for n, part in enumerate((slice(0, 5000), slice(4000, None))):
        rows = [f"{t},{f}" for t, f in zip(times[part], freq[part], strict=True)]
        path = tmp_path / f"{n}.csv"
        path.write_text("\n".join(["time,frequency", *rows]))
        bring(tmp_path / "store", path, timezone="Europe/Berlin")
    t_ns, stored, readings = held(tmp_path / "store")
    start = int(np.datetime64("2022-10-30T00:00:00", "ns").astype(np.int64))
    np.testing.assert_array_equal(t_ns, start + S * np.arange(len(times)))
    np.testing.assert_array_equal(stored, freq)
    assert (readings[4000:5000] == 2).all()
    assert readings.sum() == len(times) + 1000


def test_jitter_and_half_steps(tmp_path):
    store, rng = tmp_path / "store", np.random.default_rng(2)
    freq = values(200)
    at_ns = T0_NS + S * np.arange(200) + rng.integers(-S // 5, S // 5, 200)
    rows = [f"{np.datetime64(int(t), 'ns')},{f}" for t, f in zip(at_ns, freq, strict=True)]
    path = tmp_path / "jitter.csv"
    path.write_text("\n".join(["time,frequency", *rows]))
    bring(store, write_csv(tmp_path / "a.csv", DAY + np.arange(100), freq[:100]))
    done = bring(store, path, step_s=1.0)
    assert any("taken for the nearest sample" in note for note in done.record.notes)
    t_ns, stored, readings = held(store)
    assert t_ns[0] == T0_NS
    np.testing.assert_array_equal(stored, freq)
    assert readings.tolist() == [2] * 100 + [1] * 100
    late = write_csv(tmp_path / "late.csv", DAY + np.arange(300, 400), values(100))
    with pytest.raises(UsageError, match=r"begin -0\.5 s off those that ce has") as caught:
        bring(store, late, stamp="centre")
    assert "--stamp" in caught.value.hint
    bring(store, late, grid="centred", stamp="centre")
    assert held(store, "centred")[0][0] == T0_NS + 300 * S - S // 2


def test_files_without_dates_need_a_start(tmp_path):
    path = tmp_path / "values.csv"
    path.write_text("\n".join(f"{f:.4f}" for f in values(50)))
    with pytest.raises(ReferenceFormatError, match="tells no dates") as caught:
        bring(tmp_path / "store", path, step_s=1.0)
    assert "--start" in caught.value.hint
    assert not (tmp_path / "store").exists()
    bring(tmp_path / "store", path, step_s=1.0, start_utc_ns=T0_NS)
    mains = np.cos(2 * np.pi * 50 * np.arange(400 * 30) / 400)
    bring(tmp_path / "store", write_wav(tmp_path / "x.wav", mains, 400), "wav", start_utc_ns=T0_NS)
    for grid in ("ce", "wav"):
        assert held(tmp_path / "store", grid)[0][0] == T0_NS


def test_what_does_not_fit_is_refused(tmp_path):
    store = tmp_path / "store"
    path = write_csv(tmp_path / "a.csv", DAY + np.arange(50), values(50))
    bring(store, path)
    before = files_in(store)
    with pytest.raises(UsageError, match="in ce already, read with other options") as caught:
        bring(store, path, stamp="centre")
    assert before[0] in caught.value.hint
    other = write_csv(tmp_path / "us.csv", DAY + np.arange(50), values(50) + 10)
    with pytest.raises(UsageError, match=r"us\.csv is of a 60 Hz grid, ce of one of 50 Hz"):
        bring(store, other)
    for name in ("../ce", "", ".ce", "c/e", "ce@1", "x" * 65):
        with pytest.raises(UsageError, match="no name for a grid"):
            bring(store, path, grid=name)
    with pytest.raises(UsageError, match="is no folder"):
        bring(path, other)
    assert files_in(store) == before


def test_an_import_that_fails_leaves_nothing(tmp_path):
    path = write_csv(tmp_path / "a.csv", DAY + np.arange(50), values(50))
    path.write_text(path.read_text().replace("2022-09-17T00:00:40", "1922-09-17T00:00:40"))
    with pytest.raises(ReferenceFormatError, match="50 values span 36525 days"):
        bring(tmp_path / "store", path)
    assert list((tmp_path / "store").rglob("*")) == []


def test_a_store_that_cannot_be_written(tmp_path):
    path = write_csv(tmp_path / "a.csv", DAY + np.arange(50), values(50))
    (tmp_path / "store").mkdir()
    (tmp_path / "store" / "ce").write_text("a file where a folder should be")
    with pytest.raises(RecordingError, match=r"can't write to .*1s: Not a directory"):
        bring(tmp_path / "store", path)


KILLED = """
import os, signal, sys
from pathlib import Path
from rsenf.reference.store.sample_file import SampleWriter
from tests.reference.store_files import bring

def die(*_):
    os.kill(os.getpid(), signal.SIGKILL)

SampleWriter.finish = die
bring(Path(sys.argv[1]), Path(sys.argv[2]))
"""


def test_a_killed_import_leaves_the_store_as_it_was(tmp_path):
    store = tmp_path / "store"
    bring(store, write_csv(tmp_path / "a.csv", DAY + np.arange(50), values(50)))
    kept, before = files_in(store), held(store)
    more = write_csv(tmp_path / "b.csv", DAY + np.arange(30, 90), values(60))
    done = subprocess.run(
        [sys.executable, "-c", KILLED, store, more], check=False, capture_output=True
    )
    assert done.returncode == -9, done.stderr
    (left_over,) = set(files_in(store)) - set(kept)
    assert left_over.startswith("ce/1s/.")
    for one, other in zip(held(store), before, strict=True):
        np.testing.assert_array_equal(one, other)
    assert bring(store, more).new
    assert len(files_in(store)) == 2
    assert left_over not in files_in(store)
    assert held(store)[2].tolist() == [1] * 30 + [2] * 20 + [1] * 40


def test_a_file_of_another_version(tmp_path, monkeypatch):
    store = tmp_path / "store"
    monkeypatch.setattr("rsenf.reference.store.sample_file.VERSION", 2)
    bring(store, write_csv(tmp_path / "a.csv", DAY + np.arange(50), values(50)))
    monkeypatch.undo()
    with pytest.raises(SchemaMismatch, match="version 2 of the store's format, not 1"):
        open_reference("store:ce", store=store)


def test_files_that_do_not_belong_there(tmp_path):
    store = tmp_path / "store"
    done = bring(store, write_csv(tmp_path / "a.csv", DAY + np.arange(50), values(50)))
    whole = done.path.read_bytes()
    done.path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ReferenceFormatError, match="can't be read"):
        all_series(store)
    done.path.write_bytes(whole)
    import pyarrow as pa
    from pyarrow import parquet

    stray = done.path.with_name("stray.parquet")
    parquet.write_table(pa.table({"x": [1]}), stray)
    with pytest.raises(ReferenceFormatError, match=r"stray\.parquet is not of the store"):
        all_series(store)
    us = bring(store, write_csv(tmp_path / "us.csv", DAY + np.arange(9), values(9) + 10), "us")
    stray.write_bytes(us.path.read_bytes())
    with pytest.raises(ReferenceFormatError, match="another series than"):
        all_series(store)


def test_damage_inside_a_file_is_one_line(tmp_path):
    store = tmp_path / "store"
    done = bring(store, write_csv(tmp_path / "a.csv", DAY + np.arange(5000), values(5000)))
    raw = bytearray(done.path.read_bytes())
    raw[200:900] = bytes(700)
    done.path.write_bytes(raw)
    reference = open_reference("store:ce", store=store)
    with pytest.raises(ReferenceFormatError, match=r"\.parquet can't be read: "):
        reference.freq_hz[:10]


def test_a_damaged_file_is_read_or_refused(tmp_path):
    """Also where the damage is in what the file tells of itself."""
    store, rng, refused = tmp_path / "store", np.random.default_rng(5), []
    done = bring(store, write_csv(tmp_path / "a.csv", DAY + np.arange(50), values(50)))
    whole = done.path.read_bytes()
    for _ in range(200):
        raw = bytearray(whole)
        for at in rng.integers(0, len(whole), int(rng.choice([1, 2, 8]))):
            raw[at] = rng.integers(256)
        done.path.write_bytes(raw)
        try:
            assert open_reference("store:ce", store=store).freq_hz[:].size
        except (ReferenceFormatError, UsageError, SchemaMismatch) as exc:
            refused.append(str(exc))
    assert len(refused) > 100
    assert not [line for line in refused if "\n" in line]


def test_a_column_of_another_type_than_the_schema_says(tmp_path):
    """Arrow ends the process (C++ ``terminate``) when such a column's statistics are read."""
    done = bring(tmp_path / "store", write_csv(tmp_path / "a.csv", DAY + np.arange(50), values(50)))
    whole = done.path.read_bytes()
    int64_column, bool_column = b"\x15\x04\x19\x25", b"\x15\x00\x19\x25"  # Thrift: type, encodings
    assert int64_column in whole
    done.path.write_bytes(whole.replace(int64_column, bool_column, 1))
    with pytest.raises(ReferenceFormatError, match="another type in column"):
        held(tmp_path / "store")


def test_a_day_without_any_reading_is_a_gap(tmp_path):
    freq_hz = np.full((3, 86_400), 50.0)
    freq_hz[1] = np.nan
    days = ["2024-01-01", "2024-01-02", "2024-01-03"]
    np.savez(path := tmp_path / "days.npz", frequency=freq_hz, day=days)
    assert bring(tmp_path / "store", path, step_s=1.0).record.samples == 2 * 86_400


def test_a_file_without_a_usable_day_holds_no_values(tmp_path):
    np.savez(path := tmp_path / "days.npz", frequency=np.zeros((1, 24)), day=["2018-11-04"])
    with pytest.raises(ReferenceFormatError):
        bring(tmp_path / "store", path, step_s=3600.0, timezone="America/Sao_Paulo")

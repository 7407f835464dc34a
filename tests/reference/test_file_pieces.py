"""A file read in pieces is the file: however it is cut, and whichever way its lines are split."""

from __future__ import annotations

import gzip

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rsenf.errors import UsageError
from rsenf.reference import read_reference, table
from rsenf.reference.local_time import settled
from rsenf.reference.table import Layout
from tests.reference.reference_files import T0_NS, read_rows, read_text, stamps, values
from tests.reference.test_times import local_stamps


def same(one, other):
    np.testing.assert_array_equal(one.freq_hz, other.freq_hz)
    np.testing.assert_array_equal(one.readings, other.readings)
    assert (one.t0_ns, one.step_s, one.notes) == (other.t0_ns, other.step_s, other.notes)


def whole_and_cut(monkeypatch, folder, text, chars, name="grid.csv", **options):
    monkeypatch.setattr("rsenf.reference.readings.HEAD_VALUES", 3)
    whole = read_text(folder, text, name, **options)
    monkeypatch.setattr("rsenf.reference.table.BLOCK_CHARS", chars)
    return whole, read_text(folder, text, name, **options)


@pytest.mark.parametrize("chars", [40, 171, 1000, 9000])
def test_pieces_are_the_whole(tmp_path, monkeypatch, chars):
    times, freq = stamps(300), [f"{f:.4f}" for f in values(300)]
    freq[3], freq[77], freq[205] = "n/a", "", "999"
    rows = [f"{t},{f}" for t, f in zip(times, freq, strict=True)]
    rows[120] = "yesterday,50"
    del rows[200:230]
    rows[60:60] = ["", "# a remark", "  "]
    rows.append(rows[10])
    text = "\n".join(["time,frequency", *rows]) + "\n"
    same(*whole_and_cut(monkeypatch, tmp_path, text, chars))


@pytest.mark.parametrize("chars", [1, 60, 500])
def test_values_alone_in_pieces(tmp_path, monkeypatch, chars):
    text = "Hz\n" + "\n".join(f"{f:.4f}" for f in values(300))
    same(*whole_and_cut(monkeypatch, tmp_path, text, chars, step_s=0.1, start_utc_ns=T0_NS))


@pytest.mark.parametrize("chars", [200, 4000, 60_000])
@pytest.mark.parametrize(
    ("start", "seconds"),
    [
        ("2022-10-29 23:00:00", 4 * 3600),
        ("2022-10-30 00:30:00", 3 * 3600),
        ("2022-10-29 23:00:00", 6000),  # ends in the first of the two hours
        ("2022-10-30 01:10:00", 3 * 3600),  # begins in the second
    ],
)
def test_a_repeated_hour_cut_anywhere(tmp_path, monkeypatch, chars, start, seconds):
    times = local_stamps(start, seconds, 10)
    rows = [f"{t},{f}" for t, f in zip(times, values(len(times)), strict=True)]
    text = "\n".join(["time,frequency", *rows])
    whole, cut = whole_and_cut(monkeypatch, tmp_path, text, chars, timezone="Europe/Berlin")
    same(whole, cut)
    assert (whole.gaps, whole.freq_hz.size) == (0, len(times))


@settings(max_examples=30, deadline=None)
@given(end=st.integers(1, 5 * 360))
def test_what_is_settled_stays(end):
    """Times that are settled mean the same with or without what follows."""
    from rsenf.reference.local_time import to_utc
    from rsenf.reference.reference import Notes

    cells = local_stamps("2022-10-29 23:00:00", 5 * 3600, 10)
    local = np.array(cells, "datetime64[ns]").astype(np.int64)
    utc, _ = to_utc(local, "Europe/Berlin", Notes())
    done = settled(local[:end], "Europe/Berlin")
    part, known = to_utc(local[:done], "Europe/Berlin", Notes())
    np.testing.assert_array_equal(part, utc[:done])
    assert known.all()
    assert end - done <= 2 * 360 + 1


def test_gzip_in_pieces(tmp_path, monkeypatch):
    rows = [f"{t},{f}" for t, f in zip(stamps(300), values(300), strict=True)]
    text = "\n".join(["time,frequency", *rows])
    whole = read_text(tmp_path, text)
    monkeypatch.setattr("rsenf.reference.table.BLOCK_CHARS", 100)
    path = tmp_path / "other.csv.gz"
    path.write_bytes(gzip.compress(text.encode()))
    same(whole, read_reference(path))


CELL = st.text("0123456789.-: ,;Zn/a\t", max_size=12).map(lambda t: t.replace(";", ""))


@settings(max_examples=60, deadline=None)
@given(rows=st.lists(st.lists(CELL, min_size=1, max_size=4), min_size=1, max_size=8))
def test_both_ways_of_splitting_agree(rows):
    """Where the fast one gives an answer at all, it is that of the other."""
    layout = Layout(";", 3, frequency=2, time=0, date=1)
    text = "\n".join(";".join(row) for row in rows) + "\n"
    fast = table._split_plain(text, layout, [0, 1, 2])
    slow = table._split_any(text, layout, [0, 1, 2], "grid.csv")
    if fast is not None:
        for i in range(3):
            assert [c.strip() for c in fast[i].to_pylist()] == [
                c.strip() for c in slow[i].to_pylist()
            ]


def test_plain_lines_are_split_the_fast_way():
    layout = Layout(",", 2, frequency=1, time=0)
    cells = table._split_plain("2022-01-01 00:00:00,50.1\nx,y\n", layout, [0, 1])
    assert cells is not None
    assert cells[1].equals(pa.array(["50.1", "y"]))


@pytest.mark.parametrize(
    "text", ['"a",1\n', "a,1\n# x,2\n", "a\n", "a,1,2\n", "a,1\n   \n", ""], ids=repr
)
def test_other_lines_are_left_to_the_careful_way(text):
    assert table._split_plain(text, Layout(",", 2, frequency=1, time=0), [0, 1]) is None


def test_an_unknown_zone_is_refused_even_where_times_have_their_own(tmp_path):
    rows = [f"{t}Z,{f}" for t, f in zip(stamps(50), values(50), strict=True)]
    with pytest.raises(UsageError, match="no time zone 'Mars/Base'"):
        read_rows(tmp_path, rows, timezone="Mars/Base")


@pytest.mark.parametrize("suffixes", [["Z", "+00:00", "UTC", ""], [" +02:00", "-0500", "+02"]])
def test_zones_that_change_from_row_to_row(tmp_path, suffixes):
    hours = {"Z": 0, "+00:00": 0, "UTC": 0, "": 0, " +02:00": 2, "-0500": -5, "+02": 2}
    freq = values(48)
    rows = []
    for i, f in enumerate(freq):
        suffix = suffixes[i % len(suffixes)]
        local = np.datetime64(T0_NS, "ns") + np.timedelta64(hours[suffix] * 3600 + i, "s")
        rows.append(f"{str(local)[:19]}{suffix},{f}")
    reference = read_rows(tmp_path, rows)
    assert reference.t0_ns == T0_NS
    np.testing.assert_array_equal(reference.freq_hz, freq)

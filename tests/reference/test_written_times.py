"""Times as spreadsheets write them: day or month first, half days, and what can't be told."""

from __future__ import annotations

import numpy as np
import pytest

from rsenf.errors import ReferenceFormatError, UsageError
from rsenf.reference import read_reference, table
from tests.reference.reference_files import read_rows, read_stamped, read_text, values

N = 120


def utc_ns(moment):
    return int(np.datetime64(moment, "ns").astype(np.int64))


def written(start, form, count=N, step_s=1):
    """Times from a start on, by a format of strftime."""
    times = np.datetime64(start, "s") + np.arange(count) * np.timedelta64(step_s, "s")
    return [t.astype(object).strftime(form) for t in times]


@pytest.mark.parametrize(
    "form",
    [
        "%d.%m.%Y %H:%M:%S",
        "%d/%m/%Y %H:%M:%S",
        "%d-%m-%Y %H:%M:%S",
        "%d/%m/%Y %H:%M:%S.5",
        "%d/%m/%Y, %H:%M:%S",
        "%m/%d/%Y %I:%M:%S %p",
        "%m/%d/%Y %I:%M:%S%p",
        "%Y-%m-%d %I:%M:%S %p",
        "%Y/%m/%d %H:%M:%S",
        "%Y.%m.%d %H:%M:%S",
        "%d.%m.%Y %H:%M:%S +00:00",
        "%m/%d/%Y %I:%M:%S %p UTC",
    ],
)
def test_a_day_above_12_tells_the_format(tmp_path, form):
    times = [f'"{t}"' for t in written("2026-01-15T12:59:30", form)]
    reference = read_stamped(tmp_path, times, values(N))
    half_ns = 500_000_000 * form.endswith(".5")
    assert reference.t0_ns == utc_ns("2026-01-15T12:59:30") + half_ns
    np.testing.assert_array_equal(reference.freq_hz, values(N))


def test_minutes_without_seconds_and_hours_of_one_digit(tmp_path):
    times = [f"01/15/2026 {8 + i // 60}:{i % 60:02} AM" for i in range(N)]
    reference = read_stamped(tmp_path, times, values(N))
    assert (reference.t0_ns, reference.step_s) == (utc_ns("2026-01-15T08:00:00"), 60.0)


@pytest.mark.parametrize("form", ["%d/%m/%Y %H:%M:%S", "%m/%d/%Y %I:%M:%S %p"])
def test_what_may_be_day_or_month_is_asked_for(tmp_path, form):
    times = written("2026-03-05T08:00:00", form)
    with pytest.raises(
        ReferenceFormatError, match="day or month first: give --time-format"
    ) as told:
        read_stamped(tmp_path, times, values(N))
    assert f"'{form}'" in told.value.message  # ready to copy
    reference = read_stamped(tmp_path, times, values(N), time_format=form)
    assert reference.t0_ns == utc_ns("2026-03-05T08:00:00")


@pytest.mark.parametrize("form", ["%d/%m/%Y %H:%M:%S", "%m/%d/%Y %H:%M:%S"])
def test_a_midnight_tells_day_from_month(tmp_path, form):
    reference = read_stamped(tmp_path, written("2026-03-05T23:59:00", form), values(N))
    assert reference.t0_ns == utc_ns("2026-03-05T23:59:00")
    assert reference.freq_hz.size == N


def test_dots_put_the_day_first(tmp_path):
    times = written("2026-03-05T08:00:00", "%d.%m.%Y %H:%M:%S")
    reference = read_stamped(tmp_path, times, values(N))
    assert reference.t0_ns == utc_ns("2026-03-05T08:00:00")
    assert "times read as %d.%m.%Y %H:%M:%S" in reference.notes


def test_the_whole_file_is_looked_at_before_it_is_refused(tmp_path, monkeypatch):
    """Only the last of many pieces tells that the day comes first."""
    monkeypatch.setattr(table, "BLOCK_CHARS", 400)
    times = written("2026-03-05T23:58:10", "%d/%m/%Y %H:%M:%S")
    reference = read_stamped(tmp_path, times, values(N))
    assert reference.t0_ns == utc_ns("2026-03-05T23:58:10")
    np.testing.assert_array_equal(reference.freq_hz, values(N))


def test_years_of_two_digits_need_a_format(tmp_path):
    times = written("2026-01-15T08:00:00", "%y/%m/%d %H:%M:%S")
    with pytest.raises(ReferenceFormatError, match="is no time") as told:
        read_stamped(tmp_path, times, values(N))
    assert "--time-format" in told.value.hint
    reference = read_stamped(tmp_path, times, values(N), time_format="%y/%m/%d %H:%M:%S")
    assert reference.t0_ns == utc_ns("2026-01-15T08:00:00")


@pytest.mark.parametrize("form", ["%Y%m%d%H%M%S", "%d %b %Y, %H:%M:%S.%f", "%d/%m/%Y %H:%M:%S%z"])
def test_any_format_can_be_told(tmp_path, form):
    times = written("2026-01-05T08:00:00", form.replace("%f", "250").replace("%z", "+01:00"))
    rows = [f'"{t}",{f}' for t, f in zip(times, values(N), strict=True)]
    reference = read_rows(tmp_path, rows, time_format=form)
    off_ns = 250_000_000 * ("%f" in form) - 3600 * 10**9 * ("%z" in form)
    assert reference.t0_ns == utc_ns("2026-01-05T08:00:00") + off_ns


@pytest.mark.parametrize("form", ["dd.mm.yyyy", "%H:%M:%S", "%Q", "%d.%m %H:%M"])
def test_a_format_that_tells_no_day_is_refused(tmp_path, form):
    with pytest.raises(UsageError, match="no format of times"):
        read_stamped(
            tmp_path, written("2026-01-15", "%d.%m.%Y %H:%M:%S"), values(N), time_format=form
        )


TIMES = written("2026-01-15T08:00:00", "%d.%m.%Y %H:%M:%S")
PAIRS = list(zip(TIMES, values(N), strict=True))


@pytest.mark.parametrize(
    ("lines", "options"),
    [
        (["sep=;", "time;Hz", *(f"{t};{f}" for t, f in PAIRS)], {}),
        (['"sep=;"', "time;Hz", *(f"{t};{f}".replace(".", ",") for t, f in PAIRS)], None),
        (["SEP=|", "time|Hz", *(f"{t}|{f}" for t, f in PAIRS)], {}),
        (["sep=;", *(f"{t};{f}" for t, f in PAIRS)], {}),
        (["Zeit;Netz", *(f"{t};{f}" for t, f in PAIRS)], {"column": "Netz"}),
        (["Netz;Zeit", *(f"{f};{t}" for t, f in PAIRS)], {"column": "netz"}),
        (
            ["Messwert;Nr;Stempel", *(f"{f};{i};{t}" for i, (t, f) in enumerate(PAIRS))],
            {"column": "Messwert"},
        ),
        (
            ["Datum;Uhrzeit;Netz", *(f"{t[:10]};{t[11:]};{f}" for t, f in PAIRS)],
            {"column": "Netz"},
        ),
        (
            ["time;Zeit;Hz", *(f"{i};{t};{f}" for i, (t, f) in enumerate(PAIRS))],
            {"time_column": "Zeit"},
        ),
        (["Sekunde;Hz", *(f"{1768464000 + i};{f}" for i, (_, f) in enumerate(PAIRS))], {}),
    ],
)
def test_columns_are_found_whatever_they_are_called(tmp_path, lines, options):
    if options is None:  # decimal commas
        lines, options = [line.replace(",2026", ".2026") for line in lines], {}
        lines = [line.replace("15,01", "15.01") for line in lines]
    reference = read_text(tmp_path, "\n".join(lines) + "\n", **options)
    assert reference.t0_ns == utc_ns("2026-01-15T08:00:00")
    np.testing.assert_array_equal(reference.freq_hz, values(N))


def test_a_time_column_that_is_not_there(tmp_path):
    with pytest.raises(ReferenceFormatError, match="no column 'Zeit' in"):
        read_stamped(tmp_path, TIMES, values(N), time_column="Zeit")


def test_a_year_of_ordinary_times_is_as_it_was(tmp_path):
    path = tmp_path / "grid.csv"
    path.write_text("time,Hz\n2026-01-15 08:00:00,50.0\nn/a,50.0\n2026-01-15 08:00:02.5,50.1\n")
    reference = read_reference(path, step_s=0.5)
    assert reference.t0_ns == utc_ns("2026-01-15T08:00:00")
    assert any("without a time that can be used, left out: 1" in line for line in reference.notes)


@pytest.mark.parametrize("day", ["31.02.2026", "30.02.2026", "29.02.2025", "31.04.2026"])
def test_a_day_that_no_month_has_is_no_time(tmp_path, day):
    times = [f"{day} 08:{i // 60:02}:{i % 60:02}" for i in range(N)]
    with pytest.raises(ReferenceFormatError, match="is no time"):
        read_stamped(tmp_path, times, values(N))
    with pytest.raises(ReferenceFormatError, match="is no time"):
        read_stamped(tmp_path, times, values(N), time_format="%d.%m.%Y %H:%M:%S")

"""Time zones, and the hours that daylight saving skips and repeats."""

from __future__ import annotations

from datetime import datetime, timedelta
from zoneinfo import ZoneInfo

import numpy as np
import pyarrow as pa
import pytest

from rsenf.errors import UsageError
from rsenf.reference.reference import Notes
from rsenf.reference.times import TimeReader
from tests.reference.reference_files import T0_NS, read_stamped, stamps, values

BERLIN = ZoneInfo("Europe/Berlin")


def local_stamps(start_utc, seconds, step=1, zone=BERLIN):
    """Wall-clock times of a logger that runs straight through, as it writes them."""
    utc = datetime.fromisoformat(start_utc + "+00:00")
    times = (utc + timedelta(seconds=s) for s in range(0, seconds, step))
    return [t.astimezone(zone).strftime("%Y-%m-%d %H:%M:%S") for t in times]


def utc_ns(text):
    return int(np.datetime64(text, "ns").astype(np.int64))


@pytest.mark.parametrize(
    ("zone", "hours"), [("Europe/Berlin", 2), ("UTC", 0), ("America/New_York", -4)]
)
def test_local_times_become_utc(tmp_path, zone, hours):
    reference = read_stamped(tmp_path, stamps(50), values(50), timezone=zone)
    assert reference.t0_ns == T0_NS - hours * 3_600_000_000_000
    assert f"times without a zone taken as {zone}" in reference.notes


def test_without_a_zone_it_is_utc_and_said(tmp_path):
    reference = read_stamped(tmp_path, stamps(50), values(50))
    assert reference.t0_ns == T0_NS
    assert "times without a zone taken as UTC" in reference.notes


@pytest.mark.parametrize("suffix", ["+02:00", "+0200", "+02", " +02:00"])
def test_a_time_s_own_zone_wins(tmp_path, suffix):
    times = [t + suffix for t in stamps(50)]
    reference = read_stamped(tmp_path, times, values(50), timezone="America/New_York")
    assert reference.t0_ns == T0_NS - 2 * 3_600_000_000_000
    assert not any("without a zone" in note for note in reference.notes)


def test_an_unknown_zone_is_refused(tmp_path):
    with pytest.raises(UsageError, match="Mars/Base"):
        read_stamped(tmp_path, stamps(50), values(50), timezone="Mars/Base")


def test_a_logger_running_through_autumn_loses_nothing(tmp_path):
    """Clocks go back at 01:00 UTC on 30 October 2022: 02:00 to 03:00 comes twice."""
    times = local_stamps("2022-10-30 00:30:00", 5 * 3600, 10)
    freq = values(len(times))
    reference = read_stamped(tmp_path, times, freq, timezone="Europe/Berlin")
    assert reference.t0_ns == utc_ns("2022-10-30T00:30:00")
    np.testing.assert_array_equal(reference.freq_hz, freq)


def test_a_logger_running_through_spring_loses_nothing(tmp_path):
    times = local_stamps("2022-03-27 00:30:00", 3 * 3600, 10)
    freq = values(len(times))
    reference = read_stamped(tmp_path, times, freq, timezone="Europe/Berlin")
    assert reference.t0_ns == utc_ns("2022-03-27T00:30:00")
    np.testing.assert_array_equal(reference.freq_hz, freq)


@pytest.mark.parametrize(
    ("first", "last", "expected"),
    [
        # Begins in the repeated hour and runs on into the day: the second pass.
        (90 * 60, 5 * 3600, "2022-10-30T01:00:00"),
        # Begins before and ends in the repeated hour: the first.
        (0, 80 * 60, "2022-10-29T23:30:00"),
    ],
)
def test_half_of_a_repeated_hour_goes_to_the_side_it_touches(tmp_path, first, last, expected):
    times = local_stamps("2022-10-29 23:30:00", 6 * 3600)[first:last:10]
    reference = read_stamped(tmp_path, times, values(len(times)), timezone="Europe/Berlin")
    assert reference.t0_ns == utc_ns(expected)
    assert reference.gaps == 0


def test_a_repeated_hour_written_once_is_left_out(tmp_path):
    """Without the jump back nobody can tell which of the two hours is missing."""
    wall = np.datetime64("2022-10-30T01:30:00") + np.arange(0, 3 * 3600, 10)
    times = [str(t).replace("T", " ") for t in wall]
    reference = read_stamped(tmp_path, times, values(len(times)), timezone="Europe/Berlin")
    assert any("come twice in Europe/Berlin, left out: 360" in note for note in reference.notes)
    assert reference.gaps == 1
    assert reference.valid_samples == len(times) - 360


def test_times_that_do_not_exist_are_left_out(tmp_path):
    wall = np.datetime64("2022-03-27T01:30:00") + np.arange(0, 3 * 3600, 10)
    times = [str(t).replace("T", " ") for t in wall]
    reference = read_stamped(tmp_path, times, values(len(times)), timezone="Europe/Berlin")
    assert any("don't exist in Europe/Berlin, left out: 360" in note for note in reference.notes)
    assert reference.valid_samples == len(times) - 360


def test_every_second_of_a_year_of_changes_agrees_with_the_standard_library():
    zone = ZoneInfo("Australia/Lord_Howe")  # shifts by half an hour
    utc = datetime.fromisoformat("2022-01-01 00:00:00+00:00")
    moments = [utc + timedelta(minutes=10 * i) for i in range(6 * 24 * 365)]
    cells = [m.astimezone(zone).strftime("%Y-%m-%d %H:%M:%S") for m in moments]
    times = TimeReader("x", "Australia/Lord_Howe", Notes()).read(pa.array(cells))
    assert times.ok.all()
    expected = utc_ns("2022-01-01") + 600_000_000_000 * np.arange(len(cells))
    np.testing.assert_array_equal(times.t_ns, expected)


def test_milliseconds_and_microseconds_are_exact(tmp_path):
    for factor, text in ((10**3, "{}"), (10**6, "{}"), (10**9, "{}")):
        cells = [text.format((T0_NS // 10**9 + i) * factor) for i in range(20)]
        reference = read_stamped(tmp_path, cells, values(20))
        assert reference.t0_ns == T0_NS
        assert reference.step_s == 1.0


def test_a_mistyped_century_is_a_gap_and_no_other_time(tmp_path):
    times = stamps(60)
    times[10] = "2608" + times[10][4:]
    reference = read_stamped(tmp_path, times, values(60))
    assert np.flatnonzero(np.isnan(reference.freq_hz)).tolist() == [10]

"""Times without a zone that jump as daylight saving does are refused, others aren't."""

from __future__ import annotations

from zoneinfo import ZoneInfo

import numpy as np
import pytest

from rsenf.errors import ReferenceFormatError
from rsenf.reference import reference_blocks, table
from rsenf.timebase import NO_ZONE
from tests.reference.joined import joined
from tests.reference.reference_files import read_rows, read_stamped, stamps, values
from tests.reference.test_times import local_stamps

SPRING, AUTUMN = "2026-03-29 00:00:00", "2025-10-25 23:00:00"  # 2 h before in Berlin


@pytest.mark.parametrize(
    ("start", "zone", "step", "says"),
    [
        (SPRING, "Europe/Berlin", 1, "the hour from 2026-03-29 02:00 is skipped"),
        (SPRING, "Europe/Berlin", 10, "the hour from 2026-03-29 02:00 is skipped"),
        (SPRING, "Europe/Berlin", 900, "the hour from 2026-03-29 02:00 is skipped"),
        (SPRING, "Europe/London", 1, "the hour from 2026-03-29 01:00 is skipped"),
        (AUTUMN, "Europe/Berlin", 1, "the hour from 2025-10-26 02:00 is repeated"),
        (AUTUMN, "Europe/Berlin", 60, "the hour from 2025-10-26 02:00 is repeated"),
        ("2026-03-08 06:00:00", "America/New_York", 1, "2026-03-08 02:00 is skipped"),
        ("2026-11-01 04:00:00", "America/New_York", 1, "2026-11-01 01:00 is repeated"),
        ("2026-10-03 15:00:00", "Australia/Sydney", 1, "2026-10-04 02:00 is skipped"),
    ],
)
def test_a_night_of_daylight_saving_is_refused_without_a_zone(tmp_path, start, zone, step, says):
    times = local_stamps(start, 4 * 3600, step, ZoneInfo(zone))
    with pytest.raises(ReferenceFormatError, match=says) as told:
        read_stamped(tmp_path, times, values(len(times)))
    assert "give --timezone" in told.value.message
    assert zone in told.value.hint
    reference = read_stamped(tmp_path, times, values(len(times)), timezone=zone)
    np.testing.assert_array_equal(reference.freq_hz, values(len(times)))


def test_the_newest_first_a_sorted_file_and_one_with_holes_are_refused_too(tmp_path):
    for start in (SPRING, AUTUMN):
        times = local_stamps(start, 4 * 3600)
        holed = [t for i, t in enumerate(times) if i < 7180 or i > 7220]
        for one in (times[::-1], holed, sorted(times)):
            with pytest.raises(ReferenceFormatError, match="daylight saving"):
                read_stamped(tmp_path, one, values(len(one)))


def test_a_jump_between_pieces_is_seen(tmp_path, monkeypatch):
    times = local_stamps(SPRING, 4 * 3600, 10)
    line = len(f"{times[0]},50.0000\n")
    for chars in (720 * line, 721 * line, 719 * line):
        monkeypatch.setattr(table, "BLOCK_CHARS", chars)
        with pytest.raises(ReferenceFormatError, match="daylight saving"):
            read_rows(tmp_path, [f"{t},50.0000" for t in times])


@pytest.mark.parametrize(
    "missing",
    [
        ("2026-03-29 11:00:00", "2026-03-29 12:00:00"),  # not an hour that is skipped anywhere
        ("2026-02-11 02:00:00", "2026-02-11 03:00:00"),  # nor a day
        ("2026-03-29 02:15:00", "2026-03-29 03:15:00"),  # nor with a minute
        ("2026-03-29 02:00:00", "2026-03-29 05:00:00"),  # longer
    ],
)
def test_other_missing_hours_are_gaps(tmp_path, missing):
    day = np.datetime64(missing[0][:10]) + np.arange(0, 86400, 10).astype("timedelta64[s]")
    times = [str(t).replace("T", " ") for t in day]
    times = [t for t in times if not missing[0] <= t < missing[1]]
    reference = read_stamped(tmp_path, times, values(len(times)))
    assert reference.gaps == 1


def test_utc_through_the_same_nights_is_read(tmp_path):
    for start in (SPRING, AUTUMN):
        times = local_stamps(start, 4 * 3600, 10, ZoneInfo("UTC"))
        assert read_stamped(tmp_path, times, values(len(times))).gaps == 0


@pytest.mark.parametrize(
    ("header", "zone", "options", "unknown"),
    [
        ("time,Hz", "", {}, True),
        ("time,Hz", "Z", {}, False),
        ("time,Hz", "+01:00", {}, False),
        ("time,Hz", "", {"timezone": "Europe/Berlin"}, False),
        ("time,Hz", "", {"timezone": "UTC"}, False),
        ("time_utc,Hz", "", {}, False),
        ("Time [UTC],Hz", "", {}, False),
        ("time (UTC+1),Hz", "", {}, True),
    ],
)
def test_whether_the_zone_is_known_goes_with_the_reference(
    tmp_path, header, zone, options, unknown
):
    rows = [f"{t}{zone},{f}" for t, f in zip(stamps(50), values(50), strict=True)]
    reference = read_rows(tmp_path, rows, header, **options)
    assert reference.zone_unknown == unknown
    assert (NO_ZONE in reference.notes) == unknown
    blocks = list(reference_blocks(reference, source="reference/x"))
    assert [block.zone_unknown for block in blocks] == [unknown]
    assert joined(blocks).zone_unknown == unknown


def test_numbers_and_values_alone_have_no_zone_to_miss(tmp_path):
    rows = [f"{1768464000 + i},{f}" for i, f in enumerate(values(50))]
    assert not read_rows(tmp_path, rows).zone_unknown
    assert not read_rows(tmp_path, [f"{i},{f}" for i, f in enumerate(values(50))]).zone_unknown
    assert table.LEAST_UNIX < 1768464000

"""Files that are no references: one line that says so, and one that says what to do."""

from __future__ import annotations

import gzip

import numpy as np
import pytest

from rsenf.errors import EXIT_USAGE, ReferenceFormatError, UsageError
from rsenf.reference import read_reference
from tests.reference.reference_files import read_rows, read_stamped, read_text, stamps, values


def rows(freq):
    return [f"{t},{f}" for t, f in zip(stamps(len(freq)), freq, strict=True)]


@pytest.mark.parametrize(
    ("text", "message", "hint"),
    [
        ("", "is empty", "frequency"),
        ("\n\n# nothing\n", "is empty", "frequency"),
        ("time,frequency\n", "header but no values", ""),
        (
            "time,volts\n2022-01-01 00:00:00,230\n",
            "no frequency column in grid.csv; its columns are: time, volts",
            "frequency, Hz or f",
        ),
        ("frequency\n50.01\n50.02\n50.03\n", "no time column", "--step-s"),
        ("time,frequency\nsoon,50.0\nlater,50.1\n", "'soon' in the time column", "ISO 8601"),
        ("Hz\n50,01\n50,02\n", "1 columns in the header, 2", "decimal comma"),
        ("50,01\n50,02\n50,00\n", "no header and 2 columns", "frequency"),
        ("1,2,3\n1,2,3\n", "no header and 3 columns", "frequency"),
        ("time,frequency\n2022-01-01 00:00:00,50.0\n", "frequency column: 1", "right column"),
        ("hello world\nthis is prose\n", "no frequency column", "frequency"),
        (f'time,frequency\n2022-01-01 00:00:00,"{"5" * 200_000}', "field larger", "quote"),
    ],
)
def test_text_that_is_no_reference(tmp_path, text, message, hint):
    with pytest.raises(ReferenceFormatError) as caught:
        read_text(tmp_path, text)
    assert message in caught.value.message
    assert "\n" not in caught.value.message
    assert hint in caught.value.hint
    assert caught.value.exit_code == EXIT_USAGE


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("time", ["1e300", "-inf", "9" * 400])
def test_a_number_that_is_no_time_is_a_gap(tmp_path, time):
    lines = [f"{1_700_000_000 + k},{f}" for k, f in enumerate(values(50))]
    lines[20] = f"{time},50.0"
    assert read_rows(tmp_path, lines).gaps == 1


def test_a_day_of_many_digits_is_a_gap(tmp_path):
    lines = [f"{t.replace('-', '/')},{f}" for t, f in zip(stamps(50), values(50), strict=True)]
    lines[20] = f"2022/01/{2**63} 00:00:20,50.0"
    assert read_rows(tmp_path, lines).gaps == 1


@pytest.mark.parametrize(
    ("freq", "hint"),
    [
        (2 * values(50), "halve it"),
        (2 * values(50, nominal_hz=60.0), "halve it"),
        (1000 * values(50), "divide by 1000"),
        (230 + values(50), "--column"),
    ],
)
def test_numbers_that_are_no_grid_frequency(tmp_path, freq, hint):
    with pytest.raises(ReferenceFormatError, match="no grid frequency") as caught:
        read_rows(tmp_path, rows(freq))
    assert hint in caught.value.hint


def test_a_nominal_frequency_that_is_not_there(tmp_path):
    with pytest.raises(ReferenceFormatError, match="nominal frequency of 60"):
        read_rows(tmp_path, rows(values(50)), nominal_hz=60.0)


@pytest.mark.parametrize(
    "options",
    [
        {"stamp": "middle"},
        {"step_s": 0.0},
        {"step_s": 1e-12},
        {"step_s": -1.0},
        {"nominal_hz": 55.0},
    ],
)
def test_arguments_that_cannot_be_meant(tmp_path, options):
    with pytest.raises(UsageError):
        read_stamped(tmp_path, stamps(50), values(50), **options)


def test_a_column_that_is_not_there(tmp_path):
    with pytest.raises(ReferenceFormatError, match="no column 'f50'"):
        read_rows(tmp_path, rows(values(50)), column="f50")
    with pytest.raises(ReferenceFormatError, match="no header"):
        read_text(tmp_path, "50.0\n50.1\n", column="f50", step_s=1)


def test_files_that_are_not_there_or_broken(tmp_path):
    with pytest.raises(UsageError, match="no reference file"):
        read_reference(tmp_path / "none.csv")
    with pytest.raises(UsageError, match="can't read"):
        read_reference(tmp_path)
    damaged = tmp_path / "damaged.csv.gz"
    damaged.write_bytes(gzip.compress(b"time,frequency\n" * 500)[:40])
    with pytest.raises(ReferenceFormatError, match="damaged gzip"):
        read_reference(damaged)
    binary = tmp_path / "video.csv"
    binary.write_bytes(np.random.default_rng(0).bytes(2000) + bytes(10))
    with pytest.raises(ReferenceFormatError, match="no text file"):
        read_reference(binary)


def test_an_address_is_no_reference_and_its_password_is_not_shown() -> None:
    with pytest.raises(UsageError, match="a file, not an address") as error:
        read_reference("http://user:hunter2@host/grid.csv")
    assert "hunter2" not in str(error.value)

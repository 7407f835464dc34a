"""Files that grow: what is whole is read once, through truncation and rotation."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rsenf.errors import ReferenceFormatError, UsageError
from rsenf.messages import ReferenceBlock
from rsenf.reference.live import follow_table, follow_wav
from rsenf.reference.readings import ReadOptions
from rsenf.timebase import NS_PER_S
from tests.reference.joined import joined
from tests.reference.reference_files import write_wav
from tests.reference.test_wav import mains, path_hz

T0_S = 1_700_000_000


def rows(first: int, count: int) -> str:
    return "".join(f"{T0_S + k},{50 + 1e-3 * k:.3f}\n" for k in range(first, first + count))


def steps(*what: Callable[[], object]) -> Callable[[], bool]:
    """A wait in which the next thing happens; after the last it is time to stop."""
    coming = iter(what)

    def wait() -> bool:
        step = next(coming, None)
        if step is not None:
            step()
        return step is None

    return wait


def followed(path: Path, *what: Callable[[], object], **options: object) -> list[ReferenceBlock]:
    return list(follow_table(path, "ce", ReadOptions(**options), steps(*what)))  # type: ignore[arg-type]


def nothing() -> None:
    """Happens."""


def append(path: Path, text: str, encoding: str = "utf-8") -> Callable[[], object]:
    def write() -> None:
        with path.open("a", encoding=encoding) as file:
            file.write(text)

    return write


@pytest.fixture
def table(tmp_path: Path) -> Path:
    path = tmp_path / "grid.csv"
    path.write_text("time,frequency\n" + rows(0, 10), encoding="utf-8")
    return path


def test_days_that_may_be_months_are_asked_for_before_the_next_midnight(tmp_path: Path) -> None:
    path, form = tmp_path / "grid.csv", "%d/%m/%Y %H:%M:%S"
    lines = [f"05/03/2026 08:00:0{k},{k - 2.5}" for k in range(8)]
    path.write_text("\n".join(["time,mHz", *lines]) + "\n")
    with pytest.raises(ReferenceFormatError, match="day or month first: give --time-format"):
        followed(path, nothing, nominal_hz=50.0)
    reference = joined(followed(path, nothing, nominal_hz=50.0, time_format=form))
    assert reference.zone_unknown
    assert reference.t0_ns == np.datetime64("2026-03-05T08:00:00", "ns").astype(np.int64)
    np.testing.assert_allclose(reference.freq_hz, 50 + 1e-3 * (np.arange(8) - 2.5))


def test_rows_come_as_they_are_written_and_whole(table: Path) -> None:
    line = rows(12, 1)
    blocks = followed(
        table,
        append(table, rows(10, 2)),
        append(table, line[:7]),
        append(table, line[7:] + rows(15, 1)),
    )
    assert [(b.first, b.samples) for b in blocks] == [(0, 10), (10, 2), (12, 4)]
    assert {(b.total, b.grid, b.t0_ns) for b in blocks} == {(0, "ce", T0_S * NS_PER_S)}
    freq_hz = joined(blocks).freq_hz
    np.testing.assert_allclose(freq_hz[:13], 50 + 1e-3 * np.arange(13))
    assert np.isnan(freq_hz[13:15]).all()
    assert freq_hz[15] == 50.015


def test_an_empty_file_is_waited_for(tmp_path: Path) -> None:
    path = tmp_path / "grid.csv"
    path.write_text("", encoding="utf-8")
    blocks = followed(
        path,
        append(path, "# a logger\ntime,frequency\n"),
        append(path, rows(0, 2)),
        append(path, rows(2, 4)),
    )
    np.testing.assert_allclose(joined(blocks).freq_hz, 50 + 1e-3 * np.arange(6))
    assert (
        followed(path.with_name("grid.csv"), stamp="centre")[0].t0_ns == T0_S * NS_PER_S - 5 * 10**8
    )


def test_a_file_in_utf_16_is_followed(tmp_path: Path) -> None:
    path = tmp_path / "grid.csv"
    path.write_text("time;frequency\n", encoding="utf-16")
    pieces = [append(path, rows(n, 5).replace(",", ";"), "utf-16-le") for n in (0, 5)]
    np.testing.assert_allclose(joined(followed(path, *pieces)).freq_hz, 50 + 1e-3 * np.arange(10))


def test_truncated_rotated_and_written_anew(table: Path) -> None:
    def truncate() -> None:
        table.write_text("time,frequency\n" + rows(10, 5), encoding="utf-8")

    def rotate() -> None:
        os.rename(table, table.with_suffix(".1"))

    def again() -> None:
        table.write_text("utc;Hz\n" + rows(15, 6).replace(",", ";"), encoding="utf-8")

    def rewrite() -> None:
        fresh = table.with_suffix(".new")
        fresh.write_text("time,frequency\n" + rows(0, 23), encoding="utf-8")
        os.replace(fresh, table)

    blocks = followed(
        table,
        truncate,
        nothing,
        rotate,
        nothing,
        again,
        nothing,
        rewrite,
        nothing,
    )
    assert {b.header.epoch for b in blocks} == {0}
    np.testing.assert_allclose(joined(blocks).freq_hz, 50 + 1e-3 * np.arange(23))
    assert [b.header.seq for b in blocks] == list(range(len(blocks)))


def test_a_logger_whose_clock_leaps_begins_anew(table: Path) -> None:
    blocks = followed(table, append(table, rows(10 + 2 * 86400, 5)), append(table, rows(-3600, 5)))
    assert [b.header.epoch for b in blocks] == [0, 1, 2]
    assert [b.t0_ns // NS_PER_S - T0_S for b in blocks] == [0, 10 + 2 * 86400, -3600]


@pytest.mark.parametrize(
    ("name", "text", "problem"),
    [
        ("grid.csv", "frequency\n" + "50.0\n" * 8, "no times of day"),
        ("grid.csv", "t,f\n" + "".join(f"{k},50\n" for k in range(8)), "no times of day"),
        ("grid.csv", "time,volt\n" + rows(0, 8), "no frequency column"),
        ("grid.csv", "time,frequency\n" + rows(0, 8).replace(",50", ",230"), "no grid frequency"),
        ("grid.parquet", "x", "doesn't grow line by line"),
    ],
)
def test_what_cannot_be_followed(tmp_path: Path, name: str, text: str, problem: str) -> None:
    (tmp_path / name).write_text(text, encoding="utf-8")
    with pytest.raises((ReferenceFormatError, UsageError), match=problem):
        followed(tmp_path / name)


def test_a_missing_file(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="no reference file"):
        followed(tmp_path / "none.csv")


def test_a_wav_that_grows(tmp_path: Path) -> None:
    truth = path_hz(40)
    signal = mains(truth, 1000)
    path, whole = tmp_path / "mains.wav", tmp_path / "whole.wav"
    write_wav(whole, signal, 1000)
    data = whole.read_bytes()
    head = len(data) - 2 * signal.size
    began_ns = T0_S * NS_PER_S

    def written(seconds: float) -> Callable[[], object]:
        def write() -> None:
            path.write_bytes(data[: head + round(seconds * 2000)])
            at_ns = began_ns + round(seconds * NS_PER_S)
            os.utime(path, ns=(at_ns, at_ns))

        return write

    written(3.2)()
    blocks = list(
        follow_wav(path, "ce", None, steps(written(6.5), written(20.0), written(40.0), nothing))
    )
    assert [b.first for b in blocks] == list(range(40))
    np.testing.assert_allclose(joined(blocks).freq_hz, truth, atol=2e-4)
    assert blocks[0].t0_ns == began_ns
    assert blocks[0].nominal_hz == 50.0

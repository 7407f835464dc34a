"""Read a reference from a file, whatever it looks like; say what was found and assumed."""

from __future__ import annotations

import gzip
import hashlib
import zlib
from pathlib import Path

import numpy as np

from rsenf.errors import ReferenceFormatError, UsageError
from rsenf.messages.schema import FloatArray
from rsenf.reference.axis import Axis, to_axis
from rsenf.reference.plausible import nominal_of, without_outliers
from rsenf.reference.reference import Reference, gap_lengths
from rsenf.reference.table import Table, numbers, read_table
from rsenf.reference.times import read_times
from rsenf.reference.wav import demodulate
from rsenf.timebase import nanoseconds

STAMPS = ("start", "centre")


def read_reference(
    path: str | Path,
    *,
    timezone: str | None = None,
    step_s: float | None = None,
    column: str | None = None,
    nominal_hz: float | None = None,
    stamp: str = "start",
    grid: str = "",
    start_utc_ns: int = 0,
) -> Reference:
    """Read a grid's frequency from a CSV file, plain or gzipped, or from a WAV of the mains.

    Parameters
    ----------
    path : str or Path
    timezone : str, optional
        IANA name of the zone of times that don't tell their own; UTC when not given.
    step_s : float, optional
        Time between samples; needed when there is no time column.
    column : str, optional
        Name of the frequency column.
    nominal_hz : float, optional
        50 or 60; told from the values when not given.
    stamp : {'start', 'centre'}
        Which part of its sample's interval a time stamp names.
    grid : str
        Name of the grid; that of the file when not given.
    start_utc_ns : int
        Start of a reference that doesn't tell its own, UTC since 1970; 0 for unknown.

    Raises
    ------
    UsageError
        When there is no such file, or an argument can't be meant so.
    ReferenceFormatError
        When the file can't be read as a reference.
    """
    path = Path(path)
    if stamp not in STAMPS:
        raise UsageError(f"no stamp {stamp!r}", "one of start, centre")
    if step_s is not None and not 0 < step_s < 86400:
        raise UsageError(f"a step of {step_s:g} s between samples", "give it in seconds")
    if nominal_hz not in (None, 50, 60):
        raise UsageError(f"nominal frequency {nominal_hz} Hz", "50 or 60")
    sha256 = _sha256(path)
    if path.suffix.lower() == ".wav":
        axis, nominal = _from_wav(path, nominal_hz)
    else:
        axis, nominal = _from_table(path, timezone, step_s, column, nominal_hz)
    t0_ns = axis.t0_ns or start_utc_ns
    if t0_ns and stamp == "centre":
        t0_ns -= nanoseconds(axis.step_s) // 2
    notes = axis.notes + _gap_notes(axis)
    if not t0_ns:
        notes.append("start time unknown: lags are counted from the first sample")
    return Reference(
        grid=grid or path.name.split(".")[0],
        nominal_hz=nominal,
        t0_ns=t0_ns,
        step_s=axis.step_s,
        freq_hz=axis.freq_hz,
        readings=axis.readings,
        notes=tuple(notes),
        sha256=sha256,
        name=path.name,
    )


def _sha256(path: Path) -> str:
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except FileNotFoundError:
        raise UsageError(f"no reference file {path}", "look for a misspelling") from None
    except OSError as exc:
        raise UsageError(f"can't read reference {path}: {exc.strerror}") from None


def _from_wav(path: Path, nominal_hz: float | None) -> tuple[Axis, float]:
    found = demodulate(path, nominal_hz)
    freq, outliers = without_outliers(found.freq_hz, found.nominal_hz)
    readings = np.isfinite(freq).astype(np.uint32)
    return Axis(0, 1.0, freq, readings, found.notes + outliers), found.nominal_hz


def _from_table(
    path: Path, timezone: str | None, step_s: float | None, column: str | None, asked: float | None
) -> tuple[Axis, float]:
    table = read_table(_text(path), path.name, column)
    raw = numbers(table.frequency)
    freq, notes = raw, list(table.notes)
    if np.isnan(raw).any():
        notes.append(f"values that are no numbers, taken as gaps: {np.isnan(raw).sum()}")
    nominal = nominal_of(raw, path.name, asked)
    freq, outliers = without_outliers(raw, nominal)
    notes += outliers
    axis = _timed(table, freq, path.name, timezone, step_s)
    return Axis(axis.t0_ns, axis.step_s, axis.freq_hz, axis.readings, notes + axis.notes), nominal


def _timed(
    table: Table, freq_hz: FloatArray, where: str, timezone: str | None, step_s: float | None
) -> Axis:
    """Put values on an axis by their times, or one after the other."""
    if table.time is None:
        if step_s is None:
            raise ReferenceFormatError(
                f"{where} has no time column", "give the time between values with --step-s"
            )
        return Axis(0, step_s, freq_hz, np.isfinite(freq_hz).astype(np.uint32), [])
    times = read_times(table.time, where, timezone)
    notes = list(times.notes)
    if not times.ok.all():
        notes.append(f"rows without a time that can be used, left out: {(~times.ok).sum()}")
    if times.ok.sum() < 2:
        raise ReferenceFormatError(
            f"{where}: rows with a time: {times.ok.sum()}", "at least two are needed"
        )
    axis = to_axis(times.t_ns[times.ok], freq_hz[times.ok], step_s, where)
    t0_ns = axis.t0_ns if times.absolute else 0
    return Axis(t0_ns, axis.step_s, axis.freq_hz, axis.readings, notes + axis.notes)


def _text(path: Path) -> str:
    raw = path.read_bytes()
    if raw[:2] == b"\x1f\x8b":
        try:
            raw = gzip.decompress(raw)
        except (OSError, EOFError, zlib.error):
            raise ReferenceFormatError(
                f"{path.name} is a damaged gzip file", "fetch or copy it again"
            ) from None
    if raw[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return raw.decode("utf-16", "replace")
    if b"\0" in raw[:4096]:
        raise ReferenceFormatError(f"{path.name} is no text file", "give a CSV or a WAV file")
    return raw.decode("utf-8-sig", "replace")


def _gap_notes(axis: Axis) -> list[str]:
    gaps = gap_lengths(axis.freq_hz)
    if not gaps:
        return []
    missing = sum(gaps)
    return [
        f"gaps: {len(gaps)}, {missing * axis.step_s:g} s in all "
        f"({missing / axis.freq_hz.size:.0%}), the longest {max(gaps) * axis.step_s:g} s"
    ]

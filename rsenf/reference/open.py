"""Opens a reference: a file of any supported format, an array, or a grid of the store."""

from __future__ import annotations

import hashlib
import os
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from rsenf.errors import ReferenceFormatError, UsageError
from rsenf.messages.schema import FloatArray
from rsenf.reference.axis import to_axis
from rsenf.reference.plausible import nominal_of, without_outliers
from rsenf.reference.readings import Readings, ReadOptions
from rsenf.reference.reference import Notes, Reference, gap_lengths
from rsenf.timebase import NS_PER_S, since_1970_ns

if TYPE_CHECKING:
    from rsenf.reference.store import StoredReference

STORE = "store:"
_LIMITS = ("from", "to")


def open_reference(
    spec: str | Path, *, store: str | os.PathLike[str] | None = None, grid: str = "", **reading: Any
) -> Reference | StoredReference:
    """Open a reference.

    Parameters
    ----------
    spec : str or Path
        A file, for :func:`rsenf.reference.read_reference`; or
        ``store:GRID[@STEP][?from=TIME&to=TIME]``, a grid of the store: its finest step unless one
        is given, and all of it or the samples that begin at or after ``from`` and before ``to``
        (ISO 8601, UTC unless it has a zone). The store is read only on access.
    store : str or Path, optional
        Folder of the store; the default one if None.
    grid : str
        Name of the reference; by default that of the file or of the grid in the store.
    **reading
        Options of :class:`rsenf.reference.readings.ReadOptions`. Only ``nominal_hz`` applies to the
        store.

    Raises
    ------
    UsageError
        If there is no such file or grid, or an argument is invalid.
    ReferenceFormatError, SchemaMismatch
        If it can't be read.
    """
    if not str(spec).startswith(STORE):
        return read_reference(spec, grid=grid, **reading)
    options = ReadOptions(**reading)
    reference = _from_store(str(spec), store, grid, options.nominal_hz)
    if replace(options, nominal_hz=None, assumed_hz=None) != ReadOptions():
        line = "what says how files are read (--timezone, --column …) has no bearing on the store"
        reference = replace(reference, notes=(*reference.notes, line))
    return reference


def _from_store(
    spec: str, store: str | os.PathLike[str] | None, grid: str, nominal_hz: float | None
) -> StoredReference:
    from rsenf.reference.store import default_store, open_grid

    name, limits_ns = _parse(spec)
    folder = Path(store) if store else default_store()
    reference = open_grid(folder, name, limits_ns.get("from"), limits_ns.get("to"))
    if nominal_hz not in (None, reference.nominal_hz):
        raise UsageError(
            f"{spec} is of a {reference.nominal_hz:g} Hz grid, not of one of {nominal_hz:g} Hz",
            "correct the nominal frequency, or give another reference",
        )
    return replace(reference, grid=grid or reference.grid)


def _parse(spec: str) -> tuple[str, dict[str, int]]:
    """Return the grid, with its step if there is one, and the limits in ns since 1970."""
    name, _, query = spec.removeprefix(STORE).partition("?")
    limits: dict[str, int] = {}
    for part in filter(None, query.split("&")):
        key, _, text = part.partition("=")
        if key not in _LIMITS:
            raise UsageError(f"{spec}: {key!r} is no limit", "e.g. store:ce@1?from=2024-08-01")
        limits[key] = utc_ns(text, f"{key}=")
    if limits.get("from", 0) >= limits.get("to", 2**63):
        raise UsageError(f"{spec}: ends before it begins", "from is the earlier time")
    return name, limits


def read_reference(path: str | Path, *, grid: str = "", **reading: Any) -> Reference:
    """Read a grid's frequency from a file, all of it at once.

    Parameters
    ----------
    path : str or Path
        CSV, plain or gzipped; Parquet; NPZ of days; or WAV of the mains.
    grid : str
        Name of the grid; that of the file if empty.
    **reading
        Options of :class:`rsenf.reference.readings.ReadOptions`.

    Raises
    ------
    UsageError
        If there is no such file, or an argument is invalid.
    ReferenceFormatError
        If the file can't be read as a reference.
    """
    if "://" in str(path):
        raise UsageError("a reference is a file, not an address", "download it first")
    path = Path(path)
    options = ReadOptions(**reading)
    sha256 = file_sha256(path)
    readings = Readings(path, options)
    axis = to_axis(readings, path.name)
    notes = readings.notes.lines + axis.notes
    t0_ns = axis.t0_ns if readings.dated else 0
    return Reference(
        grid=grid or grid_name(path),
        nominal_hz=readings.nominal_hz,
        t0_ns=t0_ns,
        step_s=axis.step_ns / NS_PER_S,
        freq_hz=axis.freq_hz,
        readings=axis.readings,
        notes=(*notes, *_usual_notes(t0_ns, axis.freq_hz, axis.step_ns / NS_PER_S)),
        sha256=sha256,
        name=path.name,
        size_bytes=path.stat().st_size,
    )


def reference_of(
    freq_hz: ArrayLike,
    step_s: float,
    *,
    start_utc_ns: int = 0,
    nominal_hz: float | None = None,
    grid: str = "array",
) -> Reference:
    """Make a reference from an array, which is checked as a file is.

    Parameters
    ----------
    freq_hz : array_like of float, shape (n,)
        Means over one step each; NaN in gaps.
    step_s : float
        Time between samples.
    start_utc_ns : int
        Start of the first sample, UTC since 1970; 0 for unknown.
    nominal_hz : float, optional
        50 or 60; found from the values if None.
    grid : str
        Name of the grid.

    Raises
    ------
    UsageError
        If an argument is invalid, or the values aren't a grid's frequency.

    Examples
    --------
    >>> reference_of([50.01, np.nan, 49.98], 1.0).gaps
    1
    """
    ReadOptions(step_s=step_s, nominal_hz=nominal_hz)  # checks the arguments
    values = np.array(freq_hz, np.float64)
    if values.ndim != 1:
        raise ReferenceFormatError(f"{grid}: shape {values.shape}", "one value after the other")
    nominal_hz = nominal_of(values, grid, nominal_hz)
    notes = Notes()
    values = without_outliers(values, nominal_hz, notes)
    return Reference(
        grid=grid,
        nominal_hz=nominal_hz,
        t0_ns=start_utc_ns,
        step_s=step_s,
        freq_hz=values,
        readings=np.isfinite(values).astype(np.uint32),
        notes=(*notes.lines, *_usual_notes(start_utc_ns, values, step_s)),
        sha256=hashlib.sha256(values.tobytes()).hexdigest(),
        name=grid,
    )


def grid_name(path: Path) -> str:
    """Return a file's default grid name: its name without extensions."""
    return path.name.split(".")[0]


def file_sha256(path: Path) -> str:
    """Return the hash of a reference file, as hexadecimal.

    Raises
    ------
    UsageError
        If it can't be read.
    """
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except FileNotFoundError:
        raise UsageError(f"no reference file {path}", "look for a misspelling") from None
    except OSError as exc:
        raise UsageError(f"can't read reference {path}: {exc.strerror}") from None


def _usual_notes(t0_ns: int, freq_hz: FloatArray, step_s: float) -> list[str]:
    notes, gaps = [], gap_lengths(freq_hz)
    if gaps:
        missing = sum(gaps)
        notes.append(
            f"gaps: {len(gaps)}, {missing * step_s:g} s in all "
            f"({missing / freq_hz.size:.0%}), the longest {max(gaps) * step_s:g} s"
        )
    if not t0_ns:
        notes.append("start time unknown: lags are counted from the first sample")
    return notes


def utc_ns(text: str, what: str) -> int:
    """Return an ISO 8601 date or time as ns since 1970; UTC unless it has a zone.

    Parameters
    ----------
    text : str
    what : str
        Name of the argument, for the error message.

    Raises
    ------
    UsageError
        If it is no time.

    Examples
    --------
    >>> utc_ns("1970-01-02", "from=")
    86400000000000
    """
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        raise UsageError(f"{what} {text!r} is not a time", "e.g. 2022-09-17T14:05:00Z") from None
    return since_1970_ns(moment)

"""Reads days of a grid's frequency from a NumPy archive, one row per day."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsenf.errors import ReferenceFormatError
from rsenf.messages.schema import FloatArray, Int64Array
from rsenf.reference.local_time import to_utc
from rsenf.reference.reference import Notes
from rsenf.reference.times import MOST_S
from rsenf.timebase import NO_ZONE, nanoseconds
from rsenf.whole_file import read_arrays

DAY_S, LEAST_STEP_S = 86400, 1e-3


@dataclass(frozen=True, eq=False)
class Days:
    """Days of values: ``freq_hz`` (days, samples), ``starts_ns`` (days,).

    ``dated`` is true if the starts are UTC since 1970, and false for a single unknown start.
    """

    starts_ns: Int64Array
    step_s: float
    freq_hz: FloatArray
    dated: bool

    def each(self) -> Iterator[tuple[Int64Array, FloatArray]]:
        """Yield the times and the values of each day."""
        t_ns = np.arange(self.freq_hz.shape[1]) * nanoseconds(self.step_s)
        for start_ns, freq_hz in zip(self.starts_ns, self.freq_hz, strict=True):
            yield start_ns + t_ns, freq_hz


def read_days(path: Path, timezone: str | None, step_s: float | None, notes: Notes) -> Days:
    """Read an archive.

    Parameters
    ----------
    path : Path
        ``frequency`` (days, samples) in Hz with ``day`` (days,), an ISO date for each; or
        ``frequency`` (samples,) alone. It also holds ``step_s`` unless that is given.
    timezone : str, optional
        IANA name of the zone in which the days begin at midnight; UTC if None.
    step_s : float, optional
        Time between samples.
    notes : Notes

    Raises
    ------
    ReferenceFormatError
        If it isn't such an archive.
    """
    try:
        held = read_arrays(path)
    except ValueError as exc:
        raise ReferenceFormatError(f"{path.name} {exc}", "fetch or copy it again") from None
    if "frequency" not in held:
        raise ReferenceFormatError(
            f"no frequency in {path.name}; it holds: {', '.join(held) or 'nothing'}",
            "expected frequency, with day (ISO dates) and step_s",
        )
    for name in held.keys() & {"frequency", "step_s"}:
        if held[name].dtype.kind not in "fiu":
            raise ReferenceFormatError(f"{path.name}: {name} holds {held[name].dtype}, not numbers")
    freq = np.atleast_2d(np.asarray(held["frequency"], np.float64))
    if step_s is None and "step_s" in held and held["step_s"].size == 1:
        step_s = float(held["step_s"].item())
    if step_s is None:
        raise ReferenceFormatError(
            f"{path.name} has no step_s", "give the time between values with --step-s"
        )
    if not LEAST_STEP_S <= step_s <= DAY_S or freq.ndim > 2:
        raise ReferenceFormatError(
            f"{path.name}: values of the shape {freq.shape}, one in {step_s:g} s",
            "expected one row for each day",
        )
    if "day" not in held:
        if freq.shape[0] > 1:
            raise ReferenceFormatError(
                f"{path.name} holds {freq.shape[0]} rows and no names of their days",
                "add day, one ISO date for each",
            )
        return Days(np.zeros(1, np.int64), step_s, freq, False)
    if freq.shape[1] * step_s > DAY_S:
        raise ReferenceFormatError(
            f"{path.name}: {freq.shape[1]} values at {step_s:g} s are more than a day",
            "is the step right?",
        )
    starts_ns, known = _midnights(held["day"], freq.shape[0], path.name, timezone, notes)
    return Days(starts_ns[known], step_s, freq[known], True)


def _midnights(
    names: NDArray[Any], days: int, where: str, timezone: str | None, notes: Notes
) -> tuple[Int64Array, NDArray[np.bool_]]:
    """Return the start of each day, and which of the days have exactly one start."""
    try:
        local = np.atleast_1d(names).astype("datetime64[s]")
    except (ValueError, SystemError):  # of letters that there aren't
        local = np.array([], "datetime64[s]")
    is_far = np.abs(local.astype(np.int64)) > MOST_S
    if names.dtype.kind not in "USM" or local.size != days or (np.isnat(local) | is_far).any():
        raise ReferenceFormatError(
            f"{where}: day names no dates, or not the {days} days of frequency",
            "one ISO date for each row",
        )
    notes.say(f"days taken to begin at midnight {timezone or 'UTC'}")
    local_ns = local.astype("datetime64[ns]").astype(np.int64)
    if timezone is None:
        notes.say(NO_ZONE)
        return local_ns, np.ones(days, np.bool_)
    return to_utc(local_ns, timezone, notes)

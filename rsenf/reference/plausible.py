"""Checks that values are a grid's frequency; each usual mistake is named with its remedy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rsenf.errors import ReferenceFormatError
from rsenf.messages.schema import FloatArray
from rsenf.reference.columns import unit_said
from rsenf.reference.reference import Notes

NOMINALS_HZ = (50.0, 60.0)
NEAR_HZ = 1.5  # a grid that deviates further doesn't stay connected
MIN_VALUES = 2
# Deviations above the first can't be in Hz, deviations below the second can't be in mHz.
LEAST_IN_MHZ, MOST_IN_HZ = 5.0, 0.5
TYPICAL_DEVIATION_MHZ = 100.0  # medians over hours are well within it; mains volts are not


def nominal_of(freq_hz: FloatArray, where: str, asked_hz: float | None) -> float:
    """Return the nominal frequency that the values are near to.

    Parameters
    ----------
    freq_hz : ndarray, shape (n,)
        NaN for no reading.
    where : str
    asked_hz : float, optional
        The nominal frequency that the user gave.

    Raises
    ------
    ReferenceFormatError
        If there are fewer than two values, they are near neither 50 nor 60 Hz, or not near the one
        given.
    """
    ok = np.isfinite(freq_hz)
    if ok.sum() < MIN_VALUES:
        raise ReferenceFormatError(
            f"{where}: numbers in the frequency column: {ok.sum()}", "is it the right column?"
        )
    typical = float(np.median(freq_hz[ok]))
    nominal = _nominal_near(typical)
    if nominal is None:
        raise ReferenceFormatError(
            f"{where}: values around {typical:.6g} are no grid frequency in Hz", _cure(typical)
        )
    if asked_hz is not None and asked_hz != nominal:
        raise ReferenceFormatError(
            f"{where}: values around {typical:.3f} Hz, but a nominal frequency of {asked_hz:g} Hz",
            "correct the nominal frequency, or give another reference",
        )
    return nominal


def _nominal_near(freq_hz: float) -> float | None:
    return next((n for n in NOMINALS_HZ if abs(freq_hz - n) <= NEAR_HZ), None)


def _cure(typical: float) -> str:
    if _nominal_near(typical / 2):
        return "looks like illumination frequency: halve it"
    if _nominal_near(typical / 1e3):
        return "looks like millihertz: call the column mHz, or divide by 1000"
    return "is it the right column? See --column"


@dataclass(frozen=True)
class Unit:
    """Unit of a column's values: ``freq = offset + factor · value``, in Hz."""

    factor: float = 1.0
    offset_hz: float = 0.0

    def to_hz(self, values: FloatArray) -> FloatArray:
        """Return values in Hz; values that are in Hz already are not changed in any bit."""
        return values if self == Unit() else self.offset_hz + self.factor * values


def unit_of(
    values: FloatArray, name: str, where: str, nominal_hz: float | None, notes: Notes
) -> Unit:
    """Find the unit of a column's values: frequencies, or deviations from the nominal one.

    Parameters
    ----------
    values : ndarray, shape (n,)
        NaN for no reading.
    name : str
        Of the column; it may contain Hz or mHz.
    where : str
    nominal_hz : float, optional
        Nominal frequency that deviations refer to.
    notes : Notes

    Raises
    ------
    ReferenceFormatError
        If they are deviations, and their unit or the nominal frequency is unknown.
    """
    ok = values[np.abs(values) < 1e300]  # differences of larger ones overflow
    if ok.size < MIN_VALUES:
        return Unit()
    typical, spread, named = float(np.median(ok)), float(np.ptp(ok)), unit_said(name)
    if named == "mHz" and _nominal_near(typical / 1e3):
        notes.say("frequencies in mHz, by the name of their column")
        return Unit(1e-3)
    whole = any(np.median(np.abs(ok - k * n)) <= NEAR_HZ for n in NOMINALS_HZ for k in (1, 2))
    near_0 = abs(typical) <= TYPICAL_DEVIATION_MHZ and 0 < spread <= 2e3 * NEAR_HZ
    if not near_0 or (whole and named != "mHz"):
        return Unit()
    largest = float(np.abs(ok).max())
    sizes = "mHz" if largest >= LEAST_IN_MHZ else "Hz" if largest <= MOST_IN_HZ else ""
    unit = named or sizes
    if not unit or (named and sizes and named != sizes):
        raise ReferenceFormatError(
            f"{where}: deviations of up to {largest:g}, in Hz or in mHz?",
            "call their column mHz or Hz",
        )
    if nominal_hz is None:
        raise ReferenceFormatError(
            f"{where}: deviations in {unit} from which frequency? Give --nominal-hz 50 or 60"
        )
    notes.say(f"values are deviations in {unit} from {nominal_hz:g} Hz")
    return Unit(1e-3 if unit == "mHz" else 1.0, nominal_hz)


def without_outliers(freq_hz: FloatArray, nominal_hz: float, notes: Notes) -> FloatArray:
    """Replace values that can't be a grid's frequency by NaN, and note their number."""
    out = np.abs(freq_hz - nominal_hz) > NEAR_HZ  # not so for NaN
    notes.count(f"values over {NEAR_HZ:g} Hz from {nominal_hz:g} Hz, taken as gaps", out.sum())
    return np.where(out, np.nan, freq_hz)

"""Is this a grid's frequency at all? The usual mistakes, each with its cure."""

from __future__ import annotations

import numpy as np

from rsenf.errors import ReferenceFormatError
from rsenf.messages.schema import FloatArray
from rsenf.reference.notes import Notes

NOMINALS_HZ = (50.0, 60.0)
NEAR_HZ = 1.5  # no grid strays further from its nominal frequency and stays connected
MIN_VALUES = 2
TYPICAL_DEVIATION_MHZ = 100.0  # the median of hours of a grid is well within; mains volts aren't


def nominal_of(freq_hz: FloatArray, where: str, asked_hz: float | None) -> float:
    """Return the nominal frequency that the values are near to.

    Parameters
    ----------
    freq_hz : ndarray, shape (n,)
        NaN for no reading.
    where : str
        Name of the file, for error messages.
    asked_hz : float, optional
        What the user says it is.

    Raises
    ------
    ReferenceFormatError
        When there are hardly any values, or they are near neither 50 nor 60 Hz.
    """
    ok = np.isfinite(freq_hz)
    if ok.sum() < MIN_VALUES:
        raise ReferenceFormatError(
            f"{where}: numbers in the frequency column: {ok.sum()}", "is it the right column?"
        )
    typical = float(np.median(freq_hz[ok]))
    nominal = next((n for n in NOMINALS_HZ if abs(typical - n) <= NEAR_HZ), None)
    if nominal is None:
        raise ReferenceFormatError(
            f"{where}: values around {typical:.6g} are no grid frequency in Hz",
            _cure(typical, float(np.ptp(freq_hz[ok]))),
        )
    if asked_hz is not None and asked_hz != nominal:
        raise ReferenceFormatError(
            f"{where}: values around {typical:.3f} Hz, but a nominal frequency of {asked_hz:g} Hz",
            "correct the nominal frequency, or give another reference",
        )
    return nominal


def _cure(typical: float, spread: float) -> str:
    if any(abs(typical / 2 - n) <= NEAR_HZ for n in NOMINALS_HZ):
        return "looks like illumination frequency: halve it"
    if any(abs(typical / 1e3 - n) <= NEAR_HZ for n in NOMINALS_HZ):
        return "looks like millihertz: divide by 1000"
    if abs(typical) <= NEAR_HZ and spread <= 2 * NEAR_HZ:
        return "looks like deviations from the nominal frequency: add 50 or 60"
    if abs(typical) <= TYPICAL_DEVIATION_MHZ and spread <= 2e3 * NEAR_HZ:
        return "looks like deviations in mHz: divide by 1000 and add 50 or 60"
    return "is it the right column? See --column"


def without_outliers(freq_hz: FloatArray, nominal_hz: float, notes: Notes) -> FloatArray:
    """Turn what can't be a grid's frequency into gaps, and say how many there were."""
    out = np.isfinite(freq_hz) & (np.abs(np.nan_to_num(freq_hz, nan=0.0) - nominal_hz) > NEAR_HZ)
    notes.count(f"values over {NEAR_HZ:g} Hz from {nominal_hz:g} Hz, taken as gaps", out.sum())
    return np.where(out, np.nan, freq_hz)

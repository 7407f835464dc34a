"""Frame rates as exact fractions: 29.97 is 30000/1001."""

from __future__ import annotations

import math
from fractions import Fraction

from rsenf.errors import UsageError

_NTSC = {
    "23.976": Fraction(24000, 1001),
    "23.98": Fraction(24000, 1001),
    "29.97": Fraction(30000, 1001),
    "59.94": Fraction(60000, 1001),
    "119.88": Fraction(120000, 1001),
}


def parse_frame_rate(value: object) -> Fraction:
    """Read a frame rate.

    Parameters
    ----------
    value : str, int, float or Fraction
        ``"30000/1001"``, ``25``, ``"12.5"``; the rounded values 23.976, 29.97, 59.94 and 119.88
        mean the broadcast rates over 1001.

    Raises
    ------
    UsageError
        When it isn't a positive number.

    Examples
    --------
    >>> parse_frame_rate(29.97), parse_frame_rate("25")
    (Fraction(30000, 1001), Fraction(25, 1))
    """
    text = str(value)
    if text in _NTSC:
        return _NTSC[text]
    try:
        rate = Fraction(text)
    except (ValueError, ZeroDivisionError):
        rate = Fraction(0)
    if isinstance(value, bool) or rate <= 0 or not math.isfinite(rate):
        raise UsageError(f"{value!r} is not a frame rate", "write 25, 29.97 or 30000/1001")
    return rate

"""Parses times as users write them."""

from __future__ import annotations

from datetime import datetime

from rsenf.errors import UsageError
from rsenf.timebase import since_1970_ns


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

"""Times as people write them."""

from __future__ import annotations

from datetime import datetime

from rsenf.errors import UsageError
from rsenf.timebase import since_1970_ns


def utc_ns(text: str, what: str) -> int:
    """Return an ISO 8601 date or time as ns since 1970; UTC unless it tells its zone.

    Parameters
    ----------
    text : str
    what : str
        Which argument it is, for the error message.

    Raises
    ------
    UsageError
        When it is no time.
    """
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        raise UsageError(f"{what} {text!r} is not a time", "e.g. 2022-09-17T14:05:00Z") from None
    return since_1970_ns(moment)

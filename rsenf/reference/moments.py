"""Times as people write them, and back."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

from rsenf.errors import UsageError

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


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
    moment = moment if moment.tzinfo else moment.replace(tzinfo=UTC)
    return (moment - _EPOCH) // timedelta(microseconds=1) * 1000


def utc_text(t_ns: int) -> str:
    """Return ns since 1970 as ISO 8601 in UTC, with no more decimals than it takes."""
    seconds, part_ns = divmod(t_ns, 10**9)
    text = (_EPOCH + timedelta(seconds=seconds)).strftime("%Y-%m-%dT%H:%M:%S")
    return text + (f".{part_ns:09d}".rstrip("0") if part_ns else "") + "Z"

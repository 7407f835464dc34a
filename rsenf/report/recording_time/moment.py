"""Time at which a report is made: all that differs between runs on the same input."""

from __future__ import annotations

import os
import time
from datetime import UTC, datetime

from rsenf.errors import UsageError

VARIABLE = "SOURCE_DATE_EPOCH"  # reproducible-builds.org/specs/source-date-epoch


def moment_of_report() -> str:
    """Return the present time, or that of ``SOURCE_DATE_EPOCH``, as ISO 8601 in UTC.

    Raises
    ------
    UsageError
        When the variable isn't a valid time.
    """
    epoch = os.environ.get(VARIABLE, "")
    try:
        return f"{datetime.fromtimestamp(int(epoch or time.time()), UTC):%Y-%m-%dT%H:%M:%SZ}"
    except (ValueError, OverflowError, OSError):
        raise UsageError(
            f"{VARIABLE}={epoch!r} in the environment is no moment", "whole seconds since 1970"
        ) from None

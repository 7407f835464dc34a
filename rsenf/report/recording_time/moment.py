"""The one thing in a report that differs from run to run: when it was made."""

from __future__ import annotations

import os
import time
from datetime import UTC, datetime

from rsenf.errors import UsageError

VARIABLE = "SOURCE_DATE_EPOCH"  # reproducible-builds.org/specs/source-date-epoch


def moment_of_report() -> str:
    """Return now, or the moment that the environment sets, as ISO 8601 in UTC.

    Raises
    ------
    UsageError
        When the environment's is no moment.
    """
    told = os.environ.get(VARIABLE, "")
    try:
        return f"{datetime.fromtimestamp(int(told or time.time()), UTC):%Y-%m-%dT%H:%M:%SZ}"
    except (ValueError, OverflowError, OSError):
        raise UsageError(
            f"{VARIABLE}={told!r} in the environment is no moment", "whole seconds since 1970"
        ) from None

"""Keeps what the C library's heap has been given, for the next block of the same size.

What lies free between blocks that are in use is kept as well: of a minute in which more was held,
tens of megabytes. That is given back now and then, and costs a few page faults each time.
"""

from __future__ import annotations

import contextlib
import ctypes

# Of glibc's malloc.h. Blocks from 128 kB on come straight from the system unless told otherwise,
# and go back to it: each time, every page of a recording's megabyte, or of an array of rows, is
# cleared and mapped anew, which takes as long as the work on it.
_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3
_LARGEST_KEPT, _KEPT = 4 << 20, 16 << 20
TRIM_S = 60.0  # between the times that it is given back


def keep_heap() -> None:
    """Let blocks of up to 4 MiB be taken from memory that is there: 16 MiB of it, at most, wait.

    Larger ones, of a search, go back. With another C library than glibc this does nothing.
    """
    with contextlib.suppress(OSError, AttributeError, TypeError):  # another C library, or none
        mallopt = ctypes.CDLL(None).mallopt
        mallopt(_M_MMAP_THRESHOLD, _LARGEST_KEPT)
        mallopt(_M_TRIM_THRESHOLD, _KEPT)


def trim_heap() -> None:
    """Give back what is free, wherever it lies; with another C library nothing happens."""
    with contextlib.suppress(OSError, AttributeError, TypeError):
        ctypes.CDLL(None).malloc_trim(0)

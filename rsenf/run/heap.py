"""Tunes glibc's malloc to reuse freed memory instead of returning it to the system at once.

Free memory between used blocks stays allocated as well: tens of megabytes after a minute of
higher use. :func:`trim_heap` returns it now and then, at the cost of a few page faults.
"""

from __future__ import annotations

import contextlib
import ctypes

# Parameters of mallopt(3), from glibc's malloc.h. By default blocks of 128 kB and more are mapped
# and unmapped each time. The kernel then clears every page of an array of rows, or of a recording's
# chunk, anew, which takes as long as the work on it.
_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3
_LARGEST_KEPT, _KEPT = 4 << 20, 16 << 20
TRIM_S = 60.0  # interval of trim_heap


def keep_heap() -> None:
    """Serve blocks of up to 4 MiB from the heap, and keep up to 16 MiB free at its top.

    Larger blocks, as of a search, return to the system when freed. Does nothing without glibc.
    """
    with contextlib.suppress(OSError, AttributeError, TypeError):  # another C library, or none
        mallopt = ctypes.CDLL(None).mallopt
        mallopt(_M_MMAP_THRESHOLD, _LARGEST_KEPT)
        mallopt(_M_TRIM_THRESHOLD, _KEPT)


def trim_heap() -> None:
    """Return all free memory of the heap to the system. Does nothing without glibc."""
    with contextlib.suppress(OSError, AttributeError, TypeError):
        ctypes.CDLL(None).malloc_trim(0)

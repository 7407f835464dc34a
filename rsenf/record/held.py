"""A file that is being written says so, for as long as its writer lives."""

from __future__ import annotations

import contextlib
import fcntl
import os
from pathlib import Path


def hold(descriptor: int) -> None:
    """Mark an open file as being written, until it is closed or the process is gone.

    File systems without locks know no such mark; there nothing is held.
    """
    with contextlib.suppress(OSError):
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)


def is_held(path: Path) -> bool:
    """Whether a file is being written now, by this process or another.

    Raises
    ------
    OSError
        When it can't be opened.
    """
    descriptor = os.open(path, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    else:
        return False
    finally:
        os.close(descriptor)

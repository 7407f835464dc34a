"""Advisory lock on a file that is being written, released at the latest when its writer ends."""

from __future__ import annotations

import fcntl
import os
import time
from pathlib import Path

_ATTEMPTS, _APART_S = 100, 0.002  # is_held itself holds a lock for a moment


def hold(descriptor: int) -> None:
    """Lock an open file until it is closed or the process ends.

    On file systems without locks this does nothing.
    """
    for _ in range(_ATTEMPTS):
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            time.sleep(_APART_S)
        except OSError:
            return
        else:
            return


def is_held(path: Path) -> bool:
    """Whether a file is being written, by this process or another.

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

"""A file that is being written says so, for as long as its writer lives."""

from __future__ import annotations

import fcntl
import os
import time
from pathlib import Path

_ATTEMPTS, _APART_S = 100, 0.002  # whoever asks whether it is held holds it for that moment


def hold(descriptor: int) -> None:
    """Mark an open file as being written, until it is closed or the process is gone.

    File systems without locks know no such mark; there nothing is held.
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

"""A file that is written in whole blocks, locked meanwhile, with disk space reserved for its end.

The lock is advisory, and released at the latest when the writing process ends.
"""

from __future__ import annotations

import errno
import fcntl
import os
import tempfile
import time
from pathlib import Path
from typing import Any

_ATTEMPTS, _APART_S = 100, 0.002  # is_held itself holds a lock for a moment
RESERVE_STEP_BYTES = 1 << 20


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


def open_new(path: Path, overwrite: bool) -> Any:
    """Open a file that nobody writes, unbuffered: a failure is raised where it happens."""
    if overwrite and path.exists() and is_held(path):
        raise BlockingIOError(errno.EAGAIN, "it is being written", str(path))
    return open(path, "wb" if overwrite else "xb", buffering=0)


def open_existing(path: Path) -> Any:
    """Open an existing file for reading and writing, unbuffered."""
    return open(path, "r+b", buffering=0)


def open_nameless(folder: Path) -> Any:
    """Open an unnamed file, which disappears however the process ends."""
    return tempfile.TemporaryFile(dir=folder, buffering=0)


def write_all(file: Any, data: bytes) -> None:
    """Write all bytes; a single write to an unbuffered file may take fewer."""
    rest = memoryview(data)
    while rest:
        rest = rest[file.write(rest) :]


class Output:
    """A new file that grows by whole blocks, and is locked until it is closed.

    An unnamed file beside it reserves disk space for its end.

    Parameters
    ----------
    path : Path
    begin : bytes
        Its first block. If this can't be written, no file is left behind.
    overwrite : bool
        Whether an existing file may be replaced.
    """

    def __init__(self, path: Path, begin: bytes, *, overwrite: bool) -> None:
        self._file = open_new(path, overwrite)
        self.size = 0  # of all complete blocks
        self._synced = 0
        self._reserved = 0
        self._reserve: Any = None
        try:
            hold(self._file.fileno())
            self._reserve = open_nameless(path.parent)
            self.keep_back(RESERVE_STEP_BYTES)
            self.append(begin)
            self.sync()
        except OSError:
            self.close()
            path.unlink(missing_ok=True)
            raise

    def keep_back(self, size_bytes: int) -> None:
        """Reserve at least this much disk space."""
        while self._reserved < size_bytes:
            # Random bytes, because file systems may store zeros without using space.
            write_all(self._reserve, os.urandom(RESERVE_STEP_BYTES))
            self._reserved += RESERVE_STEP_BYTES

    def append(self, block: bytes) -> None:
        """Append a block; if interrupted, its partial bytes are overwritten or cut off later."""
        self._file.seek(self.size)
        write_all(self._file, block)
        self.size += len(block)

    def sync(self) -> None:
        """Wait until all blocks are on the disk. On failure, blocks since the last sync are cut."""
        if self._synced == self.size:
            return
        try:
            os.fsync(self._file.fileno())
        except OSError:
            self.size = self._synced
            raise
        self._synced = self.size

    def release(self) -> None:
        """Release the reserved disk space."""
        if self._reserve is not None:
            self._reserve.close()

    def close(self) -> None:
        """Truncate the file to its last complete block and close it."""
        self.release()
        try:
            self._file.truncate(self.size)
        finally:
            self._file.close()

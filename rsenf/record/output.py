"""The file being written: whole blocks only, and room kept back for its end."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from typing import Any

from rsenf.record.write_lock import hold

RESERVE_STEP_BYTES = 1 << 20


def open_new(path: Path, overwrite: bool) -> Any:
    """Open a file for writing, unbuffered, so that a failure shows where it happens."""
    return open(path, "wb" if overwrite else "xb", buffering=0)


def open_existing(path: Path) -> Any:
    """Open a file for changing its end, unbuffered."""
    return open(path, "r+b", buffering=0)


def open_nameless(folder: Path) -> Any:
    """Open a file without a name: nothing is left of it, however the process dies."""
    return tempfile.TemporaryFile(dir=folder, buffering=0)


def write_all(file: Any, data: bytes) -> None:
    """Write every byte; a raw file may take fewer at a time."""
    rest = memoryview(data)
    while rest:
        rest = rest[file.write(rest) :]


class Output:
    """A new file that grows by whole blocks, and is known to be in use until it is closed.

    Beside it lies a nameless one that holds disk space back for the end of this one.

    Parameters
    ----------
    path : Path
        The file.
    begin : bytes
        Its first block. Where this can't be written, no file is left behind.
    overwrite : bool
        Whether an existing file may be replaced.
    """

    def __init__(self, path: Path, begin: bytes, *, overwrite: bool) -> None:
        self._file = open_new(path, overwrite)
        self.size = 0  # of all whole blocks
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
        """Hold at least so much disk space back."""
        while self._reserved < size_bytes:
            # Random, because file systems may store zeros for nothing.
            write_all(self._reserve, os.urandom(RESERVE_STEP_BYTES))
            self._reserved += RESERVE_STEP_BYTES

    def append(self, block: bytes) -> None:
        """Add a block at the end. An interruption leaves no half of it behind."""
        self._file.seek(self.size)
        write_all(self._file, block)
        self.size += len(block)

    def sync(self) -> None:
        """Wait until all blocks are on the disk. Where that fails, those since the last time go."""
        if self._synced == self.size:
            return
        try:
            os.fsync(self._file.fileno())
        except OSError:
            self.size = self._synced
            raise
        self._synced = self.size

    def release(self) -> None:
        """Give the space held back free for what is written next."""
        if self._reserve is not None:
            self._reserve.close()

    def close(self) -> None:
        """Close the file, cut back to its last whole block."""
        self.release()
        try:
            self._file.truncate(self.size)
        finally:
            self._file.close()

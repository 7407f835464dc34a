"""Files as a whole: atomic creation of files and folders, and NumPy archives read within limits."""

from __future__ import annotations

import os
import shutil
import zipfile
import zlib
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from tokenize import TokenError
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsenf.errors import RecordingError

# Archives of measured values shrink to a fifth at best, those of zeros to a thousandth.
MOST_BYTES, MOST_TIMES = 2**30, 50
# What NumPy and the ZIP reader raise, between them, of files that aren't whole.
_NOT_READABLE = (
    OSError, ValueError, KeyError, EOFError, RuntimeError, MemoryError, SyntaxError,
    TokenError, zlib.error, zipfile.BadZipFile,
)  # fmt: skip


def read_arrays(path: Path, names: Collection[str] = ()) -> dict[str, NDArray[Any]]:
    """Read the arrays of an ``.npz`` file: all, or those of some names.

    Raises
    ------
    ValueError
        When it can't be read, or would unpack to far more than it holds. The message says which.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            unpacked = sum(part.file_size for part in archive.infolist())
        most = max(MOST_BYTES, MOST_TIMES * path.stat().st_size)
        if unpacked <= most:
            with np.load(path, allow_pickle=False) as held:
                arrays = {n: held[n] for n in held.files if not names or n in names}
                if not all(isinstance(array, np.ndarray) for array in arrays.values()):
                    raise ValueError("a part of it is no array")
                return arrays
    except _NOT_READABLE as exc:
        raise ValueError("is no .npz file that can be read") from exc
    raise ValueError(f"would unpack to {unpacked / 2**30:.1f} GiB from {path.stat().st_size} bytes")


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside the file to write to; rename it to ``path`` on success.

    On any failure or interruption the temporary file is removed, and an existing file stays
    unchanged.

    Raises
    ------
    RecordingError
        When the system refuses to write: no such folder, no rights, disk full.
    """
    part = path.with_name(f".{path.stem}.{os.getpid()}.part{path.suffix}")
    try:
        yield part
        os.replace(part, path)
    except OSError as exc:
        raise RecordingError(
            f"can't write {path}: {exc.strerror or exc}", "check the folder, its rights and space"
        ) from exc
    finally:
        with suppress(OSError):
            part.unlink()


@contextmanager
def whole_folder(path: Path) -> Iterator[Path]:
    """Yield a new temporary folder beside ``path``; it replaces that on success.

    On any failure or interruption the new folder is removed, and an existing one stays unchanged.

    Raises
    ------
    RecordingError
        When the system refuses to write: no such folder, no rights, disk full.
    """
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    old = part.with_suffix(".old")
    try:
        part.mkdir()
        yield part
        if path.exists():
            os.replace(path, old)
        os.replace(part, path)
    except OSError as exc:
        raise RecordingError(
            f"can't write {path}: {exc.strerror or exc}", "check the folder, its rights and space"
        ) from exc
    finally:
        if old.exists() and not path.exists():  # interrupted between the two renames
            os.replace(old, path)
        shutil.rmtree(part, ignore_errors=True)
        shutil.rmtree(old, ignore_errors=True)

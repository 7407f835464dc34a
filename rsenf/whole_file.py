"""A file, or a folder, appears under its name whole, or not at all."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rsenf.errors import RecordingError


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Give a temporary name beside the file to write to; rename it when all went well.

    On any failure or interruption the temporary file is removed, and what stood under the name
    before is left as it was.

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
        part.unlink(missing_ok=True)


@contextmanager
def whole_folder(path: Path) -> Iterator[Path]:
    """Give a new folder beside the one to write; it takes that one's place when all went well.

    On any failure or interruption the new folder is removed, and what stood under the name before
    is left as it was.

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
        if old.exists() and not path.exists():  # stopped between the two steps
            os.replace(old, path)
        shutil.rmtree(part, ignore_errors=True)
        shutil.rmtree(old, ignore_errors=True)

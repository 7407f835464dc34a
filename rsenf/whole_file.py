"""Atomic creation of files and folders: they appear under their name complete, or not at all."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rsenf.errors import RecordingError


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
        part.unlink(missing_ok=True)


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

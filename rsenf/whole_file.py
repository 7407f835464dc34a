"""A file appears under its name whole, or not at all."""

from __future__ import annotations

import os
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

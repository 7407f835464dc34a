"""A text file as blocks of whole lines: plain or gzipped, UTF-8 or UTF-16, any length."""

from __future__ import annotations

import gzip
import io
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import IO, cast

from rsenf.errors import ReferenceFormatError

BLOCK_CHARS = 1 << 22  # some hundred thousand lines
_PEEK = 4096


def text_blocks(path: Path) -> Iterator[str]:
    """Yield a file's text, some whole lines at a time, each line ended by a line feed or the file.

    Raises
    ------
    ReferenceFormatError
        When it is no text, or a gzip file that is damaged.
    """
    with path.open("rb") as file:
        zipped = file.read(2) == b"\x1f\x8b"
        file.seek(0)
        raw = cast("IO[bytes]", gzip.GzipFile(fileobj=file) if zipped else file)
        try:
            text = io.TextIOWrapper(raw, _encoding(raw, path), errors="replace")
            while block := text.read(BLOCK_CHARS):
                yield block + text.readline()
        except (gzip.BadGzipFile, EOFError, zlib.error):
            raise ReferenceFormatError(
                f"{path.name} is a damaged gzip file", "fetch or copy it again"
            ) from None


def _encoding(raw: IO[bytes], path: Path) -> str:
    head = raw.read(_PEEK)
    raw.seek(0)
    if head[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return "utf-16"
    if b"\0" in head:
        raise ReferenceFormatError(
            f"{path.name} is no text file", "give a CSV, Parquet, WAV or NPZ file"
        )
    return "utf-8-sig"

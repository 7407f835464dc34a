"""Closes a truncated file: keeps all complete records, cuts off the rest, writes the end."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from mcap.records import Metadata

from rsenf.record.container import check_magic, pack
from rsenf.record.index import BARE_TAIL, Index
from rsenf.record.output import open_existing, write_all
from rsenf.record.scan import Contents
from rsenf.record.summary import read_contents
from rsenf.record.topics import topics_of

Notes = Callable[[Index], Mapping[str, str]]


class Finished(NamedTuple):
    """Contents of a file that was closed."""

    messages: int
    size_bytes: int
    cut_bytes: int  # size of the incomplete part that was cut off


def close_truncated(path: str | Path, name: str = "", notes: Notes | None = None) -> Finished:
    """Close a truncated file in place: cut off incomplete records, write index and footer.

    A complete file stays unchanged. If the index doesn't fit on the disk, the file ends without
    one, which is valid; if not even that fits, the last chunk is removed.

    Parameters
    ----------
    path : path
    name : str, optional
        Name of a metadata record to add.
    notes : callable, optional
        Returns the content of that record; takes the index of the file.

    Raises
    ------
    InputError
        When it isn't an MCAP file.
    OSError
        When it can't be written.
    """
    path = Path(path)
    with open_existing(path) as stream:
        size = os.fstat(stream.fileno()).st_size
        check_magic(path, stream)
        contents = read_contents(stream, size)
        if contents.complete:
            return Finished(_messages(contents), size, 0)
        _write_end(stream, contents, _end(contents, name, notes))
        finished_size = stream.tell()
        kept = read_contents(stream, finished_size)
        return Finished(_messages(kept), finished_size, size - contents.end)


def _messages(contents: Contents) -> int:
    return sum(topic.messages for topic in topics_of(contents.index).values())


def end_of_file(index: Index, offset: int, name: str, notes: Mapping[str, str]) -> bytes:
    """Return the end of a file: a last metadata record, the summary section and the footer.

    Parameters
    ----------
    index : Index
        Index of the file, to which the metadata record is added.
    offset : int
        Offset in the file at which the end will be written.
    name, notes
        Name and content of the metadata record.
    """
    record = pack(Metadata(name=name, metadata=dict(notes)))
    index.add_metadata(name, offset, len(record))
    return record + index.tail(offset + len(record))


def _end(contents: Contents, name: str, notes: Notes | None) -> bytes:
    index, at = contents.index, contents.end + len(contents.missing_indexes)
    end = end_of_file(index, at, name, notes(index)) if notes else index.tail(at)
    return contents.missing_indexes + end


def _write_end(stream: Any, contents: Contents, end: bytes) -> None:
    attempts = [
        (contents.end, end),
        (contents.end, BARE_TAIL),
        (contents.last_chunk_start, BARE_TAIL),
    ]
    for start, block in attempts:
        stream.truncate(start)
        stream.seek(start)
        try:
            write_all(stream, block)
            os.fsync(stream.fileno())
        except OSError:
            if (start, block) == attempts[-1]:
                raise
        else:
            return

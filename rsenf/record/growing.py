"""Writes an MCAP file that stays readable whenever writing ends, and closes a truncated one."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from mcap.records import Header as FileHeader
from mcap.records import Metadata

from rsenf import __version__
from rsenf.errors import InputError, RecordingError, UsageError, reason_of
from rsenf.record.container import MAGIC, check_magic, pack
from rsenf.record.index import BARE_TAIL, ChunkBuilder, Index
from rsenf.record.output import Output, open_existing, write_all
from rsenf.record.scan import Contents
from rsenf.record.summary import read_contents
from rsenf.record.topics import topics_of

Notes = Callable[[Index], Mapping[str, str]]
ABOUT = "rsenf"
CLOSING = "rsenf.closing"
CHUNK_BYTES = 1 << 20
END_BYTES = 1 << 19  # disk space reserved for the end of the file, besides its chunk index
_HINTS = {
    errno.ENOSPC: "free some space on that disk, then record to another file",
    errno.EDQUOT: "free some space in that account, then record to another file",
    errno.EFBIG: "no file can be larger there; record to another file",
}


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
        index, at = contents.index, contents.end + len(contents.missing_indexes)
        end = end_of_file(index, at, name, notes(index)) if notes else index.tail(at)
        _write_end(stream, contents, contents.missing_indexes + end)
        finished_size = stream.tell()
        kept = read_contents(stream, finished_size)
        return Finished(_messages(kept), finished_size, contents.cut_bytes)


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


class GrowingFile:
    """Collects records and writes them to the file in complete chunks.

    Parameters
    ----------
    path : Path
    about : mapping
        Content of the first metadata record.
    closing_notes : callable
        Returns the content of the last metadata record; takes the index of the file and the reason
        why the recording ends.
    compress, fsync, overwrite : bool
        As for :class:`rsenf.record.Recorder`.

    Attributes
    ----------
    index : Index
        Index of what has been written.
    chunk : ChunkBuilder
        Records not written yet.

    Raises
    ------
    UsageError
        When the file exists, or its folder doesn't.
    RecordingError
        When the file can't be written.
    """

    def __init__(
        self,
        path: Path,
        about: Mapping[str, str],
        closing_notes: Callable[[Index, str], Mapping[str, str]],
        *,
        compress: bool,
        fsync: bool,
        overwrite: bool,
    ) -> None:
        self.index = Index()
        self.chunk = ChunkBuilder(compress)
        self._path = path
        self._closing_notes = closing_notes
        self._fsync = fsync
        self._defined = 0  # number of channels; _chunks_since: chunks since the last new one
        self._chunks_since = 0
        self._closed = False
        self._failure: RecordingError | None = None
        begin = MAGIC + pack(FileHeader(profile="", library=f"rsenf {__version__}"))
        record = pack(Metadata(name=ABOUT, metadata=dict(about)))
        self._output = _open(path, begin + record, overwrite)
        self.index.add_metadata(ABOUT, len(begin), len(record))

    @property
    def size_bytes(self) -> int:
        """Size of the file, plus the pending chunk before compression."""
        return self._output.size + self.chunk.size

    def check_open(self) -> None:
        """Raise RecordingError if the file is closed or writing has failed."""
        if self._failure is not None:
            raise self._failure
        if self._closed:
            raise RecordingError(f"{self._path}: the recording is closed")

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Write a metadata record."""
        start = self._output.size
        record = pack(Metadata(name=name, metadata=dict(values)))
        self._append(record)
        self.index.add_metadata(name, start, len(record))

    def cut_when_full(self) -> None:
        """Write the pending chunk if it is large enough."""
        if self.chunk.size >= CHUNK_BYTES:
            self._cut()

    def flush(self) -> None:
        """Write the pending chunk, and wait for the disk."""
        self._cut()
        self._sync()
        try:
            self._output.keep_back(END_BYTES + self.index.chunks_bytes)
        except OSError as exc:
            raise self._fail(exc) from exc

    def close(self) -> None:
        """Write the end of the file. Does nothing if already closed, or after a failure."""
        if self._closed:
            return
        self._cut()
        self._output.release()
        notes = self._closing_notes(self.index, "closed")
        self._append(end_of_file(self.index, self._output.size, CLOSING, notes))
        self._sync()
        self._output.close()
        self._closed = True

    def _cut(self) -> None:
        if self.chunk.has_messages:
            chunk = self.chunk.pack(self._output.size)
            self._append(chunk.block)
            self.chunk.clear()
            self.index.add_chunk(chunk.entry, chunk.times)
            self._define_again()

    def _define_again(self) -> None:
        """Repeat all schemas and channels in the next chunk, in case their first chunk is damaged.

        This is done after 1, 2, 4, 8 … chunks without a new channel. So if the first chunks of a
        truncated file are lost, at most as many further ones are unreadable without definitions.
        """
        known = len(self.index.channels)
        self._chunks_since = self._chunks_since + 1 if known == self._defined else 1
        self._defined = known
        if self._chunks_since.bit_count() == 1:
            for record in (*self.index.schemas.values(), *self.index.channels.values()):
                self.chunk.add(pack(record))

    def _append(self, block: bytes) -> None:
        try:
            self._output.append(block)
        except OSError as exc:
            raise self._fail(exc) from exc

    def _sync(self) -> None:
        try:
            if self._fsync:
                self._output.sync()
        except OSError as exc:
            raise self._fail(exc) from exc

    def _fail(self, exc: OSError) -> RecordingError:
        """Stop writing, and leave a closed file with all complete chunks."""
        reason = reason_of(exc)
        try:
            self._output.close()
            kept = close_truncated(
                self._path, CLOSING, lambda index: self._closing_notes(index, reason)
            )
            safe = f"{kept.messages} messages, {kept.size_bytes / 1e6:.1f} MB, are safe in it"
        except (OSError, InputError):
            safe = "the file has no proper end"
        hint = _HINTS.get(exc.errno or 0, "check the disk, then record to another file")
        self._closed = True
        self._failure = RecordingError(f"{self._path}: recording stopped, {reason}; {safe}", hint)
        return self._failure


def _open(path: Path, begin: bytes, overwrite: bool) -> Output:
    if path.exists() and not path.is_file():
        raise UsageError(f"{path}: this is no file", "name a file")
    try:
        return Output(path, begin, overwrite=overwrite)
    except FileExistsError as exc:
        hint = "choose another name, or allow overwriting"
        raise UsageError(f"{path}: the file exists already", hint) from exc
    except (FileNotFoundError, NotADirectoryError) as exc:
        raise UsageError(f"{path}: there is no such folder", "make it first") from exc
    except OSError as exc:
        reason = reason_of(exc)
        hint = _HINTS.get(exc.errno or 0, "choose another place")
        raise RecordingError(f"{path}: can't record there, {reason}", hint) from exc

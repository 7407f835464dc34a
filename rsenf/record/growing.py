"""Writes an MCAP file that stays readable however and whenever writing ends."""

from __future__ import annotations

import errno
from collections.abc import Callable, Mapping
from pathlib import Path

from mcap.records import Header as FileHeader
from mcap.records import Metadata

from rsenf import __version__
from rsenf.errors import InputError, RecordingError, UsageError
from rsenf.record.chunk import ChunkBuilder
from rsenf.record.container import MAGIC, pack
from rsenf.record.finish import close_truncated, end_of_file
from rsenf.record.index import Index
from rsenf.record.output import Output

ABOUT = "rsenf"
CLOSING = "rsenf.closing"
CHUNK_BYTES = 1 << 20
END_BYTES = 1 << 19  # disk space reserved for the end of the file, besides its chunk index

_HINTS = {
    errno.ENOSPC: "free some space on that disk, then record to another file",
    errno.EDQUOT: "free some space in that account, then record to another file",
    errno.EFBIG: "no file can be larger there; record to another file",
}


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
            self.index.add_chunk(chunk.entry)
            self.index.add_extents(chunk.extents)
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
        reason = (exc.strerror or str(exc)).lower()
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
        reason = (exc.strerror or str(exc)).lower()
        hint = _HINTS.get(exc.errno or 0, "choose another place")
        raise RecordingError(f"{path}: can't record there, {reason}", hint) from exc

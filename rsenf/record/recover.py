"""Recovers a damaged recording: copies all intact data to a new file, and notes what was lost."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

from mcap.opcode import Opcode
from mcap.records import ChunkIndex
from mcap.records import Header as FileHeader

from rsenf import __version__
from rsenf.errors import InputError, RecordingError, UsageError
from rsenf.record.container import HEAD, MAGIC, pack, unpack, unpack_message
from rsenf.record.examine import RECOVERED, Examination, examine
from rsenf.record.growing import end_of_file
from rsenf.record.index import ChunkBuilder, Index, Times, index_chunk, timed
from rsenf.record.output import is_held, write_all
from rsenf.record.reader import open_file
from rsenf.record.scan import OURS, Contents, IntactRecord, intact_records, times_of
from rsenf.whole_file import whole_file

BACKUP = ".damaged"
_NAMED_GAPS = 100  # gaps listed for each topic; further ones are only counted


def recover(path: str | Path, out: str | Path, *, overwrite: bool = False) -> Examination:
    """Copy all intact data of a recording to a new file, which appears complete or not at all.

    Chunks are put in the order of the summary section, duplicate chunks are removed, and all
    indexes are rebuilt. Finally the new file is read completely as a check.

    Parameters
    ----------
    path, out : path
        The recording, and the new file.
    overwrite : bool
        Whether an existing file may be replaced.

    Returns
    -------
    Examination
        Findings about the damaged file.

    Raises
    ------
    UsageError
        When there is no such file, or the new one exists.
    InputError
        When nothing can be recovered, or another program made the file.
    RecordingError
        When the new file can't be written.
    """
    path, out = Path(path), Path(out)
    if out.exists() and (not overwrite or out.samefile(path)):
        raise UsageError(f"{out}: the file exists already", "choose another name")
    found = _examined(path)
    with whole_file(out) as part:
        _write(found, part)
    return found


def recover_in_place(path: str | Path) -> tuple[Examination, Path]:
    """Replace a damaged file by the recovered one; the damaged file is renamed.

    Returns
    -------
    found : Examination
        Findings about the damaged file.
    backup : Path
        New name of the damaged file.

    Raises
    ------
    UsageError, InputError, RecordingError
        As :func:`recover`; also if a backup exists already, or the file is being recorded.
    """
    path = Path(path)
    backup = path.with_name(path.name + BACKUP)
    if backup.exists():
        raise UsageError(f"{backup}: there is a backup already", "move it away first")
    found = _examined(path)
    if is_held(path):
        raise UsageError(f"{path}: is being recorded", "end that, or recover to another file")
    with whole_file(path) as part:
        _write(found, part)
        _give_name(path, backup)
    return found, backup


def _give_name(path: Path, backup: Path) -> None:
    """Give the file a second name, which leaves no moment without the first; else rename it."""
    try:
        os.link(path, backup)
    except FileExistsError:
        raise
    except OSError:
        path.rename(backup)


def _examined(path: Path) -> Examination:
    found = examine(path)
    library = found.contents.library
    # No checksum covers the library's name: a file with rsenf's messages counts as rsenf's.
    ours = library.startswith(OURS) or any(state.topic.is_ours for state in found.topics)
    if library and not ours:
        raise InputError(f"{path}: made by {library}", "'mcap recover' is for files of others")
    if not found.messages:
        raise InputError(f"{path}: there is no whole message in it", "nothing can be saved")
    return found


def _write(found: Examination, out: Path) -> None:
    with open_file(found.path) as stream, open(out, "xb", buffering=0) as file:
        index = Index()
        for block in _blocks(stream, found, index):
            write_all(file, block)
        write_all(file, end_of_file(index, file.tell(), RECOVERED, _notes(found)))
        os.fsync(file.fileno())
    written = examine(out)
    if written.contents.damages or not written.contents.complete:
        raise RecordingError(f"{out}: what was written can't be read back", "check the disk")


def _blocks(stream: BinaryIO, found: Examination, index: Index) -> Iterator[bytes]:
    """Yield the blocks of the new file except its end, and add them to the index."""
    contents = found.contents
    begin = [MAGIC, pack(FileHeader(profile="", library=f"{OURS}{__version__}"))]
    index.schemas, index.channels = contents.index.schemas, contents.index.channels
    # Definitions come before all chunks, since the chunk that contained them may be lost.
    begin += map(pack, (*index.schemas.values(), *index.channels.values()))
    yield b"".join(begin)
    at = sum(map(len, begin))
    for place in contents.index.metadata:
        record = pack(_intact_at(stream, place.offset, place.length).content)
        index.add_metadata(place.name, at, len(record))
        yield record
        at += len(record)
    seen = set()
    for start, length in _chunk_places(contents):
        chunk, times = _chunk(_intact_at(stream, start, length), index)
        identity = (chunk.uncompressed_crc, chunk.uncompressed_size, chunk.message_start_time)
        if times and identity not in seen:
            seen.add(identity)
            record = pack(chunk)
            entry, message_indexes = index_chunk(chunk, at, len(record), times)
            index.add_chunk(entry, times)
            yield record + message_indexes
            at += len(record) + len(message_indexes)


def _intact_at(stream: BinaryIO, start: int, length: int) -> IntactRecord:
    intact = next(intact_records(stream, start + length, start), None)
    if not isinstance(intact, IntactRecord):
        raise InputError("the file changes while it is read", "is it still being recorded?")
    return intact


def _chunk_places(contents: Contents) -> list[tuple[int, int]]:
    """Return the positions of the chunks, in the summary section's order if it has them all."""
    chunks = [unpack(ChunkIndex, packed[HEAD.size :]) for packed in contents.index.chunks]
    listed = [_likeness(unpack(ChunkIndex, body)) for body in contents.summary_chunks]
    ranks = {likeness: rank for rank, likeness in enumerate(listed)}
    if all(_likeness(chunk) in ranks for chunk in chunks):
        chunks.sort(key=lambda chunk: ranks[_likeness(chunk)])
    return [(chunk.chunk_start_offset, chunk.chunk_length) for chunk in chunks]


def _likeness(chunk: Any) -> tuple[int, ...]:
    times = chunk.message_start_time, chunk.message_end_time
    return *times, chunk.uncompressed_size, chunk.compressed_size


def _chunk(intact: IntactRecord, index: Index) -> tuple[Any, Times]:
    """Return the chunk without messages of undefined channels."""
    times = times_of(intact.parts)
    if index.channels.keys() >= times.keys():
        return timed(intact.content, times), times
    builder = ChunkBuilder(compress=True)
    for part in intact.parts:
        if part.opcode == Opcode.MESSAGE:
            message = unpack_message(part.body)
            if message.channel_id in index.channels:
                builder.add_message(message)
    return builder.packed()


def _notes(found: Examination) -> dict[str, str]:
    notes = {"from": found.path.name, "from_bytes": str(found.size_bytes), "by": __version__}
    for state in found.topics:
        lost = [gap for gap in state.gaps if gap.damaged]
        words = [f"{gap.first}-{gap.last} of epoch {gap.epoch}" for gap in lost[:_NAMED_GAPS]]
        if lost[_NAMED_GAPS:]:
            words.append(f"{sum(gap.messages for gap in lost[_NAMED_GAPS:])} more")
        if state.lost_at_end or (state.lost_at_end is None and state.cut):
            words.append(f"what came after {state.last_seq}")
        if words:
            notes[f"lost {state.topic.name}"] = ", ".join(words)
    return notes

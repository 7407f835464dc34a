"""The index of a file and its MCAP summary section, which spares readers a scan of the file."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from mcap.opcode import Opcode
from mcap.records import DataEnd, Footer, MetadataIndex, Statistics, SummaryOffset

from rsenf.record.chunk import Extent
from rsenf.record.container import MAGIC, pack
from rsenf.record.stretches import Stretch, Stretches

DATA_END = pack(DataEnd(0))
# A valid end without a summary section, for a full disk.
BARE_TAIL = DATA_END + pack(Footer(0, 0, 0)) + MAGIC


@dataclass
class Index:
    """Schemas, channels, chunks and metadata of a file, in the order of writing."""

    schemas: dict[int, Any] = field(default_factory=dict)
    channels: dict[int, Any] = field(default_factory=dict)
    extents: dict[int, Extent] = field(default_factory=dict)
    # Times with messages for each channel, with the resolution of chunks.
    stretches: dict[int, Stretches] = field(default_factory=dict)
    # Chunk index records, serialised to save memory: 170,000 for a day.
    chunks: list[bytes] = field(default_factory=list)
    chunks_bytes: int = 0
    metadata: list[Any] = field(default_factory=list)

    @property
    def messages(self) -> int:
        """Number of messages in the file."""
        return sum(extent.messages for extent in self.extents.values())

    def add_extents(self, extents: dict[int, Extent]) -> None:
        """Count the messages of a chunk, or a message outside of chunks."""
        for channel, extent in extents.items():
            self.extents[channel] = extent.joined(self.extents.get(channel))
            stretches = self.stretches.setdefault(channel, Stretches())
            stretches.add(Stretch(extent.first_ns, extent.last_ns))

    def add_chunk(self, entry: Any) -> None:
        """Add the index of a chunk in the file."""
        self.chunks.append(pack(entry))
        self.chunks_bytes += len(self.chunks[-1])

    def add_metadata(self, name: str, start: int, length: int) -> None:
        """Add a metadata record in the file."""
        self.metadata.append(MetadataIndex(offset=start, length=length, name=name))

    def tail(self, offset: int) -> bytes:
        """Return everything after a data section that ends at ``offset``."""
        start = offset + len(DATA_END)
        summary, offsets = bytearray(), bytearray()
        for opcode, group in self._groups():
            if group:
                offsets += pack(SummaryOffset(opcode, start + len(summary), len(group)))
                summary += group
        at = start + len(summary)
        summary += offsets
        # The checksum includes the footer up to the checksum itself.
        footer = pack(Footer(start, at, 0))[:-4]
        checksum = zlib.crc32(footer, zlib.crc32(summary))
        return DATA_END + bytes(summary) + footer + checksum.to_bytes(4, "little") + MAGIC

    def _groups(self) -> Iterator[tuple[Opcode, bytes]]:
        yield Opcode.SCHEMA, b"".join(map(pack, self.schemas.values()))
        yield Opcode.CHANNEL, b"".join(map(pack, self.channels.values()))
        yield Opcode.STATISTICS, pack(self._statistics())
        yield Opcode.CHUNK_INDEX, b"".join(self.chunks)
        yield Opcode.METADATA_INDEX, b"".join(map(pack, self.metadata))

    def _statistics(self) -> Any:
        extents = self.extents.values()
        return Statistics(
            attachment_count=0,
            channel_count=len(self.channels),
            channel_message_counts={n: extent.messages for n, extent in self.extents.items()},
            chunk_count=len(self.chunks),
            message_count=self.messages,
            message_start_time=min((extent.first_ns for extent in extents), default=0),
            message_end_time=max((extent.last_ns for extent in extents), default=0),
            metadata_count=len(self.metadata),
            schema_count=len(self.schemas),
        )

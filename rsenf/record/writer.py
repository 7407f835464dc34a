"""Writes messages to an MCAP file that stays readable after a crash, up to the last flush."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from rsenf.errors import RsenfError, SchemaMismatch
from rsenf.messages import Frame, Header, Mark, VideoPacket, encode
from rsenf.messages.codec import header_of, parse, serialise
from rsenf.messages.schema import to_wire
from rsenf.record.container import StoredMessage
from rsenf.record.growing import GrowingFile
from rsenf.record.index import Index
from rsenf.record.provenance import program_facts
from rsenf.record.reader import last_headers
from rsenf.record.sequence import RECENT_NS, Continuity, Timeline, TopicTally
from rsenf.record.topics import Channels, to_foxglove, topics_of
from rsenf.timebase import NS_PER_S, nanoseconds

# Classes that are recorded in another form than they are sent: frames without pixels, and packets
# with their picture in Foxglove's schema.
REFORMED = (Frame, VideoPacket)
PIXELS = ("ring", "ring_slot", "ring_ticket", "pixels")


def continuity_after(paths: Iterable[Path], clock_ns: Callable[[], int]) -> Continuity:
    """Return the state of a recording that another process began: what it holds isn't new.

    Parameters
    ----------
    paths : iterable of Path
        Its files, oldest first. Left out are those that can't be read, and those last written to
        longer ago than any sender keeps its rows.
    clock_ns : callable
        Wall clock, UTC since 1970, in ns.
    """
    last: dict[str, Header] = {}
    for path in paths:
        with suppress(RsenfError, OSError):
            if clock_ns() - path.stat().st_mtime_ns <= RECENT_NS:
                last |= last_headers(path)
    tallies = {topic: TopicTally.after(header) for topic, header in last.items()}
    return Continuity(Timeline(clock_ns), tallies, last)


class Recorder:
    """A new recording. Not thread-safe.

    Messages are in the file, and on the disk, at most ``flush_every_s`` later, provided that
    :meth:`tick` is called while no messages arrive. The file has its final name from the start; if
    the process is killed, everything up to the last flush is readable.

    Video packets are recorded in Foxglove's schema, with a companion topic ``<topic>/index`` that
    has everything but the pictures. Frames are recorded without their pixels.

    Parameters
    ----------
    path : path
        The file to write.
    run_info : mapping
        Facts about the run: its id, configuration, input. Without secrets.
    clock_ns : callable
        Wall clock, UTC since 1970, in ns.
    flush_every_s : float
        Longest time between two flushes.
    fsync : bool
        Whether a flush waits for the disk, so that a power failure loses no more than a kill.
    compress : bool
        Whether to compress with Zstandard.
    overwrite : bool
        Whether an existing file may be replaced.
    continuity : Continuity, optional
        State of the previous file, if this one continues it.

    Attributes
    ----------
    tallies : dict of str to TopicTally
        Messages, duplicates and misses by topic.

    Raises
    ------
    UsageError
        When the file exists, or its folder doesn't.
    RecordingError
        When nothing can be written there.
    """

    def __init__(
        self,
        path: str | Path,
        *,
        run_info: Mapping[str, Any],
        clock_ns: Callable[[], int],
        flush_every_s: float = 0.5,
        fsync: bool = True,
        compress: bool = True,
        overwrite: bool = False,
        continuity: Continuity | None = None,
    ) -> None:
        self.path = Path(path)
        self._continuity = continuity or Continuity(Timeline(clock_ns))
        self.tallies, self._timeline = self._continuity.tallies, self._continuity.timeline
        self._clock_ns = clock_ns
        self._flush_every_ns = nanoseconds(flush_every_s)
        now_ns = self._flushed_ns = clock_ns()
        created = datetime.fromtimestamp(now_ns // NS_PER_S, UTC).isoformat()
        self._file = GrowingFile(
            self.path,
            _strings({**program_facts(), "created_utc": created, **run_info}),
            self._notes,
            compress=compress,
            fsync=fsync,
            overwrite=overwrite,
        )
        self._channels = Channels(self._file.index, self._file.chunk)

    def __enter__(self) -> Recorder:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    @property
    def resumed(self) -> dict[str, Header]:
        """Header of the last message of each topic, where this continues another's recording."""
        return self._continuity.resumed

    @property
    def size_bytes(self) -> int:
        """Size of the file, plus the pending chunk before compression."""
        return self._file.size_bytes

    def write(self, topic: str, message: Any) -> bool:
        """Record a message, unless it is a duplicate by its sequence number.

        Parameters
        ----------
        topic : str
            Key on the bus.
        message : a class of :mod:`rsenf.messages`

        Returns
        -------
        bool
            Whether it was new.

        Raises
        ------
        SchemaMismatch
            When the topic has messages of another class, or the message has no header.
        RecordingError
            When writing fails; messages flushed before are safe in a closed file.
        """
        cls, header = type(message), message.header
        if not self._takes(topic, cls, header):
            return False
        if cls in REFORMED:
            self._put_reformed(topic, cls, to_wire(message), header)
        else:
            self._put_message(topic, cls, encode(message), header)
        return True

    def write_encoded(
        self, topic: str, cls: type[Any], payload: bytes, header: Header | None = None
    ) -> bool:
        """Record a serialised message, of which only the header is decoded; see :meth:`write`.

        Frames and video packets, which are recorded in another form, are parsed.

        Parameters
        ----------
        topic : str
            Key on the bus.
        cls : type
            Class of the message.
        payload : bytes
        header : Header, optional
            Its header, if decoded already.
        """
        wire = parse(cls, payload) if cls in REFORMED else None
        header = header or header_of(payload)
        if not self._takes(topic, cls, header):
            return False
        if wire is not None:
            self._put_reformed(topic, cls, wire, header)
        else:
            self._put_message(topic, cls, payload, header)
        return True

    def add_metadata(self, name: str, values: Mapping[str, Any]) -> None:
        """Add a metadata record, at any time; values become strings."""
        self._file.check_open()
        self._file.add_metadata(name, _strings(values))

    def tick(self) -> None:
        """Flush if due. To be called often while no messages arrive."""
        since_ns = self._clock_ns() - self._flushed_ns
        if not 0 <= since_ns < self._flush_every_ns:  # also if the clock was set back
            self.flush()

    def flush(self) -> None:
        """Write all pending messages to the file, and wait for the disk."""
        self._file.check_open()
        self._file.flush()
        self._flushed_ns = self._clock_ns()

    def close(self) -> None:
        """Write the end of the file. Does nothing if already closed, or after a failure."""
        self._file.close()

    def _takes(self, topic: str, cls: type[Any], header: Header | None) -> bool:
        self._file.check_open()
        if header is None:
            raise SchemaMismatch(f"{topic}: a {cls.__name__} without a header")
        self._channels.check(topic, cls)
        return self._continuity.tally(topic).take(header)

    def _put_message(self, topic: str, cls: type[Any], payload: bytes, header: Header) -> None:
        log_time_ns = self._timeline.log_time_ns(cls, header)
        self._put(self._channels.of_messages(topic, cls), payload, header, log_time_ns)
        self._after_message()

    def _put_reformed(self, topic: str, cls: type[Any], wire: Any, header: Header) -> None:
        """Record a frame or a video packet, given as its Protobuf twin, which is modified."""
        if cls is VideoPacket:
            self._put_video(topic, wire, header)
            return
        for name in PIXELS:
            wire.ClearField(name)
        self._put_message(topic, cls, serialise(wire), header)

    def _put_video(self, topic: str, packet: Any, header: Header) -> None:
        log_time_ns = self._timeline.log_time_ns(VideoPacket, header)
        picture = to_foxglove(packet, log_time_ns) if header.mark == Mark.DATA else None
        if picture is not None:
            channel_id = self._channels.of_pictures(topic, picture.schema)
            self._put(channel_id, picture.payload, header, log_time_ns)
            packet.ClearField("data")
        # The companion follows its picture in the same chunk: neither can be lost alone, and the
        # reader joins them again.
        self._put(self._channels.of_packets(topic), serialise(packet), header, log_time_ns)
        self._after_message()

    def _put(self, channel_id: int, payload: bytes, header: Header, log_time_ns: int) -> None:
        arrival_ns = self._timeline.arrival_ns(header)
        sequence = header.seq & 0xFFFFFFFF  # MCAP has 32-bit sequence numbers
        self._file.chunk.add_message(
            StoredMessage(channel_id, sequence, log_time_ns, arrival_ns, payload)
        )

    def _after_message(self) -> None:
        self._file.cut_when_full()
        self.tick()

    def _notes(self, index: Index, reason: str) -> dict[str, str]:
        notes = {"reason": reason}
        for name, topic in topics_of(index).items():
            notes[f"messages {name}"] = str(topic.messages)
        for name, tally in self.tallies.items():
            notes[f"missed {name}"] = str(tally.missed)
            notes[f"duplicates {name}"] = str(tally.duplicates)
            notes[f"joined_at {name}"] = str(tally.joined_at)
            if tally.first and tally.last:
                notes[f"first {name}"], notes[f"last {name}"] = str(tally.first), str(tally.last)
        return notes


def _strings(values: Mapping[str, Any]) -> dict[str, str]:
    return {str(key): str(value) for key, value in values.items()}

"""Envelopes of messages, and the sequence numbers received of each stream."""

from __future__ import annotations

import time
from collections import Counter, defaultdict, deque
from dataclasses import dataclass, field

from rsenf.messages import Header

# Earlier runs remembered for each stream: more than any sender keeps messages of.
MOST_LEFT = 64
# A stream belongs to the run that sends it until its END mark, or until it pauses for this long.
KEEPS_S = 2.0
MOST_ABSENT = 1 << 32  # no sequence number leaps so far


@dataclass(frozen=True)
class Envelope:
    """A serialised message in transit.

    Parameters
    ----------
    key : str
        Destination.
    encoding : str
        Media type and schema, as declared by the sender.
    payload : bytes
    sender : str
        Session that sent it; each sender numbers its messages independently.
    droppable : bool
        Whether the sender prefers loss to blocking.
    kept : bool
        Whether the sender keeps its messages for a while, for recovery.
    late : bool
        Whether it was recovered from the sender's kept messages.
    stored : bool
        Whether it came from its sender's kept messages, recovered or as history.
    arrived_s : float
        When it arrived, on this process's monotonic clock.
    """

    key: str
    encoding: str
    payload: bytes
    sender: str
    droppable: bool = False
    kept: bool = False
    late: bool = False
    stored: bool = False
    arrived_s: float = field(default_factory=time.monotonic, compare=False)


def place_of(sender: str, header: Header) -> str:
    """Identify a message's place in its sender's stream, by sender, run, epoch and number."""
    return f"{sender}:{header.run_id}:{header.epoch}:{header.seq}"


class SequenceCheck:
    """Tracks the sequence numbers of every stream: the messages of one sender to one key."""

    def __init__(self) -> None:
        self._last: dict[tuple[str, str], Header] = {}
        self._left: dict[tuple[str, str], deque[str]] = {}  # runs before the present one
        self._newest: dict[str, str] = {}
        self._dropped: Counter[tuple[str, str]] = Counter()
        self._covered: dict[str, Header] = {}  # of the last message of each key
        self._resumed: dict[str, Header] = {}  # what this reader took before it was restarted
        # Runs of each key whose process was followed by another, and the last gap between two.
        self._ended: defaultdict[str, deque[str]] = defaultdict(lambda: deque(maxlen=MOST_LEFT))
        self._gaps: dict[str, tuple[Header, Header]] = {}
        # Sender and run of each key's stream, and until when it is theirs.
        self._owners: dict[str, tuple[str, str, float]] = {}

    def newest(self, key: str) -> str:
        """Return the place of the last message of a key; empty before the first."""
        return self._newest.get(key, "")

    def is_foreign(self, item: Envelope, header: Header) -> bool:
        """Whether a message comes into the stream of another sender and run, which goes on.

        Two runs of one graph on a bus, say, or a forged message. The runs of restarted nodes have
        the first one's name, with a suffix.
        """
        if item.late or item.key not in self._owners:
            return False
        sender, run, until_s = self._owners[item.key]
        is_other = item.sender != sender and _first_run(header) != run
        return is_other and item.arrived_s < until_s

    def resume(self, last: dict[str, Header]) -> None:
        """Continue after the last message of each key that this reader took before its restart."""
        self._resumed = last
        self._covered = {key: header for key, header in last.items() if header.frame_last >= 0}

    def absent(self, item: Envelope, header: Header) -> int:
        """Return how many messages are missing before this one; negative for a duplicate."""
        last = self._last.get((item.key, item.sender))
        if last is None:
            before = self._resumed.get(item.key, header)
            is_same = (before.run_id, before.epoch) == (header.run_id, header.epoch)
            return max(0, header.seq - before.seq - 1) if is_same else 0
        if last.run_id != header.run_id:
            return -1 if header.run_id in self._left.get((item.key, item.sender), ()) else 0
        if header.epoch < last.epoch:
            return -1
        return header.seq - (last.seq if header.epoch == last.epoch else -1) - 1

    def begins_epoch(self, item: Envelope, header: Header) -> bool:
        """Whether it begins a new epoch or run. The numbers can't tell where the last one ended."""
        last = self._last.get((item.key, item.sender))
        return last is not None and (last.run_id, last.epoch) != (header.run_id, header.epoch)

    def uncovered(self, key: str, header: Header, *, whole: bool) -> tuple[int, int]:
        """Return how many messages, and frames, are missing before one, as a node was restarted.

        A restarted sender goes on with the numbers of its frames, as a run of its own. Where a
        reader was behind, messages of the process before may come after its first ones: they were
        counted as missing, so that the results are negative.

        Parameters
        ----------
        key : str
        header : Header
            Of a row block or an estimate, or the END mark of a stream of them.
        whole : bool
            Whether this reader was there from the first frame on.
        """
        last, before = self._covered.get(key), header.run_id.rpartition(".")[0]
        if header.run_id in self._ended[key]:
            return self._late(key, header)
        if header.frame_last >= 0:
            self._covered[key] = header
        if last is None:
            last = Header(run_id=before if whole else "", epoch=header.epoch, seq=-1)
        runs = (last.run_id, last.run_id.rpartition(".")[0])
        resumes = header.run_id == last.run_id and last is self._resumed.get(key)
        follows = header.run_id != last.run_id and before and before in runs
        if header.epoch != last.epoch or not (resumes or follows):
            return 0, 0
        until = header.frame_last if header.is_end else header.frame_first - 1
        frames = max(0, until - last.frame_last)
        if resumes or header.is_end:  # `absent` counts the messages
            return 0, frames
        self._ended[key].append(last.run_id)
        self._gaps[key] = last, header
        return max(0, header.seq - last.seq - 1), frames

    def _late(self, key: str, header: Header) -> tuple[int, int]:
        """Return what a message fills of the gap after its run, as negative counts."""
        last, following = self._gaps[key]
        is_in_gap = last.run_id == header.run_id and last.seq < header.seq < following.seq
        if header.is_end or not is_in_gap or last.epoch != header.epoch:
            return 0, 0
        self._gaps[key] = header, following
        frames = min(header.frame_last, following.frame_first - 1) - last.frame_last
        return last.seq - header.seq, -max(0, frames)

    def dropped(self, item: Envelope) -> None:
        """Note that the inbox has dropped a message."""
        self._dropped[item.key, item.sender] += 1

    def took(self, item: Envelope, header: Header) -> int:
        """Note a message that is passed to the reader; return how many before it were missed."""
        stream, absent = (item.key, item.sender), self.absent(item, header)
        last = self._last.get(stream)
        dropped = min(absent, self._dropped[stream])
        if last is not None and (last.run_id, last.epoch) == (header.run_id, header.epoch):
            self._dropped[stream] -= dropped
        else:
            del self._dropped[stream]
        if last is not None and last.run_id != header.run_id:
            self._left.setdefault(stream, deque(maxlen=MOST_LEFT)).append(last.run_id)
        self._last[stream] = header
        self._newest[item.key] = place_of(item.sender, header)
        if not item.late:
            until_s = 0.0 if header.is_end else item.arrived_s + KEEPS_S
            self._owners[item.key] = item.sender, _first_run(header), until_s
        return absent - dropped


def _first_run(header: Header) -> str:
    """Return a run's name without the suffixes of restarted nodes."""
    return header.run_id.partition(".")[0]

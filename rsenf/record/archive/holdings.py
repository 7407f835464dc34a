"""Coverage of a camera in an archive over a time span, and its gaps."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from rsenf.record.archive.index import TOO_FEW, Entry, TopicSummary, pause_ns
from rsenf.record.archive.layout import Camera
from rsenf.record.index import Stretch, joined, span_of
from rsenf.record.sequence import MessagePlace

# Topics of events, in which pauses are no gaps.
EVENTS = ("alarm",)


class HoldingGap(NamedTuple):
    """A time span without messages, or with fewer than were sent."""

    first_ns: int
    last_ns: int
    missing: int | None  # missing messages, by sequence numbers; None if unknown


@dataclass(frozen=True)
class TopicHolding:
    """Coverage of a topic."""

    messages: int  # messages in all files in which the topic overlaps with the requested time
    missed: int  # messages that never arrived while these files were written, by their own count
    stretches: list[Stretch]  # times with messages, within the requested time
    # None where gaps have no meaning: for events, and for estimates of a whole stream
    gaps: list[HoldingGap] | None
    pause_ns: int  # longest pause that is no gap
    coarse_ns: int  # if there were too many gaps to store: the longest one omitted. Otherwise 0

    @property
    def covered_ns(self) -> int:
        """Total length of the times with messages."""
        return sum(s.last_ns - s.first_ns for s in self.stretches)


@dataclass(frozen=True)
class Holding:
    """Coverage of a camera over a time span."""

    camera: Camera
    asked: Stretch
    files: list[Entry]
    topics: dict[str, TopicHolding]


def holding(entries: Iterable[Entry], camera: Camera, asked: Stretch) -> Holding:
    """Determine the coverage of a camera.

    Parameters
    ----------
    entries : iterable of Entry
        Files of the archive.
    camera : Camera
    asked : Stretch
        Requested time span, in log time (UTC, ns).
    """
    of_camera = [entry for entry in entries if entry.file.camera == camera]
    # An unreadable file counts by its name.
    spans = [(e, e.summary.extent or Stretch(e.file.start_ns, e.file.start_ns)) for e in of_camera]
    files = [entry for entry, span in spans if _overlap(span, asked)]
    names = dict.fromkeys(name for entry in files for name in entry.summary.topics)
    found = {
        name: _topic(
            name, [e.summary.topics[name] for e in files if name in e.summary.topics], asked
        )
        for name in names
    }
    return Holding(camera, asked, files, found)


def extent_of(entries: Iterable[Entry], camera: Camera) -> Stretch | None:
    """Return the time from a camera's first message to its last; None without any."""
    extents = (e.summary.extent for e in entries if e.file.camera == camera)
    return span_of(filter(None, extents))


def _overlap(one: Stretch, other: Stretch) -> bool:
    return one.first_ns <= other.last_ns and other.first_ns <= one.last_ns


def _topic(name: str, parts: Sequence[TopicSummary], asked: Stretch) -> TopicHolding:
    """Combine the parts of a topic in several files."""
    every = [stretch for part in parts for stretch in part.stretches]
    messages = sum(part.messages for part in parts)
    of_all = any(part.of_all_so_far for part in parts)
    counted = [part for part in parts if of_all or _overlap(part.extent, asked)]
    usual_ns = pause_ns(every, messages)
    there = joined(every, usual_ns)
    eventful = of_all or name.rsplit("/", 1)[-1] in EVENTS or messages < TOO_FEW
    return TopicHolding(
        sum(part.messages for part in counted),
        sum(part.missed or 0 for part in counted),
        _within(there, asked),
        None if eventful else _gaps(there, _missing(parts), asked, usual_ns),
        usual_ns,
        max((part.coarse_ns for part in counted), default=0),
    )


def _within(stretches: Iterable[Stretch], asked: Stretch) -> list[Stretch]:
    cut = (
        Stretch(max(s.first_ns, asked.first_ns), min(s.last_ns, asked.last_ns)) for s in stretches
    )
    return [s for s in cut if s.first_ns <= s.last_ns]


def _missing(parts: Sequence[TopicSummary]) -> dict[Stretch, int]:
    """Return the sequence numbers missing between consecutive files, where known."""
    found: dict[Stretch, int] = {}
    reached: tuple[MessagePlace, int] | None = None  # place and time of the last message so far
    for part in sorted((p for p in parts if p.stretches), key=lambda p: p.stretches[0]):
        if not (
            part.first and part.last
        ):  # truncated or damaged: its last number is unknown, and so is the gap after it
            reached = None
            continue
        first, last = MessagePlace.read(part.first), MessagePlace.read(part.last)
        if reached and reached[0][:2] == first[:2]:
            end, end_ns = reached
            count = first.seq - end.seq - 1
            if count >= 0:
                found[Stretch(end_ns, part.stretches[0].first_ns)] = count
            if last < end:  # all of it is in an earlier file too, such as a recording of an alarm
                continue
        reached = (last, part.stretches[-1].last_ns)
    return found


def _gaps(
    there: Sequence[Stretch], missing: dict[Stretch, int], asked: Stretch, usual_ns: int
) -> list[HoldingGap]:
    """List missing times and numbers, including the time before the first and after the last."""
    edges = [asked.first_ns, *(t for s in _within(there, asked) for t in s), asked.last_ns]
    pauses = [
        Stretch(first_ns, last_ns)
        for first_ns, last_ns in zip(edges[::2], edges[1::2], strict=True)
        if last_ns - first_ns > usual_ns
    ]
    gaps = [HoldingGap(*pause, missing.get(pause)) for pause in pauses]
    for between, count in missing.items():
        inside = asked.first_ns <= between.first_ns and between.last_ns <= asked.last_ns
        if count and inside and between not in pauses:
            gaps.append(HoldingGap(*between, count))
    return sorted(gaps)

"""Selects what to export: a run and epoch of a topic, or its rows with the camera's idle ratio."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from typing import NamedTuple

from rsenf.errors import InputError, UsageError
from rsenf.messages import Header, IdleEstimate, Mark, RowBlock
from rsenf.record.reader import Recording

IDLE = "/idle"


class RecordedLight:
    """Row blocks of one epoch of one run, with the recorded estimate of the idle ratio.

    Parameters
    ----------
    recording : Recording
    topic : str
        Topic of the row blocks.
    part : Part
        Must select one epoch of one run, since times don't continue from one to the next.

    Raises
    ------
    UsageError
        When the topic has no row blocks, or several epochs are selected.
    InputError
        When no rows can be read.
    """

    def __init__(self, recording: Recording, topic: str, part: Part) -> None:
        if recording.topics[topic].schema != "rsenf.RowBlock":
            raise UsageError(f"{topic} is no light that could be heard", "a sound is made of rows")
        self._recording, self._topic = recording, topic
        found = dict.fromkeys(Part(b.header.run_id, b.header.epoch) for b in self._all(part))
        if len(found) > 1:
            there = ", ".join(f"epoch {one.epoch} of run {one.run!r}" for one in found)
            raise UsageError(
                f"{recording.path}: the source restarted: {there}", "choose with --run, --epoch"
            )
        if not found:
            raise InputError(f"{recording.path}: no rows of {topic} that could be heard")
        self.part = next(iter(found))

    def blocks(self) -> Iterator[RowBlock]:
        """Read the row blocks; unreadable ones are skipped."""
        return self._all(self.part)

    @property
    def idle_ratio(self) -> float:
        """Recorded idle ratio; 0 for means of whole frames, which have no rows.

        Raises
        ------
        UsageError
            When the recording has no estimate.
        """
        if next(self.blocks()).read_out_axis == "frame":
            return 0.0
        if self._idle is None:
            raise UsageError(
                f"{self._recording.path}: the camera's idle period isn't in it, so the pitch "
                "of a sound can't be right",
                "give it with --idle-ratio; 'rsenf idle' finds it",
            )
        return self._idle.idle_ratio

    @property
    def upwards(self) -> bool:
        """Whether the recording says that the last row is read first."""
        return self._idle is not None and self._idle.direction == "reverse"

    @cached_property
    def _idle(self) -> IdleEstimate | None:
        topic = self._topic.rpartition("/")[0] + IDLE
        if topic not in self._recording.topics:
            return None
        latest = None
        for _, message, _ in self._recording.messages([topic], tolerant=True):
            if self.part.has(message.header) and message.verdict == "estimated":
                latest = message
        return latest

    def _all(self, part: Part) -> Iterator[RowBlock]:
        for _, message, _ in self._recording.messages([self._topic], tolerant=True):
            if message.header.mark == Mark.DATA and message.frames and part.has(message.header):
                yield message


class Part(NamedTuple):
    """Selection of a topic's messages; None selects all."""

    run: str | None = None  # identity of the run, or a prefix of it
    epoch: int | None = None

    def has(self, header: Header) -> bool:
        """Whether a message with this header is selected.

        Examples
        --------
        >>> Part("ab").has(Header(run_id="abc", epoch=3)), Part("ab", 2).has(Header(run_id="abc"))
        (True, False)
        """
        return header.run_id.startswith(self.run or "") and self.epoch in (None, header.epoch)

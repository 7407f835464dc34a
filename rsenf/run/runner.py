"""The life of a stage: fed message by message, flushed at the end, renewed with each epoch.

Every way of running rsenf goes through here: a node process has one :class:`Runner` for each
camera, the one-process commands a :class:`Chain` of them. So batch, stream and replay can't
differ.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rsenf.messages import EnfEstimate, Frame, Header, Mark, MatchResult, RowBlock
from rsenf.stage import Stage

# What each stage sends, for the mark that ends its stream.
OUTPUTS: dict[str, type[Any]] = {
    "frames": Frame,
    "rows": RowBlock,
    "track": EnfEstimate,
    "match": MatchResult,
}


class Runner:
    """One stage of one camera.

    Parameters
    ----------
    topic : str
        Topic that the stage's messages go to; tells their class.
    make_stage : callable
        Builds a fresh stage. Called for every epoch, so that none mixes two.
    inputs : int
        Streams that must have ended before the stage has: 1, or 2 with a reference. A stage with
        a reference keeps it across epochs, and tells them apart by itself.
    """

    def __init__(self, topic: str, make_stage: Callable[[], Stage], inputs: int = 1) -> None:
        self.topic = topic
        self._make_stage = make_stage
        self._stage = make_stage()
        self._inputs, self._open = inputs, inputs
        self._stream: tuple[str, int] | None = None
        self._last: Header | None = None
        self.ended = False

    def feed(self, message: Any) -> list[Any]:
        """Give the stage a message; return what it completes, an END mark when all has ended."""
        header: Header = message.header
        if header.is_end:
            return self.end(header)
        out = self._renew(header) if self._inputs == 1 else []
        return out + self._sent(self._stage.update(message))

    def end(self, header: Header) -> list[Any]:
        """One input has ended, or will never come; the last one ends the stage."""
        self._open -= 1
        if self._open > 0 or self.ended:
            return []
        self.ended = True
        out = self._sent(self._stage.flush())
        last = self._last or header
        seq = last.seq + 1 if self._last else 0
        return [*out, OUTPUTS[self.topic](header=last.numbered(seq, Mark.END))]

    def _renew(self, header: Header) -> list[Any]:
        """Finish the epoch before and start anew, when this message begins another."""
        stream = (header.run_id, header.epoch)
        before, self._stream = self._stream, stream
        if before in (None, stream):
            return []
        out = self._sent(self._stage.flush())
        self._stage = self._make_stage()
        self._last = None
        return out

    def _sent(self, messages: list[Any]) -> list[Any]:
        if messages:
            self._last = messages[-1].header
        return messages


class Chain:
    """Stages of one camera in one process, each fed with what the one before it completes.

    Parameters
    ----------
    runners : sequence of Runner
        In the order of the data.
    tap : callable, optional
        Called as ``tap(topic, message)`` with every message any of them sends.
    """

    def __init__(
        self, runners: list[Runner], tap: Callable[[str, Any], None] | None = None
    ) -> None:
        self._runners = runners
        self._tap = tap

    def feed(self, message: Any, first: int = 0) -> list[Any]:
        """Feed stage ``first``; return what the last stage completes."""
        if first == len(self._runners):
            return [message]
        out: list[Any] = []
        for sent in self._runners[first].feed(message):
            if self._tap:
                self._tap(self._runners[first].topic, sent)
            out += self.feed(sent, first + 1)
        return out

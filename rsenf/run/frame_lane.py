"""A lane whose messages are frames: they get their pixels from the ring, and give them back."""

from __future__ import annotations

from dataclasses import dataclass, field

from rsenf.bus.frames import FrameReceiver
from rsenf.bus.inbox import Received
from rsenf.errors import NodeFailed, SchemaMismatch
from rsenf.run.pump import Lane


@dataclass(kw_only=True)
class FrameLane(Lane):
    """A lane from frames.

    Parameters
    ----------
    frames : FrameReceiver
        Where their pixels come from.
    """

    frames: FrameReceiver = field(default_factory=FrameReceiver)

    def feed(self, received: Received) -> None:
        """Sample one frame; refuse one whose pixels aren't what it says (``SchemaMismatch``)."""
        try:
            frame = self.frames.open(received.message)
        except NodeFailed as exc:  # no such ring here; only one of this run has to be
            if received.message.header.run_id.partition(".")[0] == self.node.run_id:
                raise
            raise SchemaMismatch(str(exc)) from exc
        if frame is None:
            self.node.inbox.counters.dropped += 1
            return
        try:
            super().feed(Received(received.key, frame, received.payload))
        finally:
            self.frames.done()

"""A lane that reads frames: takes their pixels from the shared-memory ring, and returns them."""

from __future__ import annotations

from dataclasses import dataclass, field

from rsenf.bus.frames import FrameReceiver
from rsenf.bus.inbox import Received
from rsenf.errors import NodeFailed, SchemaMismatch
from rsenf.run.pump import Lane


@dataclass(kw_only=True)
class FrameLane(Lane):
    """A :class:`Lane` whose input is frames.

    Parameters
    ----------
    frames : FrameReceiver
        Gives frames their pixels.
    """

    frames: FrameReceiver = field(default_factory=FrameReceiver)

    def feed(self, received: Received) -> None:
        """Sample one frame; raises SchemaMismatch when its pixels don't match its description."""
        try:
            frame = self.frames.open(received.message)
        except NodeFailed as exc:  # no such ring on this host: a failure only for one of this run
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

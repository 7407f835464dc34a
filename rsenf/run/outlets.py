"""Outputs of a decode node: to the rows node, or to a rows stage in the same process."""

from __future__ import annotations

from rsenf.bus.bus import Publisher
from rsenf.bus.frames import FrameSender
from rsenf.bus.ring import PREFIX, remove_abandoned
from rsenf.config.graph import elsewhere, reader_of_frames
from rsenf.messages import Frame, Header, Mark
from rsenf.run.node import NodeProcess
from rsenf.run.peers import Peers
from rsenf.run.runner import Runner
from rsenf.stage import StageSpec


def open_frames(
    node: NodeProcess,
    camera: str,
    *,
    ring: bool,
    slots: int,
    live: bool = False,
    ahead: bool = False,
) -> FrameSender:
    """Open the output of a camera's frames to the node that samples them.

    Parameters
    ----------
    node : NodeProcess
    camera : str
    ring : bool
        Use a shared-memory ring, or without a reader send the descriptions of frames alone, for
        recording; else send pixels over the bus.
    slots : int
        Number of planes in a ring.
    live : bool, optional
        Whether the source can't wait for slow readers.
    ahead : bool, optional
        Whether frames come faster than real time, so that messages may be batched, and frames wait
        for a reader that is restarted.
    """
    frames = node.publisher(camera, "frames", live=live)
    reader = reader_of_frames(node.graph, camera)
    name = f"{PREFIX}{node.run_id}-{camera}" if ring and reader else ""
    remove_abandoned()
    departed = _Departed(node.peers, reader)
    waits = ahead and reader not in elsewhere(node.graph, node.name)

    def awaited() -> bool:
        return waits and node.peers.is_awaited(reader) and not node.stop.is_set()

    return FrameSender(
        frames, name, slots, departed, awaited=awaited, ahead=ahead, with_pixels=not ring
    )


class _Departed:
    """Whether a reader holds planes that it will never return: it is away, or was since asked."""

    def __init__(self, peers: Peers, reader: str) -> None:
        self._peers, self._reader = peers, reader
        self._seen = 0

    def __call__(self) -> bool:
        times, away = self._peers.departures(self._reader)
        if away:  # planes written now are lost, too: the departure counts until it is back
            return True
        before, self._seen = self._seen, times
        return times > before


class Fused:
    """A rows stage in the process that decodes.

    Parameters
    ----------
    stage : StageSpec
        The rows stage.
    rows : Publisher
        Sends its row blocks.
    ahead : bool
        As for :func:`open_frames`.
    """

    def __init__(self, stage: StageSpec, rows: Publisher, *, ahead: bool) -> None:
        self._runner = Runner.of(stage, 1)
        self._rows = rows
        self._ahead = ahead  # of real time: the next block follows at once

    def send(self, frame: Frame) -> None:
        """Sample a frame."""
        for block in self._runner.feed(frame):
            self._rows.send(block, more=self._ahead and not block.header.is_end)

    def finish(self, last: Header) -> None:
        """End the rows."""
        self.send(Frame(header=last.numbered(last.seq + 1, Mark.END)))

    def close(self) -> None:
        """Nothing is held."""


# Where a camera's frames go.
Outlet = FrameSender | Fused

"""Delivery classes of topics: blocking or dropping, queue length, history, priority."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Delivery:
    """Delivery class of a topic.

    Parameters
    ----------
    lossless : bool
        Sender: block on slow receivers (backpressure) instead of dropping. Receiver: let blocking
        senders wait while its queue is full, instead of dropping the oldest message. Messages that
        were sent as droppable are dropped in either case.
    queue : int
        Messages of one key that a receiver queues at most.
    history : int
        Messages that a sender offers to late joiners, and (if not 0) that a receiver requests.
    kept : int
        Messages that a sender keeps for recovery after a broken link; at least ``history``.
    urgent : bool
        Whether the topic has real-time priority.
    together_s : float
        Longest time that a message waits to be batched, in s, where its sender allows it.
    """

    lossless: bool
    queue: int
    history: int
    kept: int = 0
    urgent: bool = False
    together_s: float = 0.1

    @property
    def recovers(self) -> bool:
        """Whether a receiver requests missed messages; observers don't."""
        return self.lossless and self.history > 0


# File and replay topics block, live pictures are dropped; estimates are small and are kept.
FRAMES_FILE = Delivery(lossless=True, queue=16, history=0)
FRAMES_LIVE = Delivery(lossless=False, queue=16, history=0)
VIDEO = Delivery(lossless=True, queue=64, history=0, together_s=0.25)
# A live camera must not be blocked by a slow link between hosts.
VIDEO_LIVE = Delivery(lossless=False, queue=512, history=0, together_s=0.25)
SIGNALS = Delivery(lossless=True, queue=1024, history=600)
# 1200 blocks of 8 frames are 5 minutes at 30 frames a second.
ROWS = Delivery(lossless=True, queue=256, history=64, kept=1200)
# A node's last health message tells whether it finished or was lost: it must not be dropped, nor
# arrive long after the node's liveliness token has gone.
HEALTH = Delivery(lossless=True, queue=256, history=1, kept=300, urgent=True)
# For observers, which never block a sender.
LOOKING = Delivery(lossless=False, queue=256, history=1)


def delivery_of(topic: str, *, live: bool = False) -> Delivery:
    """Delivery class of a topic, of a live source or of a file."""
    if topic == "frames":
        return FRAMES_LIVE if live else FRAMES_FILE
    if topic == "video" and live:
        return VIDEO_LIVE
    return {"video": VIDEO, "rows": ROWS, "health": HEALTH}.get(topic, SIGNALS)

"""How each class of topic is delivered."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Delivery:
    """Delivery class of a topic.

    Parameters
    ----------
    lossless : bool
        The sender waits for slow receivers, and each receiver for its own queue. Otherwise the
        oldest waiting message is dropped and counted.
    queue : int
        Messages that may wait at a receiver.
    history : int
        Messages that the sender keeps for those who join late or again.
    """

    lossless: bool
    queue: int
    history: int


# Recording and replay wait, live pictures don't; estimates are small and are kept.
FRAMES_FILE = Delivery(lossless=True, queue=16, history=0)
FRAMES_LIVE = Delivery(lossless=False, queue=4, history=0)
SIGNALS = Delivery(lossless=True, queue=1024, history=600)
ROWS = Delivery(lossless=True, queue=256, history=64)
HEALTH = Delivery(lossless=False, queue=256, history=1)


def delivery_of(topic: str, *, live: bool = False) -> Delivery:
    """Delivery class of a topic of a live source or of a file."""
    if topic in ("frames", "video"):
        return FRAMES_LIVE if live else FRAMES_FILE
    if topic == "rows":
        return ROWS
    return HEALTH if topic == "health" else SIGNALS

"""How each class of topic is delivered."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Delivery:
    """Delivery class of a topic.

    Parameters
    ----------
    lossless : bool
        For a sender: wait for slow receivers, rather than drop. For a receiver: let senders that
        wait do so while its queue is full, rather than drop the oldest; what was sent to be
        dropped is dropped in any case.
    queue : int
        Messages of a key that may wait at a receiver.
    history : int
        Messages that a sender has for those who join late or again, and whether a receiver asks
        for them.
    kept : int
        Messages that a sender keeps for those who missed some, while a link was broken; as many
        as the history unless given.
    urgent : bool
        Overtakes other topics on the way.
    together_s : float
        For how long, at most, messages wait to go together, where their sender lets them.
    """

    lossless: bool
    queue: int
    history: int
    kept: int = 0
    urgent: bool = False
    together_s: float = 0.1

    @property
    def recovers(self) -> bool:
        """Whether a receiver asks for what it missed; who only looks doesn't."""
        return self.lossless and self.history > 0


# Recording and replay wait, live pictures don't; estimates are small and are kept.
FRAMES_FILE = Delivery(lossless=True, queue=16, history=0)
FRAMES_LIVE = Delivery(lossless=False, queue=16, history=0)
VIDEO = Delivery(lossless=True, queue=64, history=0, together_s=0.25)
# Between hosts a live camera doesn't wait for its pictures to be sent.
VIDEO_LIVE = Delivery(lossless=False, queue=512, history=0, together_s=0.25)
SIGNALS = Delivery(lossless=True, queue=1024, history=600)
# What is kept is some minutes: of blocks of 8 frames, 1200 are five at 30 frames a second.
ROWS = Delivery(lossless=True, queue=256, history=64, kept=1200)
# A node's last word decides whether it has finished or was lost: it must not be dropped, and not
# come long after the node's token has gone.
HEALTH = Delivery(lossless=True, queue=256, history=1, kept=300, urgent=True)
# For those who only look: they never make a sender wait.
LOOKING = Delivery(lossless=False, queue=256, history=1)


def delivery_of(topic: str, *, live: bool = False) -> Delivery:
    """Delivery class of a topic of a live source or of a file."""
    if topic == "frames":
        return FRAMES_LIVE if live else FRAMES_FILE
    if topic == "video" and live:
        return VIDEO_LIVE
    return {"video": VIDEO, "rows": ROWS, "health": HEALTH}.get(topic, SIGNALS)

"""Decoding goes on in a thread of its own while whoever takes the frames works on them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from rsenf.decode.pump import Disconnected, Pump, Stopped
from rsenf.decode.source import Item
from rsenf.decode.waiting import Stop
from rsenf.messages import Frame

# How far ahead: so many batches, each of so much luma, or of so many frames where they are small.
# The stages work on a second of video at once, and decoding should go on meanwhile; but a 4K
# picture is 12 MB. Batches, because two threads that meet at every frame hinder each other.
BATCHES = 3
BATCH_BYTES, BATCH_FRAMES = 4_000_000, 8
_FOREVER_S = float("inf")


@dataclass(frozen=True)
class Step:
    """What one packet gave, and what there is to say of the source once that has been taken."""

    items: list[Item]
    loss: str
    warnings: list[str]


def ahead(steps: Callable[[], Iterator[Step]], stop: Stop) -> Iterator[Step]:
    """Yield steps that another thread makes meanwhile.

    Parameters
    ----------
    steps : callable
        Returns them; called and iterated in that thread. What it raises is raised here, after the
        steps before it.
    stop : Stop
        Ends both. So does closing this iterator.
    """
    pump = Pump(lambda: _batches(steps()), stop, depth=BATCHES)
    try:
        while True:
            yield from pump.get(_FOREVER_S)
    except (Disconnected, Stopped):
        return
    finally:
        pump.close()


def _batches(steps: Iterator[Step]) -> Iterator[list[Step]]:
    batch: list[Step] = []
    frames = luma_bytes = 0
    try:
        for step in steps:
            batch.append(step)
            for item in step.items:
                if isinstance(item, Frame) and item.luma is not None:
                    frames, luma_bytes = frames + 1, luma_bytes + item.luma.nbytes
            if frames >= BATCH_FRAMES or luma_bytes >= BATCH_BYTES:
                yield batch
                batch, frames, luma_bytes = [], 0, 0
    except Exception:
        yield batch
        raise
    yield batch

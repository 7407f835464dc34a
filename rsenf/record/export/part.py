"""Which part of a recording is meant, where its source was started again."""

from __future__ import annotations

from typing import NamedTuple

from rsenf.messages import Header


class Part(NamedTuple):
    """Some of a topic's messages; all that it leaves open is meant.

    Attributes
    ----------
    run : str or None
        Identity of the run, or how it begins.
    epoch : int or None
        Which epoch of it.
    """

    run: str | None = None
    epoch: int | None = None

    def has(self, header: Header) -> bool:
        """Whether a message with this header belongs to it."""
        return header.run_id.startswith(self.run or "") and self.epoch in (None, header.epoch)

"""Selects a part of a recording whose source was restarted."""

from __future__ import annotations

from typing import NamedTuple

from rsenf.messages import Header


class Part(NamedTuple):
    """Selection of a topic's messages; None selects all.

    Attributes
    ----------
    run : str or None
        Identity of the run, or a prefix of it.
    epoch : int or None
    """

    run: str | None = None
    epoch: int | None = None

    def has(self, header: Header) -> bool:
        """Whether a message with this header is selected.

        Examples
        --------
        >>> Part("ab").has(Header(run_id="abc", epoch=3)), Part("ab", 2).has(Header(run_id="abc"))
        (True, False)
        """
        return header.run_id.startswith(self.run or "") and self.epoch in (None, header.epoch)

"""Notes on what was found and assumed while reading: one line each, with counts."""

from __future__ import annotations


class Notes:
    """Lines in the order of their first mention; a counted line ends with its count.

    Examples
    --------
    >>> notes = Notes()
    >>> notes.count("gaps", 2)
    >>> notes.count("gaps", 1)
    >>> notes.lines
    ['gaps: 3']
    """

    def __init__(self) -> None:
        self._counts: dict[str, int | None] = {}

    def say(self, text: str) -> None:
        """Add a line, unless it is there already."""
        self._counts.setdefault(text, None)

    def count(self, text: str, times: int) -> None:
        """Add to the count of a line; a count of 0 adds no line."""
        if times:
            self._counts[text] = (self._counts.get(text) or 0) + int(times)

    @property
    def lines(self) -> list[str]:
        """The lines so far."""
        return [text if n is None else f"{text}: {n}" for text, n in self._counts.items()]

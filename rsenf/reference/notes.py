"""What was found and assumed while reading: one line each, counted over the whole file."""

from __future__ import annotations


class Notes:
    """Lines in the order of their first mention; a counted one ends with how often it came."""

    def __init__(self) -> None:
        self._counts: dict[str, int | None] = {}

    def say(self, text: str) -> None:
        """Note a fact, once however often it is said."""
        self._counts.setdefault(text, None)

    def count(self, text: str, times: int) -> None:
        """Add to how often something came; never is not worth a line."""
        if times:
            self._counts[text] = (self._counts.get(text) or 0) + int(times)

    @property
    def lines(self) -> list[str]:
        """The notes so far."""
        return [text if n is None else f"{text}: {n}" for text, n in self._counts.items()]

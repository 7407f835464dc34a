"""What a stage is: messages in, messages out, and nothing else.

A stage knows no bus, no clock, no configuration file. The same object serves a node process, a
replay and the one-process commands, so that they can't differ by a bit.
"""

from __future__ import annotations

from typing import Any, Protocol


class Stage(Protocol):
    """One step of the pipeline."""

    def update(self, message: Any) -> list[Any]:
        """Take one message; return those that it completed, in order."""
        ...

    def flush(self) -> list[Any]:
        """Return what the end of the stream completes. Nothing may follow."""
        ...

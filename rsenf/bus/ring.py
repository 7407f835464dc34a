"""Frames between two processes of one host: a ring of luma planes in shared memory.

Only a small descriptor crosses the bus. One writer, one reader. Every slot has a ticket, written
by the writer after the plane, and a receipt, written by the reader when it is done with it. A
lossless writer waits for the receipt before it uses a slot again; a live one doesn't, and the
reader finds by the ticket that the plane was overwritten.

The memory is a file in ``/dev/shm`` mapped by both: Python's own ``shared_memory`` removes the
segment when *any* process that attached to it ends (bpo-38119).
"""

from __future__ import annotations

import contextlib
import mmap
import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rsenf.errors import NodeFailed, SchemaMismatch

_MAGIC = 0x52534E4652494E47  # 'RSNFRING'
_VERSION = 1
# magic, version, slots, bytes of a slot, lossless; then tickets and receipts.
_HEAD = 5
_POLL_S = 0.0002


def ring_directory() -> Path:
    """Where rings live: memory where there is some, else the temporary files."""
    shm = Path("/dev/shm")
    return shm if os.access(shm, os.W_OK) else Path(tempfile.gettempdir())


class _Ring:
    def __init__(self, path: Path, memory: mmap.mmap, slots: int, slot_bytes: int) -> None:
        self.path = path
        self._memory = memory
        words = _HEAD + 2 * slots
        counters = np.frombuffer(memory, np.int64, words)
        self._head = counters[:_HEAD]
        self._ticket = counters[_HEAD : _HEAD + slots]
        self._receipt = counters[_HEAD + slots :]
        planes = np.frombuffer(memory, np.uint8, slots * slot_bytes, offset=8 * words)
        self._planes = planes.reshape(slots, slot_bytes)
        self.slot_bytes = slot_bytes

    def close(self) -> None:
        """Let go of the memory; views of it that are still held keep it alive."""
        del self._head, self._ticket, self._receipt, self._planes
        with contextlib.suppress(BufferError):
            self._memory.close()


class RingWriter(_Ring):
    """Writer's end. Removes the ring when closed.

    Parameters
    ----------
    name : str
        File name of the ring, unique on this host.
    slots : int
        Planes that may be under way.
    slot_bytes : int
        Largest plane.
    lossless : bool
        Wait for the reader rather than overwrite what it hasn't read.
    """

    def __init__(self, name: str, slots: int, slot_bytes: int, *, lossless: bool) -> None:
        path = ring_directory() / name
        size = 8 * (_HEAD + 2 * slots) + slots * slot_bytes
        with path.open("xb+") as file:
            # Reserve the memory now: a full /dev/shm must fail here, not as a bus error later.
            os.posix_fallocate(file.fileno(), 0, size)
            memory = mmap.mmap(file.fileno(), size)
        super().__init__(path, memory, slots, slot_bytes)
        self._lossless = lossless
        self._written = 0
        self.overwritten = 0
        self._head[:] = (_MAGIC, _VERSION, slots, slot_bytes, int(lossless))

    def write(self, luma: NDArray[np.uint8], give_up: Callable[[], bool]) -> tuple[int, int]:
        """Copy a plane into the next slot; returns the slot and its ticket.

        Raises
        ------
        NodeFailed
            When a lossless writer waits for the reader and ``give_up()`` says so.
        """
        slot = self._written % self._ticket.size
        while self._receipt[slot] != self._ticket[slot]:
            if not self._lossless:
                self.overwritten += 1
                break
            if give_up():
                raise NodeFailed("nobody reads the frames any more")
            time.sleep(_POLL_S)
        self._written += 1
        # An overwritten plane must not look whole while it is being replaced.
        self._ticket[slot] = -self._written
        plane = self._planes[slot, : luma.size].reshape(luma.shape)
        np.copyto(plane, luma)
        self._ticket[slot] = self._written
        return slot, self._written

    def drained(self) -> bool:
        """Whether the reader is done with every plane."""
        return bool(np.array_equal(self._ticket, self._receipt))

    def close(self) -> None:
        """Remove the ring."""
        self.path.unlink(missing_ok=True)
        super().close()


class RingReader(_Ring):
    """Reader's end."""

    def __init__(self, name: str) -> None:
        path = ring_directory() / name
        try:
            with path.open("rb+") as file:
                memory = mmap.mmap(file.fileno(), 0)
        except OSError as exc:
            raise NodeFailed(f"no frame ring {name} on this host", "use 'frames: tcp'") from exc
        head = [int(x) for x in np.frombuffer(memory, np.int64, _HEAD)]
        magic, version, slots, slot_bytes, lossless = head
        if (magic, version) != (_MAGIC, _VERSION):
            raise SchemaMismatch(f"{name} is not a frame ring of version {_VERSION}")
        super().__init__(path, memory, slots, slot_bytes)
        self.lossless = bool(lossless)

    def view(
        self, slot: int, ticket: int, height_px: int, width_px: int
    ) -> NDArray[np.uint8] | None:
        """Plane of a ticket, not copied, or None when it was overwritten meanwhile."""
        if self._ticket[slot] != ticket:
            return None
        return self._planes[slot, : height_px * width_px].reshape(height_px, width_px)

    def release(self, slot: int, ticket: int) -> bool:
        """Give the slot back; False when the plane changed while it was read."""
        whole = bool(self._ticket[slot] == ticket)
        if whole:
            self._receipt[slot] = ticket
        return whole

"""Single-producer, single-consumer ring buffer of luma planes in shared memory.

Only a small descriptor crosses the bus. Each slot has a ticket, which the writer sets after the
plane, and a receipt, which the reader sets when it is done with the plane. A lossless writer waits
for the receipt before it reuses a slot. A live writer waits only briefly; the reader then finds by
the ticket that the plane was overwritten.

The memory is a file in ``/dev/shm`` mapped by both: Python's ``shared_memory`` removes the segment
when *any* process that attached to it ends (bpo-38119).
"""

from __future__ import annotations

import contextlib
import fcntl
import mmap
import os
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rsenf.bus.keys import is_name
from rsenf.errors import NodeFailed, SchemaMismatch

_MAGIC = 0x52534E4652494E47  # 'RSNFRING'
_VERSION = 1
# Words: magic, version, slots, bytes of a slot, lossless; then tickets and receipts.
_HEAD = 5
_POLL_S = 0.001
# Longest wait of a live writer per frame: network cameras send in bursts. It allows 100 frames a
# second even if the reader hangs.
LIVE_PATIENCE_S = 0.01
# That of any other: as long as Zenoh lets a sender block.
PATIENCE_S = 3600.0
PREFIX = "rsenf-"  # of the names of a graph's rings
YOUNG_S = 10.0  # a ring may be without its writer's lock for a moment at first


def ring_directory() -> Path:
    """Return the directory of rings: ``/dev/shm`` if writable, else that of temporary files."""
    shm = Path("/dev/shm")
    return shm if os.access(shm, os.W_OK) else Path(tempfile.gettempdir())


def remove_abandoned() -> int:
    """Remove rings whose writer was killed; return how many.

    A writer holds a shared lock on its ring as long as it lives, which the kernel lets go.
    """
    removed = 0
    for path in ring_directory().glob(f"{PREFIX}*"):
        with contextlib.suppress(OSError), path.open("rb") as file:
            is_young = time.time() - os.fstat(file.fileno()).st_mtime < YOUNG_S
            if is_young or file.read(8) != _MAGIC.to_bytes(8, sys.byteorder):
                continue
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            path.unlink()
            removed += 1
    return removed


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
        """Unmap the memory; views that still exist keep it alive."""
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
        Capacity in planes.
    slot_bytes : int
        Size of the largest plane.
    lossless : bool
        Whether to wait for the reader, instead of overwriting unread planes.

    Raises
    ------
    NodeFailed
        When there isn't enough memory.
    """

    def __init__(self, name: str, slots: int, slot_bytes: int, *, lossless: bool) -> None:
        path = ring_directory() / name
        size = 8 * (_HEAD + 2 * slots) + slots * slot_bytes
        super().__init__(path, _reserve(path, size), slots, slot_bytes)
        self._lossless = lossless
        self._written = 0
        self._head[:] = (_MAGIC, _VERSION, slots, slot_bytes, int(lossless))

    def write(self, luma: NDArray[np.uint8], reader_gone: Callable[[], bool]) -> tuple[int, int]:
        """Copy a plane into the next slot; return the slot and its ticket.

        Parameters
        ----------
        luma : ndarray of uint8
            Plane of any shape and strides, not larger than a slot.
        reader_gone : callable
            Polled while the writer waits for the reader, and while no plane is held. Once the
            reader is gone, its planes are reclaimed; in a lossless ring, their tickets also become
            invalid for a later reader.

        Raises
        ------
        NodeFailed
            When a lossless ring gets no plane back for an hour.
        """
        slot = self._written % self._ticket.size
        patience_s = PATIENCE_S if self._lossless else LIVE_PATIENCE_S
        deadline = time.monotonic() + patience_s
        if self.drained():
            reader_gone()  # whoever went while nothing was held has taken nothing along
        while self._receipt[slot] != self._ticket[slot]:
            if reader_gone():
                self.reclaim()
            elif time.monotonic() > deadline:
                if self._lossless:
                    raise _idle_reader(self.path)
                break
            else:
                time.sleep(_POLL_S)
        self._written += 1
        # The ticket must be invalid while the plane is overwritten.
        self._ticket[slot] = -self._written
        plane = self._planes[slot, : luma.size].reshape(luma.shape)
        np.copyto(plane, luma)
        self._ticket[slot] = self._written
        return slot, self._written

    def reclaim(self) -> None:
        """Take all planes back from a reader that is gone."""
        if self._lossless:  # the next reader would use these planes without a copy
            self._ticket[:] = -np.abs(self._ticket)
        self._receipt[:] = self._ticket

    def drained(self) -> bool:
        """Whether the reader is done with every plane."""
        return bool(np.array_equal(self._ticket, self._receipt))

    def drain(self, reader_gone: Callable[[], bool]) -> None:
        """Wait until the reader is done with every plane, or is gone.

        Raises
        ------
        NodeFailed
            When it gives none back for an hour.
        """
        deadline = time.monotonic() + PATIENCE_S
        while not self.drained() and not reader_gone():
            if time.monotonic() > deadline:
                raise _idle_reader(self.path)
            time.sleep(5 * _POLL_S)

    def close(self) -> None:
        """Remove the ring."""
        self.path.unlink(missing_ok=True)
        super().close()


def _idle_reader(path: Path) -> NodeFailed:
    return NodeFailed(f"the reader of {path.name} has given back no frame for {PATIENCE_S:g} s")


def _reserve(path: Path, size: int) -> mmap.mmap:
    """Create a file for this user only. Allocates now: lack of memory later means SIGBUS."""
    file = os.open(path, os.O_CREAT | os.O_EXCL | os.O_RDWR, 0o600)
    try:
        os.posix_fallocate(file, 0, size)
        fcntl.flock(file, fcntl.LOCK_SH)  # kept by the map, which holds the file open
        return mmap.mmap(file, size)
    except OSError as exc:
        path.unlink()
        raise NodeFailed(
            f"no room for {size / 2**20:.0f} MiB of frames in {path.parent} ({exc.strerror})",
            "enlarge it, set fewer 'ring_slots', or use 'frames: tcp'",
        ) from exc
    finally:
        os.close(file)


class RingReader(_Ring):
    """Reader's end.

    Parameters
    ----------
    name : str
        File name of the ring.

    Raises
    ------
    FileNotFoundError
        When the ring doesn't exist, or no longer.
    SchemaMismatch
        When it isn't a ring of this version.
    """

    def __init__(self, name: str) -> None:
        path = ring_directory() / Path(name).name
        refused = SchemaMismatch(f"{name!r} is not a frame ring of version {_VERSION}")
        if not (is_name(name) and (path.is_file() or not path.exists())):
            raise refused
        with path.open("rb+") as file:
            size = os.fstat(file.fileno()).st_size
            if size < 8 * _HEAD:
                raise refused
            memory = mmap.mmap(file.fileno(), size)
        magic, version, slots, slot_bytes, lossless = np.frombuffer(
            memory, np.int64, _HEAD
        ).tolist()
        fits = min(slots, slot_bytes) > 0 and size == 8 * (_HEAD + 2 * slots) + slots * slot_bytes
        if (magic, version) != (_MAGIC, _VERSION) or not fits:
            raise refused
        super().__init__(path, memory, slots, slot_bytes)
        self.lossless = bool(lossless)

    def view(
        self, slot: int, ticket: int, height_px: int, width_px: int
    ) -> NDArray[np.uint8] | None:
        """Return the plane of a ticket, as a view; None if it was overwritten meanwhile.

        Parameters
        ----------
        slot, ticket : int
            As returned by :meth:`RingWriter.write`.
        height_px, width_px : int
            Shape of the plane.

        Raises
        ------
        SchemaMismatch
            When there is no such slot, or the size exceeds it.
        """
        size = height_px * width_px
        fits = height_px > 0 and width_px > 0 and size <= self.slot_bytes
        if not (0 <= slot < self._ticket.size and fits):
            raise SchemaMismatch(f"{self.path.name} has no slot {slot} of {size} bytes")
        if self._ticket[slot] != ticket:
            return None
        return self._planes[slot, :size].reshape(height_px, width_px)

    def release(self, slot: int, ticket: int) -> bool:
        """Release a slot; return False if its plane was overwritten while it was read."""
        whole = bool(self._ticket[slot] == ticket)
        if whole:
            self._receipt[slot] = ticket
        return whole

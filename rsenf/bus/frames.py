"""Frames from the decoding process to the row sampler: in shared memory, or within messages."""

from __future__ import annotations

import dataclasses
import os
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from rsenf.bus.bus import Publisher
from rsenf.bus.ring import RingReader, RingWriter
from rsenf.errors import NodeFailed, SchemaMismatch
from rsenf.messages import Frame, Header, Mark

AWAY_POLL_S = 0.02


class FrameSender:
    """Sends frames of one camera.

    Parameters
    ----------
    publisher : Publisher
        Sends the descriptors, or the whole frames. If its topic is lossless, so is the ring.
    ring_name : str
        Prefix of the shared-memory ring's name; empty to put the pixels in the message.
    slots : int
        Capacity of the ring in planes.
    reader_gone : callable
        Returns whether the reader has ended, so that waiting for it is useless.
    awaited : callable, optional
        Returns whether the reader is away, being restarted, and the sender waits for it.
    ahead : bool
        Whether frames come faster than real time: then the descriptors of a full ring are batched.
    with_pixels : bool
        Whether frames without a ring are sent with their pixels.
    """

    def __init__(
        self,
        publisher: Publisher,
        ring_name: str,
        slots: int,
        reader_gone: Callable[[], bool],
        *,
        awaited: Callable[[], bool] = lambda: False,
        ahead: bool = False,
        with_pixels: bool = True,
    ) -> None:
        self._publisher, self._with_pixels = publisher, with_pixels
        self._ring_name, self._slots = ring_name, slots
        self._lossless = publisher.delivery.lossless
        self._reader_gone, self._awaited = reader_gone, awaited
        self._ring: RingWriter | None = None
        self._rings = 0
        self._at_once, self._sent = slots if ahead else 1, 0

    def send(self, frame: Frame) -> None:
        """Send a frame whose ``luma`` is filled."""
        luma = frame.luma
        if luma is None:
            raise ValueError("a frame without its luma plane")
        self._await_reader()
        if self._ring_name:
            ring = self._ring_for(luma.size)
            self._publisher.pending = 1
            slot, ticket = ring.write(luma, self._reader_gone)
            frame = dataclasses.replace(
                frame, luma=None, ring=ring.path.name, ring_slot=slot, ring_ticket=ticket
            )
        else:
            pixels = luma.tobytes() if self._with_pixels else b""
            frame = dataclasses.replace(frame, luma=None, pixels=pixels)
        self._sent += 1
        self._publisher.send(frame, more=self._sent % self._at_once > 0)

    def _ring_for(self, plane_bytes: int) -> RingWriter:
        """Return the ring; a new one if the plane doesn't fit."""
        if self._ring is None or self._ring.slot_bytes < plane_bytes:
            self._wait_until_read()
            self.close()
            self._rings += 1
            name = f"{self._ring_name}-{os.getpid()}-{self._rings}"
            self._ring = RingWriter(name, self._slots, plane_bytes, lossless=self._lossless)
        return self._ring

    def finish(self, last: Header) -> None:
        """Send the end mark, numbered after the last header, and wait until all planes are read.

        A reader that is restarted meanwhile gets the end mark, too.
        """
        while True:
            self._await_reader()
            self._publisher.send(Frame(header=last.numbered(last.seq + 1, Mark.END)))
            self._wait_until_read()
            if not self._awaited():
                return

    def _await_reader(self) -> None:
        """Wait while the reader is restarted; take back the planes that it held before."""
        if not self._awaited():
            return
        while self._awaited():
            time.sleep(AWAY_POLL_S)
        if self._ring and self._reader_gone():
            self._ring.reclaim()

    def _wait_until_read(self) -> None:
        self._publisher.flush()
        if self._ring and self._lossless:
            self._publisher.pending = 1
            self._ring.drain(self._reader_gone)
            self._publisher.pending = 0

    def close(self) -> None:
        """Remove the ring."""
        if self._ring:
            self._ring.close()
            self._ring = None


class FrameReceiver:
    """Attaches the pixels to received frames; returns each plane to the ring after use."""

    def __init__(self) -> None:
        self._ring: RingReader | None = None
        self._seen_ring = False
        self._taken: Frame | None = None

    def open(self, frame: Frame) -> Frame | None:
        """Return the frame with its ``luma``; None if the plane was overwritten before it was read.

        Raises
        ------
        NodeFailed
            When its ring is not on this host.
        SchemaMismatch
            When the number of pixels contradicts the frame's size.
        """
        if frame.header.is_end:
            return frame
        if not frame.ring:
            return dataclasses.replace(frame, pixels=b"", luma=_plane(frame))
        ring = self._ring_of(frame)
        if ring is None:
            return None
        luma = ring.view(frame.ring_slot, frame.ring_ticket, frame.height_px, frame.width_px)
        if luma is None:
            return None
        self._taken = frame
        if not ring.lossless:
            # A live writer doesn't wait: copy the plane, then check that it wasn't overwritten.
            luma = luma.copy()
            if not self.done():
                return None
        return dataclasses.replace(frame, ring="", ring_slot=0, ring_ticket=0, luma=luma)

    def _ring_of(self, frame: Frame) -> RingReader | None:
        """Return the ring of a frame; None if a live writer has already removed it."""
        if self._ring is None or self._ring.path.name != frame.ring:
            self.close()
            try:
                self._ring = RingReader(frame.ring)
            except FileNotFoundError:
                if self._seen_ring:
                    return None
                raise NodeFailed(
                    f"no frame ring {frame.ring} on this host", "use 'frames: tcp' between hosts"
                ) from None
            self._seen_ring = True
        return self._ring

    def done(self) -> bool:
        """Release the last plane; return False if it was overwritten meanwhile."""
        taken, self._taken = self._taken, None
        if taken is None or self._ring is None:
            return True
        return self._ring.release(taken.ring_slot, taken.ring_ticket)

    def close(self) -> None:
        """Detach from the ring."""
        if self._ring:
            self._ring.close()
            self._ring = None


def _plane(frame: Frame) -> NDArray[np.uint8]:
    """Return the plane that is contained in a frame message."""
    plane = np.frombuffer(frame.pixels, np.uint8)
    if min(frame.height_px, frame.width_px) < 1 or plane.size != frame.height_px * frame.width_px:
        raise SchemaMismatch(f"{plane.size} pixels of {frame.width_px}×{frame.height_px}")
    return plane.reshape(frame.height_px, frame.width_px)

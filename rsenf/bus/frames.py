"""Frames from the decoding process to the sampling one: by shared memory, or in the message."""

from __future__ import annotations

import dataclasses
import os
import time
from collections.abc import Callable

import numpy as np

from rsenf.bus.ring import RingReader, RingWriter
from rsenf.bus.zenoh_bus import Publisher
from rsenf.messages import Frame, Header, Mark


class FrameSender:
    """Sends frames of one camera.

    Parameters
    ----------
    publisher : Publisher
        For the descriptors, or the whole frames.
    ring_name : str
        Name for the shared-memory ring; empty to put the pixels in the message.
    slots : int
        Planes the ring holds.
    lossless : bool
        Wait for the reader.
    give_up : callable
        Says when waiting is in vain.
    """

    def __init__(
        self,
        publisher: Publisher,
        ring_name: str,
        slots: int,
        *,
        lossless: bool,
        give_up: Callable[[], bool],
    ) -> None:
        self._publisher = publisher
        self._ring_name, self._slots, self._lossless = ring_name, slots, lossless
        self._give_up = give_up
        self._ring: RingWriter | None = None
        self._rings = 0

    def send(self, frame: Frame) -> None:
        """Send a frame whose ``luma`` is filled."""
        luma = frame.luma
        if luma is None:
            raise ValueError("a frame without its luma plane")
        if self._ring_name:
            ring = self._ring_for(luma.size)
            slot, ticket = ring.write(luma, self._give_up)
            frame = dataclasses.replace(
                frame, luma=None, ring=ring.path.name, ring_slot=slot, ring_ticket=ticket
            )
        else:
            frame = dataclasses.replace(frame, luma=None, pixels=luma.tobytes())
        self._publisher.send(frame)

    def _ring_for(self, plane_bytes: int) -> RingWriter:
        """Return the ring; a new one when the picture has grown."""
        if self._ring is None or self._ring.slot_bytes < plane_bytes:
            self._wait_until_read()
            if self._ring:
                self._ring.close()
            self._rings += 1
            name = f"{self._ring_name}-{os.getpid()}-{self._rings}"
            self._ring = RingWriter(name, self._slots, plane_bytes, lossless=self._lossless)
        return self._ring

    def finish(self, last: Header) -> None:
        """Mark the end of the stream, after the last frame or in its place."""
        header = last.numbered(last.seq + 1, Mark.END)
        self._publisher.send(Frame(header=header))
        self._wait_until_read()

    def _wait_until_read(self) -> None:
        while self._ring and self._lossless and not self._ring.drained() and not self._give_up():
            time.sleep(0.005)

    def close(self) -> None:
        """Remove the ring."""
        if self._ring:
            self._ring.close()


class FrameReceiver:
    """Gives frames their pixels back; hands each plane back when it has been used."""

    def __init__(self) -> None:
        self._ring: RingReader | None = None
        self._taken: Frame | None = None
        self.overwritten = 0

    def open(self, frame: Frame) -> Frame | None:
        """Return the frame with its ``luma``; None when it was overwritten before it was read."""
        if frame.header.is_end:
            return frame
        if not frame.ring:
            luma = np.frombuffer(frame.pixels, np.uint8).reshape(frame.height_px, frame.width_px)
            return dataclasses.replace(frame, pixels=b"", luma=luma)
        if self._ring is None or self._ring.path.name != frame.ring:
            self.close()
            self._ring = RingReader(frame.ring)
        plane = self._ring.view(frame.ring_slot, frame.ring_ticket, frame.height_px, frame.width_px)
        self._taken = frame
        if plane is not None and not self._ring.lossless:
            # A live writer doesn't wait: take a copy, and see whether it was whole.
            plane = plane.copy()
            plane = plane if self.done() else None
        if plane is None:
            self.overwritten += 1
            return None
        return dataclasses.replace(frame, ring="", ring_slot=0, ring_ticket=0, luma=plane)

    def done(self) -> bool:
        """Give the last plane back; False when it was overwritten meanwhile."""
        taken, self._taken = self._taken, None
        if taken is None or self._ring is None:
            return True
        return self._ring.release(taken.ring_slot, taken.ring_ticket)

    def close(self) -> None:
        """Let go of the ring."""
        if self._ring:
            self._ring.close()
            self._ring = None

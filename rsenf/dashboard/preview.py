"""A thumbnail of a camera's picture, updated once a second at most."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsenf.bus.ring import RingReader
from rsenf.errors import SchemaMismatch
from rsenf.messages import Frame, VideoPacket
from rsenf.timebase import NS_PER_S

WIDTH_PX = 320
QUALITY = 70
LEAST_PX = 16
MOST_PX = 1 << 26


class Preview:
    """The newest picture, as JPEG.

    Attributes
    ----------
    jpeg : bytes
        Empty before the first picture.
    number : int
        Number of pictures so far.
    """

    def __init__(self) -> None:
        self.jpeg, self.number = b"", 0
        self._taken_ns = 0
        self._ring: RingReader | None = None

    def take_frame(self, frame: Frame, now_ns: int) -> None:
        """Take a frame with pixels in its message or in a ring; skip it if they are unavailable."""
        if self._is_due(now_ns):
            luma = self._peek(frame) if frame.ring else _sent(frame)
            if luma is not None:
                self._keep(luma, now_ns)

    def take_packet(self, packet: VideoPacket, now_ns: int) -> None:
        """Take a packet of compressed video; skip it unless it is a key frame that decodes."""
        if packet.keyframe and packet.data and self._is_due(now_ns):
            picture = _decoded(packet)
            if picture is not None:
                self._keep(picture, now_ns)

    def _is_due(self, now_ns: int) -> bool:
        return not 0 <= now_ns - self._taken_ns < NS_PER_S

    def _keep(self, picture: NDArray[np.uint8], now_ns: int) -> None:
        import cv2

        height, width = picture.shape[:2]
        if min(height, width) < LEAST_PX:
            return
        size = (WIDTH_PX, max(LEAST_PX, round(height * WIDTH_PX / width)))
        small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
        done, coded = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
        if done:
            self.jpeg, self.number, self._taken_ns = coded.tobytes(), self.number + 1, now_ns

    def _peek(self, frame: Frame) -> NDArray[np.uint8] | None:
        """Copy a plane from the ring without releasing it: the ring's reader is another process."""
        try:
            if self._ring is None or self._ring.path.name != frame.ring:
                self.close()
                self._ring = RingReader(frame.ring)
            place = frame.ring_slot, frame.ring_ticket, frame.height_px, frame.width_px
            luma = self._ring.view(*place)
            copy = None if luma is None else luma.copy()
            del luma
            return copy if self._ring.view(*place) is not None else None
        except (OSError, SchemaMismatch, ValueError):  # ring of another host, removed, or invalid
            return None

    def close(self) -> None:
        """Detach from the ring."""
        if self._ring is not None:
            self._ring.close()
            self._ring = None


def _sent(frame: Frame) -> NDArray[np.uint8] | None:
    plane = np.frombuffer(frame.pixels, np.uint8)
    fits = plane.size and plane.size == frame.height_px * frame.width_px
    return plane.reshape(frame.height_px, frame.width_px) if fits else None


def _decoded(packet: VideoPacket) -> NDArray[np.uint8] | None:
    import av

    from rsenf.decode.packets import PacketDecoder

    try:
        decoder = PacketDecoder(packet.codec)
        pictures: list[Any] = [*decoder.decode(packet.data, None), *decoder.rest()]
        if not pictures:
            return None
        picture = pictures[0].picture
        height = max(2, round(picture.height * WIDTH_PX / picture.width))
        return np.asarray(picture.to_ndarray(width=WIDTH_PX, height=height, format="bgr24"))
    except (av.FFmpegError, ValueError):  # damaged packet or missing codec
        return None

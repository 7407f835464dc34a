"""Decodes recorded video to the frames that the rows stage got."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Iterator

import av

from rsenf.decode.packets import Decoded, PacketDecoder
from rsenf.decode.stream import luma_plane
from rsenf.messages import Frame, VideoPacket
from rsenf.regress.history import Run, run_of


class Pictures:
    """Decodes the packets of one camera.

    The pictures are bit-identical to those of the recording, since the codecs' standards define
    decoding exactly. Each is identified by its presentation time.

    Parameters
    ----------
    numbers : dict, optional
        Numbers of the frames that reached the rows stage, by run and time in ns. Other pictures are
        dropped. If None, all are kept and numbered from 0.

    Attributes
    ----------
    yielded : int
        Number of frames yielded.
    mistimed : bool
        Whether the video's times are not the presentation times of its pictures.
    """

    def __init__(self, numbers: dict[Run, dict[int, int]] | None) -> None:
        self._numbers = numbers
        self._run: Run | None = None
        self._decoder: PacketDecoder | None = None
        self._count = 0
        self.yielded = 0
        self.mistimed = False

    @property
    def missing(self) -> int:
        """Number of frames that the rows stage got and the video lacks."""
        wanted = sum(map(len, self._numbers.values())) if self._numbers else self.yielded
        return wanted - self.yielded

    def feed(self, packet: VideoPacket) -> Iterator[Frame]:
        """Yield the frames that a packet completes, and the END mark after the last."""
        if packet.header.is_end:
            yield from self.rest()
            yield Frame(header=packet.header)
            return
        if run_of(packet.header) != self._run:
            yield from self.rest()
            self._begin(packet)
        assert self._decoder is not None
        pts_ns = None if packet.untimed else packet.header.pts_ns
        try:
            decoded = self._decoder.decode(packet.data, packet.header, pts_ns=pts_ns)
        except av.FFmpegError:
            return  # damaged when recorded, too: the decode node dropped it
        yield from self._frames(self._decoder, decoded)

    def _begin(self, packet: VideoPacket) -> None:
        self._run, self._count = run_of(packet.header), 0
        self._decoder = PacketDecoder(packet.codec)

    def rest(self) -> Iterator[Frame]:
        """Yield the frames left in the decoder: after a lost sender there is no END mark."""
        if self._decoder is not None:
            with contextlib.suppress(av.FFmpegError):
                yield from self._frames(self._decoder, self._decoder.rest())
            self._decoder = None

    def _frames(self, decoder: PacketDecoder, decoded: list[Decoded]) -> Iterator[Frame]:
        self.mistimed |= decoder.contradicts
        for one in decoded:
            yield from self._frame(one)

    def _frame(self, decoded: Decoded) -> Iterator[Frame]:
        picture, header = decoded
        number, self._count = self._count, self._count + 1
        if self._numbers is not None:
            number = self._numbers.get(run_of(header), {}).get(header.pts_ns, -1)
        if number < 0 or picture.is_corrupt:
            return
        self.yielded += 1
        yield Frame(
            header=dataclasses.replace(header, seq=number, frame_first=number, frame_last=number),
            height_px=picture.height,
            width_px=picture.width,
            keyframe=picture.key_frame,
            luma=luma_plane(picture),
        )

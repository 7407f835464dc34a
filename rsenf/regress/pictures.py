"""Recorded video back to the frames that the rows stage was given."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Iterator

import av

from rsenf.decode.coded import Decoded, PacketDecoder
from rsenf.decode.luma import luma_plane
from rsenf.messages import Frame, VideoPacket
from rsenf.regress.history import Run, run_of


class Pictures:
    """Decodes the packets of one camera.

    Pictures come out bit for bit as they did: decoding is exact by the codecs' standards. Each is
    known by its presentation time.

    Parameters
    ----------
    numbers : dict, optional
        Numbers of the frames that reached the rows stage, by run and time in ns. Pictures that are
        not among them are left out. Counted from 0, and none left out, when not given.

    Attributes
    ----------
    yielded : int
        Frames given out.
    mistimed : bool
        Whether the video's times turned out not to be those at which its pictures were shown.
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
        """Frames that the rows stage had and the video hasn't."""
        wanted = sum(map(len, self._numbers.values())) if self._numbers else self.yielded
        return wanted - self.yielded

    def feed(self, packet: VideoPacket) -> Iterator[Frame]:
        """Yield the frames that a packet completes, and the END mark behind the last."""
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
            return  # it was damaged then, too: the decode node left it out
        yield from self._frames(self._decoder, decoded)

    def _begin(self, packet: VideoPacket) -> None:
        self._run, self._count = run_of(packet.header), 0
        self._decoder = PacketDecoder(packet.codec)

    def rest(self) -> Iterator[Frame]:
        """Yield what the decoder holds back: a video whose sender was gone has no END mark."""
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

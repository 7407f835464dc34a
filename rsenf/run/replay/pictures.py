"""Decodes the recorded packets of a video to the same frames, with the same numbers and times."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Iterable, Iterator

import av

from rsenf.decode.packets import PacketDecoder, TaggedPicture
from rsenf.decode.stream import luma_plane
from rsenf.errors import InputError
from rsenf.messages import Frame, Header, VideoPacket

Timed = tuple[int, VideoPacket]


def from_key_frame(packets: Iterable[Timed], from_ns: int) -> Iterator[Timed]:
    """Yield packets from the last key frame before a time on: those from which decoding can start.

    Parameters
    ----------
    packets : iterable of (int, VideoPacket)
        With their times (ns), in decoding order.
    from_ns : int
        First time that is wanted.
    """
    held: list[Timed] | None = []
    for item in packets:
        if held is None:
            yield item
            continue
        if item[1].keyframe:
            held = []
        held.append(item)
        if item[0] >= from_ns:
            yield from held
            held = None


def pictures(packets: Iterable[Timed], from_ns: int, like: Frame) -> Iterator[tuple[int, Frame]]:
    """Decode a video.

    After missing packets all pictures up to the next key frame are left out, since they would be
    decoded from wrong predictions. Frame numbers leave a gap for them.

    Parameters
    ----------
    packets : iterable of (int, VideoPacket)
        With their times (ns), in decoding order.
    from_ns : int
        Earlier frames are left out, and numbers begin after them.
    like : Frame
        Template for other fields, such as the rotation.

    Yields
    ------
    time_ns : int
    frame : Frame
        With its ``luma``.

    Raises
    ------
    InputError
        When the order of the pictures contradicts the times of the packets.
    """
    decoder: _Stretch | None = None
    for time_ns, packet in from_key_frame(packets, from_ns):
        if decoder is None or not decoder.continues(packet.header):
            if decoder:
                yield from decoder.drain()
            decoder = _Stretch(packet, from_ns, like)
        yield from decoder.feed(time_ns, packet)
    if decoder:
        yield from decoder.drain()


class _Stretch:
    """Decodes one epoch of a video."""

    def __init__(self, first: VideoPacket, from_ns: int, like: Frame) -> None:
        self._from_ns, self._like, self._codec = from_ns, like, first.codec
        self._last = first.header.numbered(first.header.seq - 1)
        self._decoder = PacketDecoder(self._codec)
        self._number = 0
        self._size: tuple[int, int] | None = None
        self._lost = False

    def continues(self, header: Header) -> bool:
        """Whether a packet belongs to the same run and epoch."""
        return (header.run_id, header.epoch) == (self._last.run_id, self._last.epoch)

    def feed(self, time_ns: int, packet: VideoPacket) -> Iterator[tuple[int, Frame]]:
        """Decode a packet."""
        missing = packet.header.seq - self._last.seq - 1
        self._last = packet.header
        if missing > 0:
            yield from self.drain()
            self._decoder, self._lost = PacketDecoder(self._codec), True
            self._number += missing
        self._lost = self._lost and not packet.keyframe
        if self._lost:
            self._number += 1
        elif packet.data:
            pts_ns = None if packet.untimed else packet.header.pts_ns
            tag = time_ns, packet.header
            try:
                made = self._decoder.decode(packet.data, tag, pts_ns=pts_ns)
            except av.FFmpegError:
                return
            yield from self._shown(made)

    def drain(self) -> Iterator[tuple[int, Frame]]:
        """Yield the last frames of the decoder."""
        with contextlib.suppress(av.FFmpegError):
            yield from self._shown(self._decoder.rest())

    def _shown(self, decoded: list[TaggedPicture]) -> Iterator[tuple[int, Frame]]:
        if self._decoder.contradicts:
            raise InputError(
                f"{self._last.source}: its video was recorded without the times of its pictures",
                "an older version did so with AVI; record it anew, or play its rows",
            )
        for picture, (time_ns, header) in decoded:
            self._size = self._size or (picture.width, picture.height)
            # A picture of another size had ended the live stream as well.
            if time_ns < self._from_ns or (picture.width, picture.height) != self._size:
                continue
            number, self._number = self._number, self._number + 1
            if not picture.is_corrupt:
                yield time_ns, self._frame(picture, header, number)

    def _frame(self, picture: av.VideoFrame, header: Header, number: int) -> Frame:
        numbered = dataclasses.replace(
            header.numbered(number), frame_first=number, frame_last=number
        )
        return dataclasses.replace(
            self._like,
            header=numbered,
            height_px=picture.height,
            width_px=picture.width,
            codec=self._codec,
            keyframe=picture.key_frame,
            luma=luma_plane(picture),
        )

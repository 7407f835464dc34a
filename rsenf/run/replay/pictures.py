"""Recorded packets of a video, decoded again: the same frames, with the same numbers and times."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator
from typing import cast

import av

from rsenf.decode.luma import luma_plane
from rsenf.messages import Frame, Header, VideoPacket

Timed = tuple[int, VideoPacket]


def from_key_frame(packets: Iterable[Timed], from_ns: int) -> Iterator[Timed]:
    """Leave out what comes before the last key frame before a moment: the rest can be decoded."""
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

    Packets that are missing cost all pictures up to the next key frame: what a decoder would make
    of them isn't what was filmed. Numbers leave room for them.

    Parameters
    ----------
    packets : iterable of (int, VideoPacket)
        With their times, in the order of decoding.
    from_ns : int
        Frames before this time are left out; numbers begin with the first that isn't.
    like : Frame
        What else is known of the frames, such as how to rotate them.

    Yields
    ------
    time_ns : int
    frame : Frame
        With its ``luma``.
    """
    decoder: _Decoder | None = None
    for time_ns, packet in from_key_frame(packets, from_ns):
        if decoder is None or not decoder.continues(packet.header):
            if decoder:
                yield from decoder.drain()
            decoder = _Decoder(packet, from_ns, like)
        yield from decoder.feed(time_ns, packet)
    if decoder:
        yield from decoder.drain()


class _Decoder:
    """Decodes one stretch of a video: the packets of an epoch."""

    def __init__(self, first: VideoPacket, from_ns: int, like: Frame) -> None:
        self._from_ns, self._like, self._codec = from_ns, like, first.codec
        self._last = first.header.numbered(first.header.seq - 1)
        self._context = self._open()
        self._number = 0
        self._size: tuple[int, int] | None = None
        self._lost = False

    def _open(self) -> av.VideoCodecContext:
        context = cast(av.VideoCodecContext, av.CodecContext.create(self._codec, "r"))
        context.copy_opaque = True  # hands each packet's header on to its frame
        context.thread_type = "AUTO"
        return context

    def continues(self, header: Header) -> bool:
        """Whether a packet belongs to the same stretch."""
        return (header.run_id, header.epoch) == (self._last.run_id, self._last.epoch)

    def feed(self, time_ns: int, packet: VideoPacket) -> Iterator[tuple[int, Frame]]:
        """Decode a packet."""
        missing = packet.header.seq - self._last.seq - 1
        self._last = packet.header
        if missing > 0:
            yield from self.drain()
            self._context, self._lost = self._open(), True
            self._number += missing
        self._lost = self._lost and not packet.keyframe
        if self._lost:
            self._number += 1
        elif packet.data:
            made = cast("av.Packet[av.VideoStream]", av.Packet(packet.data))
            made.pts = packet.header.pts_ns
            made.is_keyframe = packet.keyframe
            made.opaque = (time_ns, packet.header)
            yield from self._decoded(made)

    def drain(self) -> Iterator[tuple[int, Frame]]:
        """Give out the last frames."""
        yield from self._decoded(None)

    def _decoded(self, packet: av.Packet[av.VideoStream] | None) -> Iterator[tuple[int, Frame]]:
        try:
            decoded = self._context.decode(packet)
        except av.FFmpegError:
            return
        for picture in decoded:
            time_ns, header = cast("tuple[int, Header]", picture.opaque)
            self._size = self._size or (picture.width, picture.height)
            # A picture of another size ended the stream when it was live, too.
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

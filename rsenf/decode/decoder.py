"""FFmpeg's decoder of a stream: on the processor or a device, with full effort or less.

The effort may change while the stream goes on: at a key frame another decoder takes over, and no
picture is lost. Frames that follow the key frame in the stream but are shown before it (open groups
of pictures) still come from the first one.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import TypeAlias, cast

import av
from av.codec.hwaccel import HWAccel, hwdevices_available
from av.video.codeccontext import VideoCodecContext

from rsenf.decode.source import Effort, SourceSpec

# FFmpeg's options by effort. The loop filter smooths the edges of blocks; decoding without it takes
# 0.7 to 0.85 of the processor time. FFmpeg can't leave out that of AV1 and VP9.
OPTIONS: dict[Effort, dict[str, str]] = {"full": {}, "fast": {"skip_loop_filter": "all"}}
MAY_LEAVE_IT_OUT = ("h264", "hevc", "vp8")

Packet: TypeAlias = "av.Packet[av.VideoStream]"
Picture: TypeAlias = "tuple[av.VideoFrame, Effort]"
OnDevice: TypeAlias = Callable[[str, str], VideoCodecContext | None]


def device_decoder(device: str, codec: str) -> VideoCodecContext | None:
    """Return a decoder that runs on a device; None where there is no such device for the codec.

    Parameters
    ----------
    device : str
        FFmpeg's name of a kind of device (vaapi, cuda, …); 'auto' for the first that is there.
    codec : str
        FFmpeg's name.
    """
    for kind in hwdevices_available() if device == "auto" else (device,):
        with contextlib.suppress(av.FFmpegError, ValueError):
            made = VideoCodecContext.create(codec, "r", HWAccel(kind))
            if made.is_hwaccel:
                return cast(VideoCodecContext, made)
    return None


@dataclass
class _Leaving:
    """A decoder that is replaced at a key frame."""

    context: VideoCodecContext
    effort: Effort
    key_pts: int
    held: list[Picture] = field(default_factory=list)  # of the new one, not yet due

    def decode(self, packet: Packet | None) -> list[Picture]:
        """Decode a packet, None for the end; return what is shown before the key frame."""
        pictures = self.context.decode(packet)
        return [(p, self.effort) for p in pictures if p.pts is None or p.pts < self.key_pts]


class Decoder:
    """Decodes the packets of a stream.

    Parameters
    ----------
    context : VideoCodecContext
        The stream's own, not yet open.
    spec : SourceSpec
        With the effort, the device and the number of threads.
    live : bool
        Pass each packet's ``opaque`` to its picture. Off for files, where it has no meaning:
        decoder threads would need the GIL to release it.
    on_device : callable, optional
        As :func:`device_decoder`.

    Attributes
    ----------
    effort : {'full', 'fast'}
        Of the pictures from now on.
    without_device : str
        Why the processor decodes although a device was asked for; empty otherwise.
    """

    def __init__(
        self,
        context: VideoCodecContext,
        spec: SourceSpec,
        *,
        live: bool,
        on_device: OnDevice = device_decoder,
    ) -> None:
        self._context = self._software = context
        self._threads, self._live = spec.threads, live
        self.without_device = ""
        codec = context.codec.canonical_name
        self._has_filter = codec in MAY_LEAVE_IT_OUT
        # Packets of a device that hasn't given a picture yet, to be decoded again without it.
        self._tried: list[Packet | None] | None = None
        device = on_device(spec.hwaccel, codec) if spec.hwaccel != "none" else None
        self._on_device = device is not None
        if device:
            self._tried = []
        elif spec.hwaccel != "none":
            self.without_device = f"hwaccel {spec.hwaccel}: no such device for {codec} here"
        self._asked: Effort = "fast" if spec.effort == "fast" else "full"
        self._leaving: _Leaving | None = None
        self._set_up(device or context)

    def _set_up(self, context: VideoCodecContext) -> None:
        """Decode with another context from now on."""
        if context is not self._software:
            context.extradata = self._software.extradata
            # Of H.264 that doesn't declare it, this is known from the pictures before.
            context.reorder_depth = self._context.reorder_depth
        self._context, self.effort = context, self._wanted
        context.options = dict(OPTIONS[self.effort])
        context.copy_opaque = self._live
        context.thread_type = "NONE" if self._threads == 1 else "AUTO"
        context.thread_count = self._threads

    @property
    def _wanted(self) -> Effort:
        """Effort asked for, where it is to be had."""
        return self._asked if self._has_filter and not self._on_device else "full"

    def ask_for(self, effort: Effort) -> None:
        """Change the effort at the next key frame."""
        self._asked = effort

    def decode(self, packet: Packet | None) -> Iterator[Picture]:
        """Decode a packet, None for the end; yield the pictures that it completes.

        Raises
        ------
        av.FFmpegError
            When something can't be decoded, after all pictures that can.
        """
        pts = packet.pts if packet else None
        if leaving := self._leaving:
            if pts is not None and pts < leaving.key_pts:
                yield from leaving.decode(packet)
                return
            self._leaving, last = None, list[Picture]()
            try:
                last = leaving.decode(None)
            finally:
                yield from (*last, *leaving.held)
                yield from self._plain(packet)
        elif self._wanted == self.effort or not packet or not packet.is_keyframe or pts is None:
            yield from self._plain(packet)
        else:
            self._leaving = leaving = _Leaving(self._context, self.effort, pts)
            made = VideoCodecContext.create(self._context.codec.name, "r")
            self._set_up(cast(VideoCodecContext, made))
            try:
                leaving.held = list(self._plain(packet))
            finally:
                yield from leaving.decode(packet)

    def _plain(self, packet: Packet | None) -> Iterator[Picture]:
        if self._tried is not None:
            self._tried.append(packet)
        try:
            pictures = self._context.decode(packet)
        except av.FFmpegError:
            if self._tried is None:
                raise
            yield from self._without_device(self._tried)
            return
        if pictures:
            self._tried = None
        yield from ((picture, self.effort) for picture in pictures)

    def _without_device(self, packets: list[Packet | None]) -> Iterator[Picture]:
        """Decode on the processor what the device was given."""
        self.without_device = "the device can't decode this stream"
        self._on_device, self._tried = False, None
        self._set_up(self._software)
        failed: av.FFmpegError | None = None
        for packet in packets:
            try:
                yield from self._plain(packet)
            except av.FFmpegError as exc:
                failed = exc
        if failed:
            raise failed

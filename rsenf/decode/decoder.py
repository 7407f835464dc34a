"""FFmpeg's decoder of a stream: on the processor or a device, with full effort or less.

The effort may change while the stream goes on: at a key frame another decoder takes over, and no
picture is lost. Frames that follow the key frame in the stream but are shown before it (open groups
of pictures) still come from the first one.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable
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
        self.effort: Effort = "full"
        self.without_device = ""
        codec = context.codec.canonical_name
        self._may_be_fast = codec in MAY_LEAVE_IT_OUT
        if spec.hwaccel != "none":
            device = on_device(spec.hwaccel, codec)
            if device is None:
                self.without_device = f"hwaccel {spec.hwaccel}: no such device for {codec} here"
            else:
                device.extradata = context.extradata
                self._context, self._may_be_fast = device, False
        if spec.effort == "fast" and self._may_be_fast:
            self.effort = "fast"
        self._asked = self.effort
        self._leaving: _Leaving | None = None
        self._begun = False
        self._set_up(self._context)

    def _set_up(self, context: VideoCodecContext) -> None:
        context.options = dict(OPTIONS[self.effort])
        context.copy_opaque = self._live
        context.thread_type = "NONE" if self._threads == 1 else "AUTO"
        context.thread_count = self._threads

    def ask_for(self, effort: Effort) -> None:
        """Change the effort at the next key frame."""
        if self._may_be_fast:
            self._asked = effort

    def decode(self, packet: Packet | None) -> list[Picture]:
        """Decode a packet, None for the end; return the pictures that it completes.

        Raises
        ------
        av.FFmpegError
            When the packet can't be decoded.
        """
        pts = packet.pts if packet else None
        if leaving := self._leaving:
            if pts is not None and pts < leaving.key_pts:
                return leaving.decode(packet)
            self._leaving = None
            return [*leaving.decode(None), *leaving.held, *self._plain(packet)]
        if self._asked == self.effort or not packet or not packet.is_keyframe or pts is None:
            return self._plain(packet)
        self._leaving = leaving = _Leaving(self._context, self.effort, pts)
        self.effort = self._asked
        made = VideoCodecContext.create(self._context.codec.name, "r")
        self._context = cast(VideoCodecContext, made)
        self._context.extradata = self._software.extradata
        self._set_up(self._context)
        leaving.held = self._plain(packet)
        return leaving.decode(packet)

    def _plain(self, packet: Packet | None) -> list[Picture]:
        try:
            pictures = self._context.decode(packet)
        except av.FFmpegError:
            if self._context is self._software or self._begun or not self._context.is_hwaccel:
                raise
            self.without_device = "the device can't decode this stream"
            self._context = self._software
            self._set_up(self._context)
            return self._plain(packet)
        self._begun = self._begun or bool(pictures)
        return [(picture, self.effort) for picture in pictures]

"""Converts the pictures of one topic to frames: decoding, luma of raw pixels, and time stamps."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import av
import cv2
import numpy as np
from numpy.typing import NDArray

from rsenf.decode.packets import LARGEST_PX, STILLS, PacketDecoder, TaggedPicture, is_random_access
from rsenf.decode.stream import luma_plane
from rsenf.errors import SchemaMismatch
from rsenf.messages import Frame, Header, VideoPacket
from rsenf.run.foreign.pictures import Coded, Picture, RawPicture
from rsenf.timebase import NS_PER_S


class _Form(NamedTuple):
    """Bytes per pixel, and where its luma is: a byte of it, or FFmpeg's name of the format."""

    bytes: int
    luma_byte: int = 0
    ffmpeg: str = ""


# https://docs.ros.org/en/rolling/p/sensor_msgs/ (image_encodings.hpp) and foxglove.RawImage. Chroma
# planes follow the luma plane, and are ignored.
_FORMS = {
    **dict.fromkeys(("mono8", "8UC1", "nv12", "nv21", "nv24"), _Form(1)),
    **dict.fromkeys(("yuv422", "uyvy"), _Form(2, luma_byte=1)),
    **dict.fromkeys(("yuv422_yuy2", "yuyv"), _Form(2)),
    "rgb8": _Form(3, ffmpeg="rgb24"),
    "rgba8": _Form(4, ffmpeg="rgba"),
    **dict.fromkeys(("bgr8", "8UC3"), _Form(3, ffmpeg="bgr24")),
    **dict.fromkeys(("bgra8", "8UC4"), _Form(4, ffmpeg="bgra")),
    **dict.fromkeys(("mono16", "16UC1"), _Form(2, ffmpeg="gray16")),
    **{f"bayer_{p}8": _Form(1, ffmpeg=f"bayer_{p}8") for p in ("rggb", "bggr", "gbrg", "grbg")},
}


def raw_luma(raw: RawPicture) -> NDArray[np.uint8]:
    """Return the luma of a raw picture, rows × columns, uint8, read-only.

    8-bit luma is kept unchanged; RGB, Bayer and 16-bit formats are converted by FFmpeg, as for
    every other input.

    Raises
    ------
    SchemaMismatch
        When the pixel format is unknown, or the data don't fill the picture.
    """
    form = _FORMS.get(raw.encoding)
    if form is None:
        raise SchemaMismatch(f"pixels in a form that isn't known: {raw.encoding[:40]!r}")
    lines = _lines(raw, form.bytes)
    if form.ffmpeg:
        return _by_ffmpeg(raw, form.ffmpeg, lines)
    return lines[:, form.luma_byte :: form.bytes]


def _lines(raw: RawPicture, pixel_bytes: int) -> NDArray[np.uint8]:
    """Return the lines of the picture without padding (a view)."""
    size = f"{raw.width_px}×{raw.height_px}"
    if not 0 < raw.width_px * raw.height_px <= LARGEST_PX:
        raise SchemaMismatch(f"a picture of {size} pixels")
    line_bytes = raw.width_px * pixel_bytes
    step = raw.step_bytes or line_bytes
    if step < line_bytes or len(raw.data) < step * (raw.height_px - 1) + line_bytes:
        raise SchemaMismatch(
            f"{len(raw.data)} bytes in lines of {step} don't fill {size} pixels of {pixel_bytes}"
        )
    whole = np.frombuffer(raw.data, np.uint8)
    return np.lib.stride_tricks.as_strided(
        whole, (raw.height_px, line_bytes), (step, 1), writeable=False
    )


def _by_ffmpeg(raw: RawPicture, name: str, lines: NDArray[np.uint8]) -> NDArray[np.uint8]:
    if name == "gray16":
        name += "be" if raw.big_endian else "le"
    height_px, width_px = raw.height_px, raw.width_px
    if name.startswith("bayer"):
        # FFmpeg aborts the process at odd heights: pad to whole 2 × 2 cells. Reflection keeps the
        # colour order of the mosaic.
        lines = np.pad(lines, ((0, height_px % 2), (0, width_px % 2)), mode="reflect")
        height_px, width_px = lines.shape
    try:
        frame = av.VideoFrame(width_px, height_px, name)
    except (av.FFmpegError, ValueError, MemoryError) as exc:
        raise SchemaMismatch(f"no {name} picture is {width_px}×{height_px}") from exc
    plane = frame.planes[0]
    padded = np.zeros((plane.buffer_size // plane.line_size, plane.line_size), np.uint8)
    padded[: lines.shape[0], : lines.shape[1]] = lines
    plane.update(padded.tobytes())
    return luma_plane(frame)[: raw.height_px, : raw.width_px]


# Stamps before the year 2000 come from an unset clock or from a simulation.
_FIRST_WALL_CLOCK_NS = 946_684_800 * NS_PER_S
_LONGEST_NS = 1 << 62  # 146 years: well within the range of decoders
RAW_CODEC = "png"  # how the luma of a raw picture is stored, lossless
_PNG_FAST = [cv2.IMWRITE_PNG_COMPRESSION, 1]

Item = Frame | VideoPacket
Luma = NDArray[np.uint8]


class PictureStream:
    """Makes frames of the pictures of one topic.

    The stream clock is the pictures' time stamps, counted from the first one; if the first has
    none, the log times. A change of size or codec ends the stream.

    Parameters
    ----------
    source : str
        ``source`` of the message headers.
    with_packets : bool
        Whether to return each compressed picture as well, before its frames.

    Attributes
    ----------
    ended : str
        Why the stream has ended; empty while it goes on.
    damaged : int
        Pictures that can't be decoded.
    backward : int
        Frames that are not later than the one before.
    unset : int
        Pictures without a time stamp, or with one centuries away, though the first one has one.
    unstamped : bool
        Whether log times are used.
    """

    def __init__(self, source: str, *, with_packets: bool = False) -> None:
        self._header = Header(source=source, seq=-1)
        self._with_packets = with_packets
        self._packets = self._frames = 0
        self._zero_ns: int | None = None
        self._last_ns = -1
        self._size = (0, 0)
        self._codec = ""
        self._decoder: PacketDecoder | None = None
        self.unstamped = False
        self.ended = ""
        self.damaged = self.backward = self.unset = 0

    def feed(self, picture: Picture, log_time_ns: int) -> list[Item]:
        """Take a picture; return its packet, if requested, and the frames it completes.

        Parameters
        ----------
        picture : Coded or RawPicture
        log_time_ns : int
            When it was logged, UTC since 1970.
        """
        if self.ended:
            return []
        if picture.stamp_ns <= 0 and self._zero_ns is not None and not self.unstamped:
            self.unset += 1
            return []
        header = self._timed(picture.stamp_ns, log_time_ns)
        if abs(header.pts_ns) > _LONGEST_NS:
            self.unset += 1
            return []
        try:
            return self._raw(picture, header) if isinstance(picture, RawPicture) else self._coded(
                picture, header
            )  # fmt: skip
        except (SchemaMismatch, av.FFmpegError, ValueError, MemoryError):
            self.damaged += 1
            return []

    def finish(self) -> list[Item]:
        """Return the frames that the decoder still holds."""
        try:
            return self._shown(self._decoder.rest()) if self._decoder else []
        except (av.FFmpegError, ValueError, MemoryError):
            self.damaged += 1
            return []

    @property
    def loss(self) -> str:
        """What was lost until now, in one line; empty for nothing."""
        lost = [self.ended] if self.ended else []
        if self.damaged:
            lost.append(f"pictures that can't be decoded: {self.damaged}")
        if self.unset:
            lost.append(f"pictures without a stamp of the others' time: {self.unset}")
        return "; ".join(lost)

    @property
    def warnings(self) -> list[str]:
        """Warnings that belong in a result, one line each."""
        found = []
        if self.unstamped:
            found.append("its pictures bear no times: those of logging were taken, which jitter")
        if self.backward:
            found.append(f"frames that are not later than the one before: {self.backward}")
        return found

    def _timed(self, stamp_ns: int, log_time_ns: int) -> Header:
        if self._zero_ns is None:
            self.unstamped = stamp_ns <= 0
            self._zero_ns = log_time_ns if self.unstamped else stamp_ns
        known = stamp_ns >= _FIRST_WALL_CLOCK_NS and not self.unstamped
        return dataclasses.replace(
            self._header,
            pts_ns=(log_time_ns if self.unstamped else stamp_ns) - self._zero_ns,
            camera_time_ns=stamp_ns if known else 0,
            arrival_time_ns=min(log_time_ns, (1 << 63) - 1),
        )

    def _raw(self, raw: RawPicture, header: Header) -> list[Item]:
        luma = raw_luma(raw)
        frame = self._frame(luma, header, "rawvideo", keyframe=True)
        if frame is None or not self._with_packets:
            return [frame] if frame else []
        _, data = cv2.imencode(".png", luma, _PNG_FAST)
        return [self._packet(header, RAW_CODEC, bytes(data), keyframe=True), frame]

    def _coded(self, picture: Coded, header: Header) -> list[Item]:
        self._codec = self._codec or picture.codec
        if picture.codec != self._codec:
            self.ended = f"the pictures change from {self._codec} to {picture.codec}"
            return []
        kept: list[Item] = []
        if self._with_packets:
            # Of VP9 and AV1 only the first is known to need no earlier one.
            keyframe = picture.codec in STILLS or self._packets == 0
            if picture.codec in ("h264", "hevc"):
                keyframe = is_random_access(picture.data, picture.codec)
            kept.append(self._packet(header, picture.codec, picture.data, keyframe=keyframe))
        self._decoder = self._decoder or PacketDecoder(self._codec)
        try:
            return kept + self._shown(
                self._decoder.decode(picture.data, header, pts_ns=header.pts_ns)
            )
        except (av.FFmpegError, ValueError, MemoryError):
            self.damaged += 1
            return kept

    def _shown(self, pictures: list[TaggedPicture]) -> list[Item]:
        frames: list[Item] = []
        for picture, header in pictures:
            if picture.is_corrupt:
                self.damaged += 1
                continue
            frame = self._frame(
                luma_plane(picture), header, self._codec, keyframe=bool(picture.key_frame)
            )
            if frame:
                frames.append(frame)
        return frames

    def _packet(self, header: Header, codec: str, data: bytes, *, keyframe: bool) -> VideoPacket:
        header = dataclasses.replace(header, seq=self._packets)
        self._packets += 1
        return VideoPacket(header=header, codec=codec, keyframe=keyframe, data=data)

    def _frame(self, luma: Luma, header: Header, codec: str, *, keyframe: bool) -> Frame | None:
        height_px, width_px = luma.shape
        if self._frames and luma.shape != self._size:
            self.ended = f"the pictures change their size to {width_px}×{height_px}"
            return None
        number, self._frames, self._size = self._frames, self._frames + 1, (height_px, width_px)
        self.backward += header.pts_ns <= self._last_ns
        self._last_ns = header.pts_ns
        return Frame(
            header=dataclasses.replace(header, seq=number, frame_first=number, frame_last=number),
            height_px=height_px,
            width_px=width_px,
            codec=codec,
            keyframe=keyframe,
            luma=luma,
        )

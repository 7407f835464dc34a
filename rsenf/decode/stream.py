"""Decodes one video stream: packets in; frames with exact times, and recordable packets, out.

A frame has the luma plane of its picture, without colour conversion where the format has one.
"""

from __future__ import annotations

import dataclasses
import functools
import struct
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, cast

import av
import numpy as np
from av.container import InputContainer
from av.video.plane import VideoPlane
from numpy.typing import NDArray

from rsenf.decode.container import describe, fraction
from rsenf.decode.decoder import Decoder, OnDevice, Packet, device_decoder
from rsenf.decode.packets import ASSUMED_RATE_HZ, FrameClock, PacketWriter
from rsenf.decode.source import LEAP_NS, Effort, Item, SourceSpec, Stamp
from rsenf.messages import Frame, RateBasis, VideoPacket
from rsenf.timebase import NS_PER_S

_BYTE = np.dtype(np.uint8)


@dataclass(frozen=True)
class _Layout:
    """Where a pixel format keeps its luma."""

    convert_to: str  # format to convert to first; empty if plane 0 is luma alone
    dtype: np.dtype[Any]
    shift: int  # bits of a sample beyond 8


@functools.cache
def _layout(pixel_format: str) -> _Layout:
    fmt = av.VideoFormat(pixel_format)
    if fmt.is_rgb or fmt.has_palette or fmt.is_bit_stream or fmt.is_bayer:
        return _Layout("gray", _BYTE, 0)  # no luma: a weighted sum of the colours
    bits = fmt.components[0].bits
    if bits > 16 or not (fmt.is_planar or len(fmt.components) == 1):
        return _Layout("yuv422p", _BYTE, 0)  # luma interleaved with chroma: separate them
    if bits == 8:
        return _Layout("", _BYTE, 0)
    # Samples of 9 to 16 bits use the low bits of two bytes; P010 and related formats the high ones.
    high = pixel_format.startswith(("p0", "p2", "p4"))
    dtype = np.dtype(">u2" if fmt.is_big_endian else "<u2")
    return _Layout("", dtype, 8 if high else bits - 8)


def luma_plane(frame: av.VideoFrame) -> NDArray[np.uint8]:
    """Return the luma of a picture, rows × columns, uint8, read-only.

    For 8-bit formats it is a view that keeps the decoder's buffer alive. Deeper samples are scaled
    to 8-bit levels and rounded. The range (16 to 235, or 0 to 255) stays as coded; only for formats
    without luma (RGB, palettes) full-range luma is computed.
    """
    layout = _layout(frame.format.name)
    if layout.convert_to:
        frame = frame.reformat(format=layout.convert_to)
    plane: Any = VideoPlane(frame, 0)  # frame.planes makes all of them
    line_bytes = plane.line_size  # padded at many widths
    size_px, strides = (frame.height, frame.width), (abs(line_bytes), layout.dtype.itemsize)
    samples: NDArray[Any] = np.ndarray(size_px, layout.dtype, plane, strides=strides)
    if line_bytes < 0:
        samples = samples[::-1]  # stored bottom-up
    luma = _to_8_bit(samples, layout.shift) if layout.shift else samples
    luma.flags.writeable = False  # this memory is the decoder's reference for later pictures
    return luma


def _to_8_bit(samples: NDArray[np.uint16], shift: int) -> NDArray[np.uint8]:
    import cv2

    native = samples.astype(np.uint16, copy=False)
    scaled: NDArray[np.uint8] = cv2.convertScaleAbs(native, alpha=2.0**-shift)
    return scaled


# AVFMT_FLAG_GENPTS, which PyAV sets: guess missing time stamps. FrameClock does better.
_GENPTS = 0x0001


class StreamDecoder:
    """Decodes the packets of one video stream.

    The container is used only in the constructor, so that another thread may close it while the
    last packets are still being decoded.

    Frames that the decoder marks as damaged are left out and counted. They use up a number, which
    leaves a visible gap. A change of picture size ends the stream.

    Parameters
    ----------
    container, stream : av.container.InputContainer, av.VideoStream
        Source of the packets.
    spec, stamp : SourceSpec, Stamp
        How to decode, and what to write in the headers.
    epoch : int
        Epoch of the frames.
    live : bool
        A session joined while it runs: failures before its first frame aren't counted as loss, and
        a clock that jumps back, or far ahead, ends it.
    on_device : callable, optional
        As for :class:`rsenf.decode.decoder.Decoder`.

    Attributes
    ----------
    info : StreamInfo
        Its rotation is known after the first frame.
    decoder : Decoder
    ended : str
        Why the stream has ended; empty while it goes on.
    backward : int
        Frames that are not later than the one before.
    damaged_packets, damaged_frames : int
        Number of losses.
    """

    def __init__(
        self,
        container: InputContainer,
        stream: av.VideoStream,
        spec: SourceSpec,
        stamp: Stamp,
        *,
        epoch: int = 0,
        live: bool = False,
        on_device: OnDevice = device_decoder,
    ) -> None:
        container.flags &= ~_GENPTS
        self._writer = PacketWriter(stream)
        self._with_packets = spec.with_packets and self._writer.recordable
        self._given_hz = spec.frame_rate_hz
        self.info = describe(container, stream, self._writer, self._given_hz)
        rate_hz = Fraction(self._given_hz or 0) or fraction(stream.guessed_rate)
        self._clock = FrameClock(fraction(stream.time_base), rate_hz)
        self._live = live
        self.decoder = Decoder(stream.codec_context, spec, live=live, on_device=on_device)
        self._stamp = stamp
        self._epoch = epoch
        self._frame_number = 0
        self._packet_number = 0
        self._first_ns: int | None = None
        self._last_ns = 0
        self._camera_offset_ns = 0  # camera's wall clock minus the stream's clock; 0: unknown
        self.ended = ""
        self.backward = 0
        self.damaged_packets = 0
        self.damaged_frames = 0

    @property
    def started(self) -> bool:
        """Whether a frame has been decoded."""
        return self._first_ns is not None

    @property
    def time_s(self) -> float:
        """Time from the first frame to the last, in seconds."""
        return 0.0 if self._first_ns is None else (self._last_ns - self._first_ns) / NS_PER_S

    @property
    def guesses(self) -> str:
        """How frame times were inferred; empty if the stream has all of them."""
        basis = self.info.rate_basis
        if self._given_hz:
            return f"frames are counted at the {self._given_hz:.6g} a second that were given"
        if basis is RateBasis.ASSUMED:
            return (
                "the stream holds neither frame times nor a rate: "
                f"{ASSUMED_RATE_HZ} frames a second are assumed"
            )
        if basis is RateBasis.DECLARED or self._clock.from_rate:
            rate = f"{self.info.declared_rate_hz:.6g} frames a second"
            return f"the stream holds no frame times: they are counted at the declared {rate}"
        if self._clock.from_order:
            return f"{self._clock.from_order} frames without a time are timed by decoding order"
        return ""

    def feed(self, packet: Packet, arrival_ns: int) -> list[Item]:
        """Decode one packet; an empty one flushes the decoder.

        Parameters
        ----------
        packet : av.Packet
        arrival_ns : int
            When it arrived, by the host's wall clock.

        Returns
        -------
        list of VideoPacket or Frame
            The packet, if requested, then the frames that it completed.
        """
        items: list[Item] = []
        if packet.size:
            if self._live:
                packet.opaque = (arrival_ns,)  # a new object each time: PyAV uses its identity
            if self._given_hz:
                packet.pts = packet.dts = None
            time_ns = self._clock.expect(packet)
            self._follow_camera_clock(packet, time_ns)
            if self._with_packets and (data := self._writer.data(packet)):
                items.append(self._packet(packet, data, time_ns, arrival_ns))
            self._count_damage(packet.is_corrupt)
        try:
            for picture, effort in self.decoder.decode(packet if packet.size else None):
                frame = self._frame(picture, effort, arrival_ns)
                if self.ended:
                    break
                if frame:
                    items.append(frame)
        except av.FFmpegError:
            self._count_damage(not packet.is_corrupt)
            self._clock.forget()
        return items

    def skip(self, packets: int) -> None:
        """Note that packets were dropped before the next one: leaves a gap in the numbers."""
        self._packet_number += packets
        self._frame_number += packets

    def _count_damage(self, damaged: bool) -> None:
        self.damaged_packets += damaged and (self.started or not self._live)

    def _follow_camera_clock(self, packet: Packet, time_ns: int) -> None:
        """Take the camera's wall clock from RTCP reports, which FFmpeg attaches to packets."""
        if packet.has_sidedata("prft") and packet.pts is not None:
            # AVProducerReferenceTime: a signed 64-bit count of µs since 1970, then flags.
            (wall_us,) = struct.unpack_from("=q", bytes(packet.get_sidedata("prft")))
            self._camera_offset_ns = wall_us * 1000 - time_ns

    def _packet(self, packet: Packet, data: bytes, time_ns: int, arrival_ns: int) -> VideoPacket:
        header = self._stamp.header(
            epoch=self._epoch,
            seq=self._packet_number,
            frame=-1,  # unknown before decoding; its time identifies the frame
            pts_ns=time_ns,
            camera_ns=self.camera_time_ns(time_ns),
            arrival_ns=arrival_ns,
            rate_basis=self.info.rate_basis,
        )
        self._packet_number += 1
        return VideoPacket(
            header=header,
            codec=self._writer.codec,
            keyframe=packet.is_keyframe,
            data=data,
            untimed=packet.pts is None,
        )

    def _frame(self, picture: av.VideoFrame, effort: Effort, arrival_ns: int) -> Frame | None:
        number, self._frame_number = self._frame_number, self._frame_number + 1
        pts_ns = self._clock.time_ns(picture.pts)
        if picture.is_corrupt:
            self.damaged_frames += 1
            return None
        if self._first_ns is None:
            self._begin(picture, pts_ns)
        elif (picture.width, picture.height) != (self.info.width_px, self.info.height_px):
            self.ended = f"the picture changes its size to {picture.width}×{picture.height}"
        elif pts_ns <= self._last_ns - (0 if self._live else NS_PER_S):  # files have small disorder
            self.ended = "its time stamps jump back"
        elif pts_ns > self._last_ns + LEAP_NS and self._live:
            self.ended = f"its time stamps leap by {(pts_ns - self._last_ns) / NS_PER_S:.0f} s"
        elif pts_ns <= self._last_ns:
            self.backward += 1
        if self.ended:
            return None
        self._last_ns = pts_ns
        return Frame(
            header=self._stamp.header(
                epoch=self._epoch,
                seq=number,
                frame=number,
                pts_ns=pts_ns,
                camera_ns=self.camera_time_ns(pts_ns),
                arrival_ns=cast("tuple[int]", picture.opaque)[0] if self._live else arrival_ns,
                rate_basis=self.info.rate_basis,
            ),
            height_px=picture.height,
            width_px=picture.width,
            rotation_deg=self.info.rotation_deg,
            declared_rate_hz=self.info.declared_rate_hz,
            codec=self._writer.codec,
            keyframe=picture.key_frame,
            effort="fast" if effort == "fast" else "",
            luma=luma_plane(picture),
        )

    def _begin(self, picture: av.VideoFrame, pts_ns: int) -> None:
        self._first_ns = pts_ns
        self.info = dataclasses.replace(
            self.info,
            width_px=picture.width,
            height_px=picture.height,
            rotation_deg=-picture.rotation % 360,  # FFmpeg counts counter-clockwise
        )
        if self.info.camera_start_ns:
            self._camera_offset_ns = self.info.camera_start_ns - pts_ns

    def camera_time_ns(self, time_ns: int) -> int:
        """Return the camera's wall clock at a time of the stream; 0 while unknown."""
        return time_ns + self._camera_offset_ns if self._camera_offset_ns else 0

"""A V4L2 camera as a source, through OpenCV."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from rsenf.decode.live import LiveSource
from rsenf.decode.pump import Disconnected, Pump, Stop
from rsenf.decode.source import LEAP_NS, Item, SourceSpec, Stamp, StreamInfo, VideoSource
from rsenf.messages import Frame, VideoPacket

_NS_PER_US = 1000
_HINT = "check that the camera is plugged in, readable by you, and not in use by another program"
# Levels of these formats per 8-bit level.
_DEEP = {"Y10 ": 4, "Y12 ": 16, "Y16 ": 256}


class VideoCapture(Protocol):
    """The methods used of ``cv2.VideoCapture``."""

    def isOpened(self) -> bool: ...  # noqa: D102 - OpenCV's names

    def read(self) -> tuple[bool, NDArray[Any]]: ...  # noqa: D102 - as above

    def get(self, prop: int) -> float: ...  # noqa: D102 - as above

    def release(self) -> None: ...  # noqa: D102 - as above


CaptureFactory = Callable[[str], VideoCapture]


def open_camera(
    spec: SourceSpec,
    stamp: Stamp,
    stop: Stop,
    on_event: Callable[[str], None],
    factory: CaptureFactory | None = None,
) -> VideoSource:
    """Open a V4L2 source; see :func:`rsenf.decode.open_source`."""

    def connect(epoch: int) -> _CameraConnection:
        return _CameraConnection(spec, stamp, stop, epoch, factory or _opencv_capture)

    return LiveSource(spec, stamp, stop, connect, on_event)


def _opencv_capture(url: str) -> VideoCapture:
    device = Path(f"/dev/video{url}" if url.isdigit() else url).resolve()  # /dev/v4l/by-id/…
    number = device.name.removeprefix("video")
    if not device.exists() or not number.isdigit():
        raise Disconnected("there is no such camera", _HINT)
    # Otherwise OpenCV writes to stderr; errors are reported here.
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    unconverted = [cv2.CAP_PROP_CONVERT_RGB, 0]
    capture: VideoCapture = cv2.VideoCapture(int(number), cv2.CAP_V4L2, unconverted)
    return capture


@dataclass(frozen=True)
class _Shot:
    """One picture as the driver delivered it, with the driver's and this host's times."""

    image: NDArray[Any]
    fourcc: str
    height_px: int
    rate_hz: float
    device_ns: int
    steady_ns: int
    arrival_ns: int

    @property
    def is_jpeg(self) -> bool:
        return self.image.ndim < 3 and self.image.ravel()[:2].tobytes() == b"\xff\xd8"


def _shots(url: str, factory: CaptureFactory, stamp: Stamp) -> Iterator[_Shot]:
    """Read pictures; runs in the pump's thread, the only one that uses the device."""
    capture = factory(url)
    try:
        if not capture.isOpened():
            raise Disconnected("the camera can't be opened", _HINT)
        fourcc = int(capture.get(cv2.CAP_PROP_FOURCC)).to_bytes(4, "little").decode("latin-1")
        height_px = int(capture.get(cv2.CAP_PROP_FRAME_HEIGHT))
        rate_hz = capture.get(cv2.CAP_PROP_FPS)
        while True:
            good, image = capture.read()
            steady_ns, arrival_ns = stamp.steady_ns(), stamp.clock_ns()
            if not good:
                raise Disconnected("the camera gives no more pictures", _HINT)
            device_us = round(capture.get(cv2.CAP_PROP_POS_MSEC) * 1000)
            device_ns = device_us * _NS_PER_US
            yield _Shot(image, fourcc, height_px, rate_hz, device_ns, steady_ns, arrival_ns)
    finally:
        capture.release()


class _CameraConnection:
    """An open camera.

    The time of a picture is the driver's if that clock runs; else its arrival by a monotonic
    clock, counted from the first picture.
    """

    def __init__(
        self, spec: SourceSpec, stamp: Stamp, stop: Stop, epoch: int, factory: CaptureFactory
    ) -> None:
        self._stamp = stamp
        self._epoch = epoch
        self._timeout_s = spec.read_timeout_s
        self._with_packets = spec.with_packets
        self.pump = Pump(lambda: _shots(spec.url, factory, stamp), stop, lambda shot: True)
        self._number = -1
        try:
            # Two pictures, to see whether the driver's clock runs.
            self._ahead = [self._next(spec.open_timeout_s), self._next(spec.read_timeout_s)]
        except BaseException:
            self.pump.close()
            raise
        first, second = self._ahead
        self._by_device = 0 < first.device_ns < second.device_ns
        self._origin_ns = 0 if self._by_device else first.steady_ns
        luma = _luma(first)
        if luma is None:
            self.pump.close()
            raise Disconnected(f"its pixel format {first.fourcc!r} can't be read")
        self._size = luma.shape
        self.damaged = 0
        self.info = StreamInfo(
            codec="mjpeg" if first.is_jpeg else "rawvideo",
            width_px=luma.shape[1],
            height_px=luma.shape[0],
            declared_rate_hz=first.rate_hz,
            live=True,
            packets_recordable=first.is_jpeg,
            packets_reason="" if first.is_jpeg else "the camera sends uncompressed pictures",
        )

    @property
    def warnings(self) -> list[str]:
        """Warnings that belong in a result, one line each."""
        if self._by_device:
            return []
        return ["the camera gives no times: those of arrival are taken, which are late and uneven"]

    def _next(self, timeout_s: float) -> _Shot:
        try:
            return self.pump.get(timeout_s)
        except TimeoutError:
            raise Disconnected(f"no picture for {timeout_s:g} s", _HINT) from None

    def _all_shots(self) -> Iterator[_Shot]:
        """Yield every picture, and count the dropped ones."""
        self.pump.may_drop = True
        for shot in self._ahead:
            self._number += 1
            yield shot
        self._ahead = []
        while True:
            shot = self._next(self._timeout_s)
            self._number += 1 + self.pump.skipped
            yield shot

    def items(self) -> Iterator[Item]:
        """Yield packets and frames."""
        last_ns = -1
        for shot in self._all_shots():
            time_ns = (shot.device_ns if self._by_device else shot.steady_ns) - self._origin_ns
            if time_ns <= last_ns:
                raise Disconnected("its clock jumps back")
            if last_ns >= 0 and time_ns > last_ns + LEAP_NS:
                raise Disconnected("its clock leaps")
            last_ns = time_ns
            yield from self._shot_items(self._number, time_ns, shot)

    def _shot_items(self, number: int, time_ns: int, shot: _Shot) -> Iterator[Item]:
        header = self._stamp.header(
            epoch=self._epoch,
            seq=number,
            frame=number,
            pts_ns=time_ns,
            camera_ns=0,
            arrival_ns=shot.arrival_ns,
        )
        if self._with_packets and shot.is_jpeg:
            data = shot.image.tobytes()
            yield VideoPacket(header=header, codec="mjpeg", keyframe=True, data=data)
        luma = _luma(shot)
        if luma is None:
            self.damaged += 1
            return
        if luma.shape != self._size:
            raise Disconnected("the picture changes its size")
        luma.flags.writeable = False
        yield Frame(
            header=header,
            height_px=luma.shape[0],
            width_px=luma.shape[1],
            declared_rate_hz=self.info.declared_rate_hz,
            codec=self.info.codec,
            keyframe=True,
            luma=luma,
        )

    def close(self) -> None:
        """Release the camera, without waiting."""
        self.pump.close()


def _luma(shot: _Shot) -> NDArray[np.uint8] | None:
    """Return the luma of an unconverted picture from OpenCV; None if it can't be read."""
    image = shot.image
    if shot.is_jpeg:
        # libjpeg returns the luma as coded, without colour conversion.
        decoded: NDArray[np.uint8] | None = cv2.imdecode(image.ravel(), cv2.IMREAD_GRAYSCALE)
        return decoded
    if image.ndim == 3 and image.shape[2] == 3:  # a driver that supports RGB only
        return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY))
    if image.ndim == 3 and image.shape[2] == 2:  # YUYV, or UYVY
        return np.ascontiguousarray(image[:, :, 1 if shot.fourcc == "UYVY" else 0])
    if image.dtype == np.uint16:
        return np.asarray(cv2.convertScaleAbs(image, alpha=1 / _DEEP.get(shot.fourcc, 256)))
    if image.ndim == 2 and image.shape[0] >= shot.height_px:
        return image[: shot.height_px].view()  # grey, or NV12 and I420: luma above chroma
    return None

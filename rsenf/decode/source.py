"""Sources of video: what to open, the interface common to all, and the function that opens one.

Frames made by this process, such as the simulator's, are a source like any other.
"""

from __future__ import annotations

import dataclasses
import math
import os
import re
import sys
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from threading import Event
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from rsenf.decode.pump import Pacer, Stop
from rsenf.errors import UsageError
from rsenf.messages import Frame, Header, RateBasis, VideoPacket
from rsenf.timebase import NS_PER_S

Kind = Literal["file", "rtsp", "v4l2"]
Effort = Literal["full", "fast"]
EffortChoice = Literal["full", "fast", "auto"]

# When the clock of a live stream jumps by more, it was set, or the stream paused: a new stream.
LEAP_NS = 10 * NS_PER_S

# A password may contain blanks; then only the @ after it shows where it ends.
_URL = re.compile(r"([a-z][a-z0-9+.-]*://)((?:[^\s/:@]*:[^\n/@]*@)?\S+)", re.IGNORECASE)


def cores() -> int:
    """Return the number of cores that this process may use."""
    if sys.platform == "linux":
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def redact(text: str) -> str:
    """Return a text with the credentials of every address in it replaced by ``***``.

    Users and passwords stand before an ``@``, but cameras also take them as parameters
    (``?user=…``, ``/user=…_password=…``), so every parameter is replaced too.

    >>> redact("no answer from rtsp://me:secret@10.0.0.7/stream?token=1")
    'no answer from rtsp://***@10.0.0.7/stream?***'
    """
    return _URL.sub(lambda m: m[1] + _redacted(m[2]), text)


def _redacted(address: str) -> str:
    login, at, rest = address.rpartition("@")
    if at and re.search(r"[?=]", login):
        return "***"  # an @ among the parameters: the end of the password is unknown
    rest = re.sub(r"\?.*", "?***", rest)
    rest = re.sub(r"[^/?]*=.*", "***", rest)
    return "***@" + rest if at else rest


def kind_of(url: str) -> Kind:
    """Return the kind of a source by its address: file, camera on the network, or V4L2 camera.

    >>> [kind_of(url) for url in ("a.mp4", "rtsp://10.0.0.7/1", "/dev/video0", "v4l2:/dev/v4l/x")]
    ['file', 'rtsp', 'v4l2', 'v4l2']
    """
    if re.match(r"(rtsp|http)s?://", url, re.IGNORECASE):
        return "rtsp"
    if url.isdigit() or url.startswith(("/dev/video", "/dev/v4l/", "v4l2:")):
        return "v4l2"
    return "file"


@dataclass(frozen=True, kw_only=True)
class SourceSpec:
    """What to open, and how to react to failures.

    Parameters
    ----------
    url : str
        A path, ``rtsp://…``, ``http://…``, or a V4L2 device (``/dev/video0`` or its number). It may
        contain a password: show :attr:`name` instead.
    kind : {'file', 'rtsp', 'v4l2'}
        As :func:`kind_of` returns it; 'rtsp' for any address on the network.
    frame_rate_hz : float or None
        Constant frame rate that replaces a file's time stamps, if it has none or wrong ones.
    threads : int
        Decoder threads. 0 uses all cores: best for a file, but delays a live feed by one frame per
        thread. 1 is best where many feeds share the cores.
    effort : {'full', 'fast', 'auto'}
        'fast' leaves out the codec's loop filter; 'auto' does so on a network camera while its
        pictures come faster than they are decoded.
    hwaccel : str
        Device to decode on: FFmpeg's name for its kind, 'auto' for the first that is there, or
        'none'. Without such a device the processor decodes.
    with_packets : bool
        Also yield each compressed picture, for recording without re-encoding.
    pace : bool
        Yield a file's frames in real time, as if live.
    open_timeout_s, read_timeout_s : float
        Time limits for a live source to answer, and to send the next picture.
    backoff_initial_s, backoff_max_s : float
        Pause before the first attempt to reconnect; it doubles with each attempt, up to the
        maximum.
    max_reconnects : int or None
        Failed attempts in a row before a live source is given up; None for no limit.
    wait_for_source : bool
        Retry when the first connection fails, instead of raising an error.
    """

    url: str = field(repr=False)
    kind: Kind
    frame_rate_hz: float | None = None
    threads: int = 0
    effort: EffortChoice = "auto"
    hwaccel: str = "none"
    with_packets: bool = False
    pace: bool = False
    open_timeout_s: float = 10.0
    read_timeout_s: float = 10.0
    backoff_initial_s: float = 1.0
    backoff_max_s: float = 30.0
    max_reconnects: int | None = None
    wait_for_source: bool = False

    @property
    def name(self) -> str:
        """The address without credentials, for messages."""
        return redact(self.url)


@dataclass(frozen=True, kw_only=True)
class StreamInfo:
    """What a source declares about itself."""

    codec: str = ""
    width_px: int = 0
    height_px: int = 0
    rotation_deg: int = 0  # clockwise, for display; planes are as coded
    declared_rate_hz: float = 0.0  # 0: unknown
    rate_basis: RateBasis = RateBasis.STAMPED  # where frame times come from
    duration_s: float | None = None
    frame_count: int | None = None  # an estimate
    live: bool = False
    camera_start_ns: int = 0  # UTC of the first frame by the container; 0: unknown
    packets_recordable: bool = False
    packets_reason: str = ""  # why not recordable, or what players of the recording must support


if TYPE_CHECKING:
    from rsenf.decode.v4l2 import CaptureFactory

Item = Frame | VideoPacket


@dataclass(frozen=True)
class Stamp:
    """Origin of the messages, and this host's wall clock and monotonic clock, in ns."""

    source: str
    run_id: str
    clock_ns: Callable[[], int]
    steady_ns: Callable[[], int] = time.monotonic_ns

    def header(
        self,
        *,
        epoch: int,
        seq: int,
        frame: int,
        pts_ns: int,
        camera_ns: int,
        arrival_ns: int,
        rate_basis: RateBasis = RateBasis.STAMPED,
    ) -> Header:
        """Return the header of a message that covers one frame, or none (``frame=-1``)."""
        return Header(
            run_id=self.run_id,
            source=self.source,
            epoch=epoch,
            seq=seq,
            frame_first=frame,
            frame_last=frame,
            pts_ns=pts_ns,
            camera_time_ns=camera_ns,
            arrival_time_ns=arrival_ns,
            rate_basis=rate_basis,
        )


class VideoSource(ABC):
    """Yields frames in presentation order, and each packet before the frames decoded from it.

    A context manager. ``close()``, or setting the event given to :func:`open_source`, ends the
    iteration within a second; both are allowed from any thread.
    """

    info: StreamInfo

    def __init__(self, stamp: Stamp, stop: Stop, *, pace: bool = False) -> None:
        self._stamp = stamp
        self._stop = stop
        self._pacer = Pacer(time.monotonic, stop.wait) if pace else None

    @property
    @abstractmethod
    def loss(self) -> str:
        """What was lost until now, in one line; empty for nothing."""

    @property
    def backlog(self) -> tuple[int, int]:
        """Pictures that wait for the consumer, and those dropped because it was too slow."""
        return 0, 0

    @property
    def warnings(self) -> list[str]:
        """Warnings that belong in a result though nothing was lost, one line each."""
        return []

    @abstractmethod
    def _items(self) -> Iterator[Item]:
        """Yield packets and frames until the source ends or is stopped."""

    def __iter__(self) -> Iterator[Item]:
        """Yield packets and frames. Can be called once only."""
        for item in self._items():
            if self._pacer and isinstance(item, Frame):
                self._pacer.wait_for(item.header.pts_ns)
                now = dataclasses.replace(item.header, arrival_time_ns=self._stamp.clock_ns())
                item = dataclasses.replace(item, header=now)
            if self._stop.is_set():
                return
            yield item

    def close(self) -> None:
        """Stop the iteration and release the file or device."""
        self._stop.set()

    def __enter__(self) -> VideoSource:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


def open_source(
    spec: SourceSpec,
    *,
    source: str,
    run_id: str,
    clock_ns: Callable[[], int],
    steady_ns: Callable[[], int] = time.monotonic_ns,
    stop: Event | None = None,
    on_event: Callable[[str], None] = lambda line: None,
    capture_factory: CaptureFactory | None = None,
) -> VideoSource:
    """Open a file or a live source, and decode its first frame.

    Parameters
    ----------
    spec : SourceSpec
        What to open.
    source, run_id : str
        For the headers of the frames.
    clock_ns : callable
        The host's wall clock, for arrival times.
    steady_ns : callable
        A monotonic clock, for cameras without time stamps.
    stop : Event, optional
        Set it to end iteration, opening and waiting within a second.
    on_event : callable, optional
        Called with one line of text, without credentials, when a live source is lost, tried again
        or back.
    capture_factory : callable, optional
        Opens a V4L2 device; OpenCV's by default.

    Raises
    ------
    UsageError
        When a file doesn't exist or is no file, or ``spec.frame_rate_hz`` is not allowed or valid.
    InputError
        When no frame of a file can be decoded.
    SourceLost
        When a live source can't be reached. Iteration raises it when one is given up.
    """
    if spec.frame_rate_hz is not None:
        if spec.kind != "file":
            raise UsageError(f"{spec.name} has times of its own", "give a frame rate with files")
        if not 0.0 < spec.frame_rate_hz < math.inf:
            raise UsageError(f"a frame rate of {spec.frame_rate_hz:g} Hz", "give one above 0")
    stamp, stopped = Stamp(source, run_id, clock_ns, steady_ns), Stop(stop)
    # Imported here: importing FFmpeg and OpenCV takes 0.3 s, and a source needs only one of them.
    if spec.kind == "file":
        from rsenf.decode.file import FileSource

        return FileSource(spec, stamp, stopped)
    if spec.kind == "rtsp":
        from rsenf.decode.rtsp import open_rtsp

        return open_rtsp(spec, stamp, stopped, on_event)
    from rsenf.decode.v4l2 import open_camera

    return open_camera(spec, stamp, stopped, on_event, capture_factory)


def from_frames(
    frames: Iterable[tuple[int, NDArray[np.uint8]]],
    info: StreamInfo,
    *,
    source: str,
    run_id: str,
    clock_ns: Callable[[], int],
    pace: bool = False,
    stop: Event | None = None,
) -> VideoSource:
    """Make a source of ``(pts_ns, luma)`` pairs.

    Parameters
    ----------
    frames : iterable of (int, ndarray)
        Presentation time in ns, and a luma plane of rows × columns, uint8; in presentation order.
    info : StreamInfo
        Their description; with ``camera_start_ns`` each frame gets a camera time.
    source, run_id, clock_ns, stop
        As for :func:`rsenf.decode.open_source`.
    pace : bool
        Yield each frame at its time, as if live.
    """
    return _GivenFrames(frames, info, Stamp(source, run_id, clock_ns), Stop(stop), pace=pace)


class _GivenFrames(VideoSource):
    def __init__(
        self,
        frames: Iterable[tuple[int, NDArray[np.uint8]]],
        info: StreamInfo,
        stamp: Stamp,
        stop: Stop,
        *,
        pace: bool,
    ) -> None:
        super().__init__(stamp, stop, pace=pace)
        self.info = info
        self._frames = frames

    @property
    def loss(self) -> str:
        return ""

    def _items(self) -> Iterator[Item]:
        first_ns: int | None = None
        for number, (pts_ns, luma) in enumerate(self._frames):
            if first_ns is None:
                first_ns = pts_ns
            start_ns = self.info.camera_start_ns
            yield Frame(
                header=self._stamp.header(
                    epoch=0,
                    seq=number,
                    frame=number,
                    pts_ns=pts_ns,
                    camera_ns=start_ns + pts_ns - first_ns if start_ns else 0,
                    arrival_ns=self._stamp.clock_ns(),
                ),
                height_px=luma.shape[0],
                width_px=luma.shape[1],
                rotation_deg=self.info.rotation_deg,
                declared_rate_hz=self.info.declared_rate_hz,
                codec=self.info.codec,
                keyframe=True,
                luma=luma,
            )

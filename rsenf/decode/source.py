"""The common interface of video sources, and the function that opens them."""

from __future__ import annotations

import dataclasses
import math
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from threading import Event
from types import TracebackType
from typing import TYPE_CHECKING

from rsenf.decode.spec import SourceSpec, StreamInfo
from rsenf.decode.waiting import Pacer, Stop
from rsenf.errors import UsageError
from rsenf.messages import Frame, Header, RateBasis, VideoPacket

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

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
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

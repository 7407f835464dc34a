"""Frames made by this process, such as the simulator's, as a source like any other."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from threading import Event

import numpy as np
from numpy.typing import NDArray

from rsenf.decode.source import Item, Stamp, VideoSource
from rsenf.decode.spec import StreamInfo
from rsenf.decode.waiting import Stop
from rsenf.messages import Frame


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

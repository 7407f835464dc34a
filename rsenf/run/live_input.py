"""A camera as the input of a one-process command: tracked while it films, or looked at for a while.

It is the live source of the decode node: a camera that is lost is connected again, under a new
epoch, and its password appears in no message.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from threading import Event
from typing import Any

from rsenf.decode.source import EffortChoice, Item, SourceSpec, StreamInfo, kind_of, open_source
from rsenf.messages import Frame
from rsenf.run.inputs import Decoded
from rsenf.run.process import HostClock
from rsenf.timebase import NS_PER_S


def is_live(url: str) -> bool:
    """Whether an address is a camera's, not a file's.

    >>> is_live("rtsp://10.0.0.7/stream"), is_live("clip.mp4")
    (True, False)
    """
    return kind_of(url) != "file" and not Path(url).is_file()


class LiveInput(Decoded):
    """Frames of a camera, until it is told to stop; or of the first seconds of any source.

    Parameters
    ----------
    url : str
        As for :class:`rsenf.decode.SourceSpec`.
    stop : Event
        Ends the input.
    on_event : callable
        Called with one line of text when the camera is lost, tried again or back.
    seconds : float, optional
        Time on the stream's clock after which it ends. Such an input doesn't connect again.
    on_item : callable, optional
        Called with each compressed packet, if ``seconds`` is given, and each frame.
    frame_rate_hz, effort : optional
        As for :class:`rsenf.decode.SourceSpec`.

    Raises
    ------
    SourceLost
        When the camera can't be reached; while iterating, when it is given up.
    UsageError, InputError
        When a file can't be read.
    """

    tells_arrival = True

    def __init__(
        self,
        url: str,
        stop: Event,
        on_event: Callable[[str], None],
        *,
        seconds: float | None = None,
        on_item: Callable[[Item], None] = lambda item: None,
        frame_rate_hz: float | None = None,
        effort: EffortChoice = "auto",
    ) -> None:
        kind = kind_of(url) if is_live(url) else "file"
        spec = SourceSpec(
            url=url.removeprefix("v4l2:"),
            kind=kind,
            threads=0 if kind == "file" else 1,
            with_packets=seconds is not None,
            max_reconnects=None if seconds is None else 0,
            frame_rate_hz=frame_rate_hz,
            effort=effort,
        )
        self.name, self._seconds, self._on_item = spec.name, seconds, on_item
        self._source = open_source(
            spec,
            source="live/camera" if kind != "file" else f"file/{Path(url).stem}",
            run_id="",
            clock_ns=HostClock(on_event),
            stop=stop,
            on_event=on_event,
        )

    @property
    def info(self) -> StreamInfo:
        """What the source declares about itself."""
        return self._source.info

    def messages(self) -> Iterator[Any]:
        """Yield its frames."""
        first_ns: int | None = None
        with self._source as source:
            for item in source:
                self._on_item(item)
                if not isinstance(item, Frame):
                    continue
                yield item
                first_ns = item.header.pts_ns if first_ns is None else first_ns
                lasted_s = (item.header.pts_ns - first_ns) / NS_PER_S
                if self._seconds is not None and lasted_s >= self._seconds:
                    return

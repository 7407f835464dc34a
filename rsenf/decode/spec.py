"""Descriptions of a source to open, and of the stream that was found."""

from __future__ import annotations

import os
import re
import sys
from dataclasses import dataclass, field
from typing import Literal

from rsenf.messages import RateBasis
from rsenf.timebase import NS_PER_S

Kind = Literal["file", "rtsp", "v4l2"]

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
    """Return the kind of a source by its address: file, RTSP or V4L2 camera.

    >>> [kind_of(url) for url in ("a.mp4", "rtsp://10.0.0.7/1", "/dev/video0", "v4l2:/dev/v4l/x")]
    ['file', 'rtsp', 'v4l2', 'v4l2']
    """
    if re.match(r"rtsps?://", url, re.IGNORECASE):
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
        A path, ``rtsp://…``, or a V4L2 device (``/dev/video0`` or its number). It may contain a
        password: show :attr:`name` instead.
    kind : {'file', 'rtsp', 'v4l2'}
        As :func:`kind_of` returns it.
    frame_rate_hz : float or None
        Constant frame rate that replaces a file's time stamps, if it has none or wrong ones.
    threads : int
        Decoder threads. 0 uses all cores: best for a file, but delays a live feed by one frame per
        thread. 1 is best where many feeds share the cores.
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
    time_step_s: float = 0.0  # tick of the time stamps (1 ms in Matroska)
    duration_s: float | None = None
    frame_count: int | None = None  # an estimate
    live: bool = False
    camera_start_ns: int = 0  # UTC of the first frame by the container; 0: unknown
    has_b_frames: bool = False
    packets_recordable: bool = False
    packets_reason: str = ""  # why not recordable, or what players of the recording must support

"""What to open, and what was found: plain values."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Literal

from rsenf.messages import RateBasis
from rsenf.timebase import NS_PER_S

Kind = Literal["file", "rtsp", "v4l2"]

# A live stream whose clock leaps by more was set, or has paused for so long: it is another stream.
LEAP_NS = 10 * NS_PER_S

# A password may have blanks, and then only the @ after it tells where it ends.
_URL = re.compile(r"([a-z][a-z0-9+.-]*://)((?:[^\s/:@]*:[^\n/@]*@)?\S+)", re.IGNORECASE)


def redact(text: str) -> str:
    """Return a text with the credentials of every address in it replaced by ``***``.

    Users and passwords stand before an ``@``, but cameras also take them as parameters
    (``?user=…``, ``/user=…_password=…``), so every parameter goes too.
    """
    return _URL.sub(lambda m: m[1] + _redacted(m[2]), text)


def _redacted(address: str) -> str:
    login, at, rest = address.rpartition("@")
    if at and re.search(r"[?=]", login):
        return "***"  # an @ among the parameters: no telling where a password ends
    rest = re.sub(r"\?.*", "?***", rest)
    rest = re.sub(r"[^/?]*=.*", "***", rest)
    return "***@" + rest if at else rest


def kind_of(url: str) -> Kind:
    """Tell a file, an RTSP address and a V4L2 camera (``/dev/video0``, ``v4l2:…``, ``0``) apart."""
    if re.match(r"rtsps?://", url, re.IGNORECASE):
        return "rtsp"
    if url.isdigit() or url.startswith(("/dev/video", "/dev/v4l/", "v4l2:")):
        return "v4l2"
    return "file"


@dataclass(frozen=True, kw_only=True)
class SourceSpec:
    """What to open and how to behave when it fails.

    Parameters
    ----------
    url : str
        A path, ``rtsp://…``, or a V4L2 device (``/dev/video0`` or its number). Never shown whole:
        it may hold a password.
    kind : {'file', 'rtsp', 'v4l2'}
        Which of them it is; :func:`kind_of` tells.
    frame_rate_hz : float or None
        Rate at which a file's frames are counted, in place of its own times: for one that has none,
        or wrong ones.
    threads : int
        Decoder threads. 0 is what keeps all cores busy: best for one file, but a live feed is then
        late by a frame a thread. 1 is best where many feeds share the cores.
    with_packets : bool
        Also yield each compressed picture, for recording without re-encoding.
    pace : bool
        Yield a file's frames at the times they were taken, as if live.
    open_timeout_s, read_timeout_s : float
        How long a live source may take to answer, and to send the next picture.
    backoff_initial_s, backoff_max_s : float
        Wait before the first attempt to reconnect; doubled for each further one, up to the second.
    max_reconnects : int or None
        Attempts in a row before a live source is given up; None never gives up.
    wait_for_source : bool
        Treat a first connection that fails like a lost one, instead of as an error.
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
        """The address without its credentials, for messages."""
        return redact(self.url)


@dataclass(frozen=True, kw_only=True)
class StreamInfo:
    """What a source says about itself. Nothing here is a clock."""

    codec: str = ""
    width_px: int = 0
    height_px: int = 0
    rotation_deg: int = 0  # clockwise, for display; planes are as coded
    declared_rate_hz: float = 0.0  # 0 is unknown
    rate_basis: RateBasis = RateBasis.STAMPED  # where frame times come from
    time_step_s: float = 0.0  # the tick that times are rounded to (1 ms in Matroska)
    duration_s: float | None = None
    frame_count: int | None = None  # an estimate
    live: bool = False
    camera_start_ns: int = 0  # UTC of the first frame by the container; 0 is unknown
    has_b_frames: bool = False
    packets_recordable: bool = False
    packets_reason: str = ""  # why not recordable, or what a player of the recording must cope with

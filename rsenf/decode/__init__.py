"""Decodes video files and live sources to frames: luma planes with exact times.

In: a :class:`SourceSpec` (path, RTSP address or V4L2 device), or frames made by this process.
Out: a :class:`VideoSource`, which yields a ``Frame`` for each picture in presentation order, and on
request a ``VideoPacket`` for each compressed one.

Read ``spec`` and ``source`` first; then ``stream`` (packets to frames) with ``clock`` (frame
times), ``luma``, ``packets`` and ``describe``; then the sources: ``file`` (with ``structure``,
which finds truncation), ``rtsp`` and ``v4l2`` over ``live`` (reconnection) and ``pump`` (reader
thread), and ``frames``. ``coded`` decodes packets without a container; ``container`` reads a
file's metadata.
"""

from rsenf.decode.frames import from_frames
from rsenf.decode.source import Item, VideoSource, open_source
from rsenf.decode.spec import Kind, SourceSpec, StreamInfo, kind_of, redact

__all__ = [
    "Item",
    "Kind",
    "SourceSpec",
    "StreamInfo",
    "VideoSource",
    "from_frames",
    "kind_of",
    "open_source",
    "redact",
]

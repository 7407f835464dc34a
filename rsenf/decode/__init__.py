"""Decodes video files and live sources to frames: luma planes with exact times.

In: a :class:`SourceSpec` (path, RTSP address or V4L2 device), or frames made by this process.
Out: a :class:`VideoSource`, which yields a ``Frame`` for each picture in presentation order, and on
request a ``VideoPacket`` for each compressed one.

Read ``source`` first (what to open, the interface, and frames made by this process); then
``decoder`` (FFmpeg's, its effort and devices) and ``stream`` (packets to frames and their luma);
then the sources: ``file`` (also its metadata), ``rtsp`` and ``v4l2`` over ``live`` (reconnection)
and ``pump`` (reader thread). ``container`` opens a file, describes its stream and finds truncation;
``packets`` keeps compressed pictures, times frames, and decodes pictures that have no container.
"""

from rsenf.decode.source import (
    Item,
    Kind,
    SourceSpec,
    StreamInfo,
    VideoSource,
    from_frames,
    kind_of,
    open_source,
    redact,
)

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

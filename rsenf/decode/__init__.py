"""Files and live sources to frames: a luma plane and its exact time."""

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

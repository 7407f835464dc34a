"""Pictures in the messages of ROS 2, whose fields stand in the order of their definition.

https://docs.ros.org/en/rolling/p/sensor_msgs/ and https://docs.ros.org/en/rolling/p/foxglove_msgs/;
these definitions have no versions: a changed one gets a new name.
"""

from __future__ import annotations

from collections.abc import Callable

from rsenf.run.foreign.cdr import CdrReader
from rsenf.run.foreign.foxglove import coded_still, coded_video
from rsenf.run.foreign.picture import Picture, Raw


def _image(cdr: CdrReader) -> Picture:
    """Read a ``sensor_msgs/msg/Image``."""
    stamp_ns, _ = cdr.time_ns(), cdr.text()
    height_px, width_px, encoding = cdr.u32(), cdr.u32(), cdr.text()
    big_endian, step = bool(cdr.u8()), cdr.u32()
    return Raw(stamp_ns, encoding, width_px, height_px, step, big_endian, cdr.sequence())


def _compressed_image(cdr: CdrReader) -> Picture:
    """Read a ``sensor_msgs/msg/CompressedImage``."""
    stamp_ns, _, name = cdr.time_ns(), cdr.text(), cdr.text()
    return coded_still(stamp_ns, name, cdr.sequence())


def _foxglove_raw(cdr: CdrReader) -> Picture:
    stamp_ns, _ = cdr.time_ns(), cdr.text()
    width_px, height_px, encoding, step = cdr.u32(), cdr.u32(), cdr.text(), cdr.u32()
    return Raw(stamp_ns, encoding, width_px, height_px, step, False, cdr.sequence())


def _foxglove_image(cdr: CdrReader) -> Picture:
    stamp_ns, _, data = cdr.time_ns(), cdr.text(), cdr.sequence()
    return coded_still(stamp_ns, cdr.text(), data)


def _foxglove_video(cdr: CdrReader) -> Picture:
    stamp_ns, _, data = cdr.time_ns(), cdr.text(), cdr.sequence()
    return coded_video(stamp_ns, cdr.text(), data)


_MESSAGES: dict[str, Callable[[CdrReader], Picture]] = {
    "sensor_msgs/msg/Image": _image,
    "sensor_msgs/msg/CompressedImage": _compressed_image,
    "foxglove_msgs/msg/RawImage": _foxglove_raw,
    "foxglove_msgs/msg/CompressedImage": _foxglove_image,
    "foxglove_msgs/msg/CompressedVideo": _foxglove_video,
}


def reader_of(schema: str) -> Callable[[bytes], Picture] | None:
    """Return what reads the messages of a schema; None when they hold no picture."""
    read = _MESSAGES.get(schema)
    return None if read is None else lambda payload: read(CdrReader(payload))

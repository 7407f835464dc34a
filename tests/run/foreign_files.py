"""MCAP files as ROS 2 and Foxglove write them, made here from the formats' descriptions."""

from __future__ import annotations

import base64
import json
import struct
from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory, timestamp_pb2
from mcap.writer import CompressionType, Writer

SECOND_NS = 1_000_000_000
STAMP_NS = 1_790_000_000 * SECOND_NS
RATE_HZ = 30


def wall_luma(count: int, rows: int = 24, columns: int = 32) -> Iterable[tuple[int, np.ndarray]]:
    """Stamps and luma of a wall under a lamp at 50.01 Hz, read over 80 % of each frame."""
    rng = np.random.default_rng(3)
    row_s = np.arange(rows) / rows * 0.8 / RATE_HZ
    for k in range(count):
        level = 120 + 30 * np.cos(2 * np.pi * 100.02 * (k / RATE_HZ + row_s))
        noisy = level[:, None] + rng.normal(0, 3, (rows, columns))
        yield STAMP_NS + k * SECOND_NS // RATE_HZ, np.clip(noisy, 0, 255).astype(np.uint8)


class Cdr:
    """Writes CDR, in either order of bytes."""

    def __init__(self, order: str = "<") -> None:
        self.order, self.body = order, b""

    def number(self, kind: str, value: int) -> Cdr:
        size = struct.calcsize(kind)
        self.body += bytes(-len(self.body) % size) + struct.pack(self.order + kind, value)
        return self

    def text(self, text: str) -> Cdr:
        return self.sequence(text.encode() + b"\0")

    def sequence(self, data: bytes) -> Cdr:
        self.number("I", len(data)).body += data
        return self

    def stamp(self, time_ns: int) -> Cdr:
        return self.number("i", time_ns // SECOND_NS).number("I", time_ns % SECOND_NS)

    def done(self) -> bytes:
        return (b"\0\1\0\0" if self.order == "<" else b"\0\0\0\0") + self.body


def ros_image(stamp_ns, encoding, height, width, step, data, order="<", big_endian=False):
    cdr = Cdr(order).stamp(stamp_ns).text("camera").number("I", height).number("I", width)
    return cdr.text(encoding).number("B", big_endian).number("I", step).sequence(data).done()


def ros_compressed(stamp_ns, name, data, order="<"):
    return Cdr(order).stamp(stamp_ns).text("camera").text(name).sequence(data).done()


def ros_video(stamp_ns, name, data, order="<"):
    return Cdr(order).stamp(stamp_ns).text("camera").sequence(data).text(name).done()


_FIELDS = {
    "foxglove.CompressedVideo": {"timestamp": 1, "frame_id": 2, "data": 3, "format": 4},
    "foxglove.CompressedImage": {"timestamp": 1, "frame_id": 4, "data": 2, "format": 3},
    "foxglove.RawImage": {
        "timestamp": 1, "frame_id": 7, "width": 2, "height": 3, "encoding": 4, "step": 5, "data": 6,
    },
}  # fmt: skip


def foxglove_class(schema):
    kinds = descriptor_pb2.FieldDescriptorProto
    types = {"data": kinds.TYPE_BYTES} | dict.fromkeys(
        ("width", "height", "step"), kinds.TYPE_FIXED32
    )
    file = descriptor_pb2.FileDescriptorProto(
        name="a.proto", package="foxglove", syntax="proto3",
        dependency=["google/protobuf/timestamp.proto"],
    )  # fmt: skip
    message = file.message_type.add(name=schema.split(".")[1])
    for name, number in _FIELDS[schema].items():
        made = message.field.add(name=name, number=number, label=kinds.LABEL_OPTIONAL)
        made.type = types.get(name, kinds.TYPE_STRING)
        if name == "timestamp":
            made.type, made.type_name = kinds.TYPE_MESSAGE, ".google.protobuf.Timestamp"
    pool = descriptor_pool.DescriptorPool()
    pool.AddSerializedFile(timestamp_pb2.DESCRIPTOR.serialized_pb)
    pool.AddSerializedFile(file.SerializeToString())
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(schema))


def foxglove_protobuf(schema, stamp_ns, **values):
    made = foxglove_class(schema)(**values)
    made.timestamp.seconds, made.timestamp.nanos = divmod(stamp_ns, SECOND_NS)
    return made.SerializeToString()


def foxglove_json(stamp_ns, **values):
    seconds, nanos = divmod(stamp_ns, SECOND_NS)
    data = base64.b64encode(values.pop("data")).decode()
    return json.dumps(
        {"timestamp": {"sec": seconds, "nsec": nanos}, "frame_id": "", "data": data, **values}
    ).encode()


def write_mcap(path: Path, messages, compression=CompressionType.ZSTD, chunk_size=1 << 16) -> Path:
    """Write (topic, encoding, schema, payload, log time) as the plain library does."""
    with open(path, "wb") as stream:
        writer = Writer(stream, compression=compression, chunk_size=chunk_size)
        writer.start(profile="ros2", library="test")
        channels: dict[str, int] = {}
        for topic, encoding, schema, payload, log_time_ns in messages:
            if topic not in channels:
                form = "ros2msg" if encoding == "cdr" else encoding
                number = writer.register_schema(schema, form, b"")
                channels[topic] = writer.register_channel(topic, encoding, number)
            writer.add_message(channels[topic], log_time_ns, payload, log_time_ns)
        writer.finish()
    return path


def ros_wall(path: Path, count: int, order: str = "<", topic: str = "/front/image_raw") -> Path:
    """A file of raw mono8 pictures of the wall, logged with jitter after their stamps."""
    late = np.random.default_rng(1).integers(1_000_000, 20_000_000, count)

    def messages():
        for k, (stamp_ns, luma) in enumerate(wall_luma(count)):
            payload = ros_image(
                stamp_ns, "mono8", *luma.shape, luma.shape[1], luma.tobytes(), order
            )
            yield topic, "cdr", "sensor_msgs/msg/Image", payload, stamp_ns + int(late[k])

    return write_mcap(path, messages())


def h264_packets(count: int, size=(64, 48)) -> list[bytes]:
    """Annex B access units of a little film, parameter sets with every key frame."""
    context = av.CodecContext.create("libx264", "w")
    context.width, context.height = size[0], size[1]
    context.pix_fmt, context.time_base = "yuv420p", Fraction(1, RATE_HZ)
    context.gop_size, context.max_b_frames = 10, 0
    context.options = {"tune": "zerolatency", "x264-params": "repeat-headers=1:annexb=1:scenecut=0"}
    out = []
    for k, (_, luma) in enumerate(wall_luma(count, size[1], size[0])):
        frame = av.VideoFrame.from_ndarray(luma, format="gray").reformat(format="yuv420p")
        frame.pts = k
        out += [bytes(packet) for packet in context.encode(frame)]
    return out + [bytes(packet) for packet in context.encode(None)]


def still(luma: np.ndarray, ending: str) -> bytes:
    return bytes(cv2.imencode(ending, luma)[1])

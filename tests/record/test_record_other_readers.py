"""The file opens with the mcap library alone, and says itself how to decode what is in it."""

from __future__ import annotations

import numpy as np
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from google.protobuf.timestamp_pb2 import Timestamp
from mcap.reader import make_reader
from mcap.writer import CompressionType, IndexType, Writer
from record_samples import (
    NOW_NS,
    ROWS,
    VIDEO,
    Clock,
    header,
    packet,
    random_message,
    rows,
    sample_file,
)

from rsenf.errors import UsageError
from rsenf.messages import encode
from rsenf.messages.schema import field_specs, message_classes
from rsenf.record import Recorder, Topic, open_recording
from rsenf.record.index import Stretch
from rsenf.record.topics import IMAGE, descriptor_set_of
from rsenf.record.topics import VIDEO as VIDEO_SCHEMA


def embedded_class(schema):
    """Message class made from nothing but what the file carries."""
    assert schema.encoding == "protobuf"
    pool = descriptor_pool.DescriptorPool()
    for file in descriptor_pb2.FileDescriptorSet.FromString(schema.data).file:
        pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))


def read_all(path):
    with open(path, "rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        return reader.get_summary(), list(reader.iter_messages(log_time_order=False))


def assert_equal_fields(theirs, ours):
    for spec in field_specs(type(ours)):
        value, expected = getattr(theirs, spec.name), getattr(ours, spec.name)
        if spec.kind == "message":
            assert_equal_fields(value, expected)
        elif spec.kind == "array":
            np.testing.assert_array_equal(np.array(value), np.ravel(expected))
        elif spec.kind == "repeated":
            assert len(value) == len(expected)
            for one, other in zip(value, expected, strict=True):
                if hasattr(other, "VERSION"):
                    assert_equal_fields(one, other)
                else:
                    assert one == other
        else:
            assert value == expected, spec.name


def test_every_class_decodes_from_its_embedded_schema(tmp_path):
    classes = [c for c in message_classes().values() if field_specs(c)[0].name == "header"]
    messages = {
        f"rsenf/{cls.__name__}": random_message(cls, 5, header(3))
        for cls in classes
        if cls.__name__ != "Frame"
    }
    with Recorder(tmp_path / "a.mcap", run_info={}, clock_ns=Clock()) as recorder:
        for topic, message in messages.items():
            recorder.write(topic, message)
    _, found = read_all(tmp_path / "a.mcap")
    seen = set()
    for schema, channel, stored in found:
        theirs = embedded_class(schema).FromString(stored.data)
        topic = channel.topic.removesuffix("/index")
        assert channel.metadata["schema_version"] == "1"
        assert schema.name == f"rsenf.{type(messages[topic]).__name__}"
        assert_equal_fields(theirs, messages[topic])
        seen.add(topic)
    assert seen == set(messages)


def test_the_library_finds_topics_counts_and_sequence_numbers(tmp_path):
    sample_file(tmp_path / "a.mcap")
    summary, found = read_all(tmp_path / "a.mcap")
    topics = {channel.topic for channel in summary.channels.values()}
    assert topics == {ROWS, VIDEO, f"{VIDEO}/index"}
    assert summary.statistics.message_count == len(found) == 3 * 36
    assert summary.statistics.chunk_count == len(summary.chunk_indexes) > 3
    for topic in topics:
        numbers = [m.sequence for _, channel, m in found if channel.topic == topic]
        assert numbers == list(range(36))


def test_log_order_by_the_library_is_complete(tmp_path):
    sample_file(tmp_path / "a.mcap")
    with open(tmp_path / "a.mcap", "rb") as stream:
        times = [m.log_time for _, _, m in make_reader(stream).iter_messages(topics=[VIDEO])]
    assert times == sorted(times)
    assert len(times) == 36


def test_video_is_in_foxgloves_form(tmp_path):
    packets = [packet(0), packet(1, codec="hevc"), packet(2, codec="av1"), packet(3, codec="mjpeg")]
    with Recorder(tmp_path / "a.mcap", run_info={}, clock_ns=Clock()) as recorder:
        for one in packets:
            recorder.write(VIDEO, one)
    _, found = read_all(tmp_path / "a.mcap")
    pictures = [(schema, m) for schema, channel, m in found if channel.topic == VIDEO]
    assert [schema.name for schema, _ in pictures] == [VIDEO_SCHEMA] * 3 + [IMAGE]
    for (schema, stored), sent, name in zip(
        pictures, packets, ["h264", "h265", "av1", "jpeg"], strict=True
    ):
        theirs = embedded_class(schema).FromString(stored.data)
        assert (theirs.data, theirs.format, theirs.frame_id) == (sent.data, name, "site/cam")
        assert theirs.timestamp.ToNanoseconds() == stored.log_time
        assert stored.log_time == NOW_NS + sent.header.pts_ns
        assert stored.publish_time == sent.header.arrival_time_ns


@pytest.mark.parametrize(
    ("schema", "numbers"),
    [
        (VIDEO_SCHEMA, {"timestamp": 1, "frame_id": 2, "data": 3, "format": 4}),
        (IMAGE, {"timestamp": 1, "data": 2, "format": 3, "frame_id": 4}),
    ],
)
def test_foxglove_schemas_are_the_published_ones(schema, numbers):
    files = descriptor_pb2.FileDescriptorSet.FromString(descriptor_set_of(schema)).file
    assert files[0].name == "google/protobuf/timestamp.proto"
    assert files[1].name == f"{schema.replace('.', '/')}.proto"
    [message] = files[1].message_type
    assert {field.name: field.number for field in message.field} == numbers
    kinds = {field.name: field.type for field in message.field}
    assert kinds["data"] == descriptor_pb2.FieldDescriptorProto.TYPE_BYTES
    assert kinds["timestamp"] == descriptor_pb2.FieldDescriptorProto.TYPE_MESSAGE
    timestamp = files[0].message_type[0]
    assert timestamp.name == Timestamp.DESCRIPTOR.name


def test_pictures_are_not_stored_twice(tmp_path):
    with Recorder(tmp_path / "a.mcap", run_info={}, clock_ns=Clock()) as recorder:
        for seq in range(20):
            recorder.write(VIDEO, packet(seq, size=50_000))
        recorder.write(ROWS, rows(0))
    assert (tmp_path / "a.mcap").stat().st_size < 20 * 50_000 + 100_000


def test_the_companion_carries_the_exact_header(tmp_path):
    sent = packet(7, epoch=3, pts_ns=123_456_789, camera_time_ns=NOW_NS - 5)
    with Recorder(tmp_path / "a.mcap", run_info={}, clock_ns=Clock()) as recorder:
        recorder.write(VIDEO, sent)
    _, found = read_all(tmp_path / "a.mcap")
    [(schema, stored)] = [(s, m) for s, c, m in found if c.topic == f"{VIDEO}/index"]
    theirs = embedded_class(schema).FromString(stored.data)
    assert_equal_fields(theirs.header, sent.header)
    assert (theirs.data, theirs.codec, theirs.keyframe) == (b"", sent.codec, sent.keyframe)


@pytest.mark.parametrize(
    "options",
    [
        {"use_chunking": False},
        {"compression": CompressionType.LZ4},
        {"index_types": IndexType.NONE},
        {"use_summary_offsets": False, "use_statistics": False, "enable_crcs": False},
    ],
    ids=["unchunked", "lz4", "unindexed", "bare"],
)
def test_a_recording_that_another_program_rewrote(tmp_path, options):
    written = sample_file(tmp_path / "a.mcap")
    _, found = read_all(tmp_path / "a.mcap")
    with open(tmp_path / "b.mcap", "wb") as stream:
        writer = Writer(stream, **options)
        writer.start()
        channels = {}
        for schema, channel, message in found:
            if channel.id not in channels:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.id] = writer.register_channel(
                    channel.topic, channel.message_encoding, number, channel.metadata
                )
            writer.add_message(
                channels[channel.id],
                message.log_time,
                message.data,
                message.publish_time,
                message.sequence,
            )
        writer.finish()
    ours, theirs = open_recording(tmp_path / "a.mcap"), open_recording(tmp_path / "b.mcap")
    assert theirs.complete
    assert theirs.topics == ours.topics
    read = [(topic, encode(message)) for topic, message, _ in theirs.messages()]
    assert read == [(topic, encode(message)) for topic, message in written]


def test_topics_of_others_are_listed_and_left_alone(tmp_path):
    with open(tmp_path / "a.mcap", "wb") as stream:
        writer = Writer(stream)
        writer.start()
        number = writer.register_schema("weather", "jsonschema", b"{}")
        channel = writer.register_channel("sky", "json", number)
        writer.add_message(channel, 5, b"{}", 5)
        writer.finish()
    recording = open_recording(tmp_path / "a.mcap")
    assert recording.topics == {"sky": Topic("sky", "weather", 1, 5, 5, (Stretch(5, 5),))}
    assert list(recording.messages()) == []
    with pytest.raises(UsageError, match="isn't rsenf's"):
        recording.messages(["sky"])

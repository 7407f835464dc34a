"""What was recorded comes back, to the bit, whatever kind of message it was."""

from __future__ import annotations

import dataclasses

import pytest
from mcap.records import Chunk
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

from rsenf.errors import InputError, SchemaMismatch, UsageError
from rsenf.messages import Frame, Mark, RowBlock, VideoPacket, encode, header_of
from rsenf.messages.schema import field_specs, message_classes
from rsenf.record import Recorder, input_facts, open_recording
from rsenf.record.container import chunk_head, pack

TOPIC_CLASSES = [
    cls for cls in message_classes().values() if any(s.name == "header" for s in field_specs(cls))
]


def recorder_at(path, **options):
    return Recorder(path, run_info={}, clock_ns=Clock(), **options)


@pytest.mark.parametrize("compress", [True, False])
def test_every_message_class_comes_back_bit_exact(tmp_path, compress):
    written = []
    with recorder_at(tmp_path / "a.mcap", compress=compress) as recorder:
        for seq in range(4):
            for cls in TOPIC_CLASSES:
                message = random_message(cls, seed=seq, head=header(seq))
                recorder.write(f"rsenf/{cls.__name__}", message)
                written.append((f"rsenf/{cls.__name__}", message))
    read = list(open_recording(tmp_path / "a.mcap").messages())
    assert [topic for topic, _, _ in read] == [topic for topic, _ in written]
    for (_, before), (_, after, _) in zip(written, read, strict=True):
        if isinstance(before, Frame):
            before = dataclasses.replace(
                before, pixels=b"", ring="", ring_slot=0, ring_ticket=0, luma=None
            )
        assert encode(after) == encode(before)


def test_encoded_messages_are_recorded_as_they_came(tmp_path):
    messages = [rows(seq) for seq in range(5)]
    with recorder_at(tmp_path / "a.mcap") as recorder:
        for message in messages:
            assert recorder.write_encoded(ROWS, RowBlock, encode(message))
        recorder.write_encoded(VIDEO, VideoPacket, encode(packet(0)))
    read = [encode(m) for _, m, _ in open_recording(tmp_path / "a.mcap").messages()]
    assert read == [*map(encode, messages), encode(packet(0))]


@pytest.mark.parametrize("codec", ["h264", "hevc", "vp8", "vp9", "av1", "mjpeg", "new", ""])
def test_video_packets_and_marks_come_back_whole(tmp_path, codec):
    stream = [
        VideoPacket(header=header(0, mark=Mark.BEGIN), codec=codec),
        packet(1, codec=codec),
        packet(2, size=0, codec=codec),
        packet(3, codec=codec, pts_ns=2**40),
        VideoPacket(header=header(4, mark=Mark.END), codec=codec),
    ]
    with recorder_at(tmp_path / "a.mcap") as recorder:
        for message in stream:
            recorder.write(VIDEO, message)
    recording = open_recording(tmp_path / "a.mcap")
    assert [message for _, message, _ in recording.messages()] == stream
    assert list(recording.topics) == [VIDEO]
    assert recording.topics[VIDEO].messages == 5


def test_a_codec_may_change_within_a_topic(tmp_path):
    stream = [packet(0), packet(1, codec="mjpeg"), packet(2, codec="vp8"), packet(3)]
    with recorder_at(tmp_path / "a.mcap") as recorder:
        for message in stream:
            recorder.write(VIDEO, message)
    assert [m for _, m, _ in open_recording(tmp_path / "a.mcap").messages()] == stream


def test_frames_are_recorded_without_pixels(tmp_path):
    frame = Frame(header=header(0), height_px=4, width_px=5, codec="h264", pixels=b"x" * 20)
    with recorder_at(tmp_path / "a.mcap") as recorder:
        recorder.write("rsenf/site/cam/frames", frame)
    [(_, read, _)] = open_recording(tmp_path / "a.mcap").messages()
    assert (read.pixels, read.width_px, read.header) == (b"", 5, frame.header)


def test_topics_are_read_one_by_one(tmp_path):
    written = sample_file(tmp_path / "a.mcap")
    recording = open_recording(tmp_path / "a.mcap")
    only = [encode(message) for _, message, _ in recording.messages([ROWS])]
    assert only == [encode(message) for topic, message in written if topic == ROWS]
    assert recording.topics[ROWS].schema == "rsenf.RowBlock"
    assert recording.topics[ROWS].messages == 36
    with pytest.raises(UsageError, match="no topic 'nothing'"):
        recording.messages(["nothing"])


def test_topics_know_their_first_and_last_time(tmp_path):
    sample_file(tmp_path / "a.mcap")
    recording = open_recording(tmp_path / "a.mcap")
    for topic in (ROWS, VIDEO):
        times = [time_ns for _, _, time_ns in recording.messages([topic])]
        assert recording.topics[topic].first_ns == min(times)
        assert recording.topics[topic].last_ns == max(times)


def test_large_sequence_numbers_survive(tmp_path):
    with recorder_at(tmp_path / "a.mcap") as recorder:
        recorder.write(VIDEO, packet(2**40 + 7, pts_ns=0))
    [(_, read, _)] = open_recording(tmp_path / "a.mcap").messages()
    assert read.header.seq == 2**40 + 7
    assert len(read.data) == 200


def test_a_topic_keeps_to_one_class(tmp_path):
    with recorder_at(tmp_path / "a.mcap") as recorder:
        recorder.write(ROWS, rows(0))
        with pytest.raises(SchemaMismatch, match="carries RowBlock, not VideoPacket"):
            recorder.write(ROWS, packet(0))
        with pytest.raises(SchemaMismatch, match="without a header"):
            recorder.write("other", RowBlock())


def test_an_existing_file_is_not_overwritten_unless_allowed(tmp_path):
    path = tmp_path / "a.mcap"
    path.write_bytes(b"precious")
    with pytest.raises(UsageError, match="exists already"):
        recorder_at(path)
    assert path.read_bytes() == b"precious"
    recorder_at(path, overwrite=True).close()
    assert open_recording(path).complete


@pytest.mark.parametrize("place", ["missing/a.mcap", "."])
def test_an_impossible_place_is_refused(tmp_path, place):
    with pytest.raises(UsageError):
        recorder_at(tmp_path / place, overwrite=True)


@pytest.mark.parametrize("content", [b"", b"a text file that says so", b"\x89MCAP"])
def test_what_is_no_recording_is_refused(tmp_path, content):
    path = tmp_path / "a.mcap"
    path.write_bytes(content)
    with pytest.raises(InputError) as caught:
        open_recording(path)
    assert "\n" not in str(caught.value)


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(UsageError, match="no such file"):
        open_recording(tmp_path / "none.mcap")


def test_bytes_that_are_no_message_raise_or_are_counted(tmp_path):
    good = rows(0)
    with recorder_at(tmp_path / "a.mcap") as recorder:
        recorder.write(ROWS, good)
        recorder.write_encoded(ROWS, RowBlock, b"\xff\xff\xff not a message", header(1))
        recorder.write(ROWS, rows(2))
    recording = open_recording(tmp_path / "a.mcap")
    with pytest.raises(SchemaMismatch, match=ROWS):
        list(recording.messages())
    read = [m.header.seq for _, m, _ in recording.messages(tolerant=True)]
    assert (read, recording.loss.rejected) == ([0, 2], 1)


def test_another_schema_version_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr(RowBlock, "VERSION", 99)
    with recorder_at(tmp_path / "a.mcap") as recorder:
        recorder.write(ROWS, rows(0))
    monkeypatch.undo()
    with pytest.raises(SchemaMismatch, match="version 99, this program reads 1") as caught:
        list(open_recording(tmp_path / "a.mcap").messages())
    assert "made by rsenf" in caught.value.hint


def test_header_of_reads_what_decoding_would(tmp_path):
    for seq, cls in enumerate(TOPIC_CLASSES):
        message = random_message(cls, seq, header(seq, source="s" * (seq * 40)))
        assert header_of(encode(message)) == message.header


@pytest.mark.parametrize("payload", [b"", b"\x0a", b"\x0a\x05abc", b"\x12\x00", b"\x0a\xff\xff"])
def test_header_of_refuses_anything_else(payload):
    with pytest.raises(SchemaMismatch):
        header_of(payload)


def test_metadata(tmp_path):
    clock = Clock()
    info = {"run_id": "r1", "config": "graph: demo\n", "input": "clip.mp4"}
    with Recorder(tmp_path / "a.mcap", run_info=info, clock_ns=clock) as recorder:
        recorder.write(ROWS, rows(0))
        recorder.add_metadata("rsenf.input", {"input_sha256": "ab" * 32, "input_bytes": 17})
        recorder.write(ROWS, rows(3))
        recorder.write(ROWS, rows(3))
        recorder.add_metadata("rsenf.input", {"more": "later"})
    found = open_recording(tmp_path / "a.mcap").metadata
    assert found["rsenf"].items() >= info.items()
    assert found["rsenf"]["created_utc"].startswith("2026-09-21T")
    assert found["rsenf"]["schema RowBlock"] == "1"
    assert {"python", "host", "platform", "library numpy"} <= found["rsenf"].keys()
    assert found["rsenf.input"] == {
        "input_sha256": "ab" * 32,
        "input_bytes": "17",
        "more": "later",
    }
    closing = found["rsenf.closing"]
    assert closing["reason"] == "closed"
    assert closing[f"messages {ROWS}"] == "2"
    assert closing[f"missed {ROWS}"] == "2"
    assert closing[f"duplicates {ROWS}"] == "1"


def test_log_time_in_the_file_is_the_time_line(tmp_path):
    with recorder_at(tmp_path / "a.mcap") as recorder:
        for seq in range(3):
            recorder.write(ROWS, rows(seq))
    times = [time_ns for _, _, time_ns in open_recording(tmp_path / "a.mcap").messages()]
    assert times == [NOW_NS, NOW_NS + 40_000_000, NOW_NS + 80_000_000]


def test_input_facts(tmp_path):
    path = tmp_path / "clip.mp4"
    path.write_bytes(b"abc")
    assert input_facts(path) == {
        "input": "clip.mp4",
        "input_sha256": "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad",
        "input_bytes": "3",
    }
    with pytest.raises(InputError, match=r"none\.mp4: no such file"):
        input_facts(tmp_path / "none.mp4")


@pytest.mark.parametrize("compression", ["", "zstd"])
def test_the_head_of_a_chunk_is_what_the_library_writes(compression):
    chunk = Chunk(
        compression=compression,
        data=bytes(range(200)),
        message_start_time=2**40,
        message_end_time=2**41,
        uncompressed_crc=2**31,
        uncompressed_size=300,
    )
    assert chunk_head(chunk) + chunk.data == pack(chunk)

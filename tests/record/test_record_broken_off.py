"""A recording that breaks off keeps all but its last moment."""

from __future__ import annotations

import contextlib
import itertools
import signal
import struct
import subprocess
import sys
from pathlib import Path

import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from record_samples import ROWS, VIDEO, Clock, packet, rows, sample_file

from rsenf.errors import InputError, RsenfError
from rsenf.messages import encode
from rsenf.record import Recorder, close_truncated, open_recording, output
from rsenf.record.container import MAGIC
from rsenf.record.index import BARE_TAIL
from rsenf.record.scan import scan
from rsenf.record.summary import read_contents


def encoded(messages):
    return [(topic, encode(message)) for topic, message, *_ in messages]


@pytest.fixture(scope="module")
def sample(tmp_path_factory):
    """Bytes of a small recording with several chunks, and what was written to it."""
    path = tmp_path_factory.mktemp("sample") / "a.mcap"
    written = sample_file(path, seconds=2)
    return path.read_bytes(), encoded(written)


def read_tolerantly(path):
    recording = open_recording(path)
    return recording, encoded(recording.messages(tolerant=True))


def test_flushed_by_the_clock_from_write_and_tick(tmp_path):
    clock = Clock()
    with Recorder(tmp_path / "a.mcap", run_info={}, clock_ns=clock) as recorder:

        def readable():
            return len(list(open_recording(tmp_path / "a.mcap").messages()))

        recorder.write(ROWS, rows(0))
        clock.advance(0.4)
        recorder.tick()
        assert readable() == 0
        clock.advance(0.1)
        recorder.tick()
        assert readable() == 1
        recorder.write(ROWS, rows(1))
        clock.advance(0.6)
        recorder.write(ROWS, rows(2))
        assert readable() == 3
        clock.advance(-3600)  # somebody set the clock back
        recorder.write(ROWS, rows(3))
        assert readable() == 4
        recorder.write(ROWS, rows(4))
        assert readable() == 4
        recorder.flush()
        assert readable() == 5


def test_chunks_are_limited_in_size(tmp_path):
    with Recorder(tmp_path / "a.mcap", run_info={}, clock_ns=Clock()) as recorder:
        for seq in range(30):
            recorder.write(VIDEO, packet(seq, size=150_000))
    with open(tmp_path / "a.mcap", "rb") as stream:
        chunks = make_reader(stream).get_summary().chunk_indexes
    assert len(chunks) == 5
    assert max(chunk.uncompressed_size for chunk in chunks) < 2**20 + 160_000


class InterruptedFile:
    """A file whose third write is interrupted halfway, as by Ctrl-C."""

    def __init__(self, file):
        self._file, self._writes = file, itertools.count()

    def __getattr__(self, name):
        return getattr(self._file, name)

    def write(self, data):
        if next(self._writes) == 2:
            self._file.write(data[: len(data) // 2])
            raise KeyboardInterrupt
        return self._file.write(data)


def test_an_interrupted_write_leaves_nothing_half_written(tmp_path, monkeypatch):
    path, open_new = tmp_path / "a.mcap", output.open_new
    monkeypatch.setattr(output, "open_new", lambda *given: InterruptedFile(open_new(*given)))
    messages = [packet(seq, size=3000) for seq in range(40)]
    with (
        pytest.raises(KeyboardInterrupt),
        Recorder(path, run_info={}, clock_ns=Clock()) as recorder,
    ):
        record_and_flush(recorder, messages)
    recording = open_recording(path)
    assert recording.complete
    assert [message for _, message, _ in recording.messages()] == messages
    with open(path, "rb") as stream:
        assert len(list(make_reader(stream, validate_crcs=True).iter_messages())) == 80


def record_and_flush(recorder, messages):
    for message in messages:
        recorder.write(VIDEO, message)
        if message.header.seq % 20 == 19:
            recorder.flush()


WRITE_AND_WAIT = """
import sys, time
sys.path.insert(0, {folder!r})
from record_samples import ROWS, rows, Clock
from rsenf.record import Recorder

clock = Clock()
recorder = Recorder({path!r}, run_info={{}}, clock_ns=clock)
for number in range(40):
    recorder.write(ROWS, rows(number))
    clock.advance(0.04)
recorder.flush()
recorder.write(ROWS, rows(40))
print("written", flush=True)
sys.stdin.read()
"""


def test_kill_costs_at_most_what_came_after_the_last_flush(tmp_path):
    path = tmp_path / "a.mcap"
    script = WRITE_AND_WAIT.format(folder=str(Path(__file__).parent), path=str(path))
    with subprocess.Popen(
        [sys.executable, "-c", script], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout.readline() == "written\n"
        process.kill()
        assert process.wait() == -signal.SIGKILL
    recording = open_recording(path)
    assert not recording.complete
    assert [m.header.seq for _, m, _ in recording.messages()] == list(range(40))
    assert recording.metadata["rsenf"]["python"]
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.mcap"]  # nothing left beside it


def test_every_truncation_yields_a_prefix(tmp_path, sample):
    whole, written = sample
    path = tmp_path / "a.mcap"
    longest = 0
    for size in itertools.chain(range(len(MAGIC), len(whole), 97), [len(whole) - 1, len(whole)]):
        path.write_bytes(whole[:size])
        recording, read = read_tolerantly(path)
        assert read == written[: len(read)], size
        assert recording.complete == (size == len(whole))
        assert sum(topic.messages for topic in recording.topics.values()) == len(read)
        assert len(read) >= longest
        assert bool(recording.loss) == (recording.loss.cut_bytes > 0)
        longest = len(read)
    assert longest == len(written)


def test_truncated_within_the_first_bytes(tmp_path, sample):
    path = tmp_path / "a.mcap"
    for size in range(len(MAGIC)):
        path.write_bytes(sample[0][:size])
        with pytest.raises(InputError):
            open_recording(path)


def test_a_truncated_file_can_be_finished_anywhere(tmp_path, sample):
    whole, written = sample
    path = tmp_path / "a.mcap"
    for size in range(len(MAGIC), len(whole), 211):
        path.write_bytes(whole[:size])
        _, before = read_tolerantly(path)
        finished = close_truncated(path, "note", lambda index: {"messages": str(index.messages)})
        recording, after = read_tolerantly(path)
        assert recording.complete
        assert after == before == written[: len(before)]
        assert finished.size_bytes == path.stat().st_size
        assert finished.messages == len(after)
        with open(path, "rb") as stream:
            stored = len(list(make_reader(stream, validate_crcs=True).iter_messages()))
        assert int(recording.metadata["note"]["messages"]) == stored
        content = path.read_bytes()
        assert close_truncated(path) == (finished.messages, len(content), 0)
        assert path.read_bytes() == content


def test_a_chunk_cut_off_its_message_indexes_is_indexed_again(tmp_path, sample):
    whole, _ = sample
    path = tmp_path / "a.mcap"
    path.write_bytes(whole)
    with open(path, "rb") as stream:
        chunk = make_reader(stream).get_summary().chunk_indexes[-1]
    end = chunk.chunk_start_offset + chunk.chunk_length
    path.write_bytes(whole[: end + chunk.message_index_length // 2])
    close_truncated(path)
    with open(path, "rb") as stream:
        again = make_reader(stream).get_summary().chunk_indexes[-1]
    assert again == chunk
    assert path.read_bytes()[:end] == whole[:end]
    index = slice(end, end + chunk.message_index_length)
    assert path.read_bytes()[index] == whole[index]


def test_zeros_after_a_power_cut_are_no_records(tmp_path, sample):
    whole, written = sample
    path = tmp_path / "a.mcap"
    path.write_bytes(whole[:-200] + bytes(5000))
    recording, read = read_tolerantly(path)
    assert read == written
    assert not recording.complete


def test_a_file_without_a_summary_is_complete(tmp_path, sample):
    whole, written = sample
    path = tmp_path / "a.mcap"
    path.write_bytes(whole[:-300])
    with open(path, "rb") as stream:
        end = scan(stream, path.stat().st_size).end
    path.write_bytes(whole[:end] + BARE_TAIL)
    recording, read = read_tolerantly(path)
    assert recording.complete
    assert read == written
    with open(path, "rb") as stream:
        assert len(list(make_reader(stream).iter_messages(topics=[ROWS]))) == 24


def test_summary_and_scan_agree(tmp_path, sample):
    path = tmp_path / "a.mcap"
    path.write_bytes(sample[0])
    with open(path, "rb") as stream:
        short, long = (f(stream, len(sample[0])) for f in (read_contents, scan))
    assert short.metadata == long.metadata
    assert short.index.extents == long.index.extents
    assert short.index.channels == long.index.channels
    assert short.index.schemas == long.index.schemas
    assert short.index.metadata == long.index.metadata
    assert short.complete


def test_a_damaged_chunk_raises_or_is_counted(tmp_path, sample):
    whole, written = sample
    path = tmp_path / "a.mcap"
    path.write_bytes(whole)
    with open(path, "rb") as stream:
        chunk = make_reader(stream).get_summary().chunk_indexes[1]
    at = chunk.chunk_start_offset + chunk.chunk_length // 2
    path.write_bytes(whole[:at] + bytes([whole[at] ^ 0xFF]) + whole[at + 1 :])
    recording = open_recording(path)
    with pytest.raises(InputError, match="damaged"):
        list(recording.messages())
    read = encoded(recording.messages(tolerant=True))
    assert recording.loss.damaged == 1
    lost = len(written) - len(read)
    assert 0 < lost < len(written)
    start = next(i for i, (a, b) in enumerate(zip(read, written, strict=False)) if a != b)
    assert read == written[:start] + written[start + lost :]


def read_or_refuse(path, content):
    path.write_bytes(content)
    with contextlib.suppress(RsenfError):
        recording = open_recording(path)
        list(recording.messages(tolerant=True))
        list(recording.messages())


def chunk_record(claimed_size, compression, data, length=None):
    body = struct.pack("<QQQI", 0, 0, claimed_size, 0)
    body += struct.pack("<I", len(compression)) + compression
    body += struct.pack("<Q", len(data) if length is None else length) + data
    return MAGIC + struct.pack("<BQ", 6, len(body)) + body


@pytest.mark.parametrize(
    "content",
    [
        chunk_record(5, b"", b"12345", length=2**63),
        chunk_record(2**62, b"zstd", zstandard.compress(b"12345")),
        chunk_record(5, b"zstd", zstandard.compress(bytes(10**7))),
        chunk_record(5, b"zstd", b"no such"),
        chunk_record(5, b"lz4", b"no such"),
        chunk_record(5, b"rar", b"12345"),
        chunk_record(5, b"\xff", b"12345"),
        chunk_record(4, b"", b"12345"),
    ],
    ids=range(8),
)
def test_chunks_that_lie_are_refused(tmp_path, content):
    path = tmp_path / "a.mcap"
    path.write_bytes(content)
    recording = open_recording(path)
    assert list(recording.messages(tolerant=True)) == []
    assert recording.loss.damaged == 1
    with pytest.raises(InputError, match="damaged"):
        list(recording.messages())


@settings(max_examples=60, deadline=None)
@given(content=st.binary(max_size=400), framed=st.booleans())
def test_random_bytes_never_crash_the_reader(tmp_path_factory, content, framed):
    path = tmp_path_factory.getbasetemp() / "random.mcap"
    read_or_refuse(path, MAGIC + content + MAGIC if framed else content)


@settings(max_examples=150, deadline=None)
@given(data=st.data())
def test_changed_bytes_never_crash_the_reader(tmp_path_factory, sample, data):
    content = bytearray(sample[0])
    places = st.integers(0, len(content) - 1) | st.integers(0, 400) | st.integers(-600, -1)
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(places)] = data.draw(st.integers(0, 255))
    read_or_refuse(tmp_path_factory.getbasetemp() / "changed.mcap", bytes(content))


def test_a_recording_that_is_being_made_is_not_replaced(tmp_path):
    path = tmp_path / "a.mcap"
    with Recorder(path, run_info={}, clock_ns=Clock()) as recorder:
        recorder.write(ROWS, rows(0))
        with pytest.raises(RsenfError, match="being written"):
            Recorder(path, run_info={}, clock_ns=Clock(), overwrite=True)
        recorder.write(ROWS, rows(1))
    assert open_recording(path).topics[ROWS].messages == 2

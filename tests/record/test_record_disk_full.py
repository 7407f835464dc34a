"""A full disk ends a recording with one line and a closed file that holds all that was flushed."""

from __future__ import annotations

import contextlib
import errno
import itertools
import os
import resource
import subprocess
import sys
from pathlib import Path

import pytest
from mcap.reader import make_reader
from record_samples import ROWS, VIDEO, Clock, packet, rows

from rsenf.errors import RecordingError
from rsenf.record import Recorder, close_truncated, growing, open_recording, output
from rsenf.record.index import BARE_TAIL


class LimitedFile:
    """A file that takes so many bytes, and of the write that exceeds them only a part."""

    def __init__(self, file, limit, code=errno.ENOSPC):
        self._file, self._limit, self._code = file, limit, code

    def __getattr__(self, name):
        return getattr(self._file, name)

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self._file.close()

    def write(self, data):
        room = self._limit - self._file.tell()
        if room <= 0:
            raise OSError(self._code, os.strerror(self._code))
        return self._file.write(data[:room])


def record_until_full(path):
    """Record until it fails; return how many messages were flushed before, and the error."""
    recorder, flushed = Recorder(path, run_info={"run_id": "r"}, clock_ns=Clock()), [0]
    with pytest.raises(RecordingError) as caught, recorder:
        record_forever(recorder, flushed)
    with pytest.raises(RecordingError) as again:
        recorder.write(ROWS, rows(0))
    assert again.value is caught.value
    recorder.close()
    return flushed[-1], caught.value


def record_forever(recorder, flushed):
    for number in itertools.count():
        recorder.write(VIDEO, packet(number, size=20_000))
        recorder.write(ROWS, rows(number))
        if number % 5 == 4:
            recorder.flush()
            flushed.append(2 * (number + 1))


def assert_safe(path, flushed, error, reason):
    recording = open_recording(path)
    assert recording.complete
    assert not recording.loss
    numbers = {ROWS: [], VIDEO: []}
    for topic, message, _ in recording.messages():
        numbers[topic].append(message.header.seq)
    assert sum(map(len, numbers.values())) >= flushed > 0
    for found in numbers.values():
        assert found == list(range(len(found)))
    with open(path, "rb") as stream:
        stored = len(list(make_reader(stream, validate_crcs=True).iter_messages()))
    safe = sum(map(len, numbers.values()))
    assert stored == safe + len(numbers[VIDEO])  # pictures and their companions
    text = str(error)
    assert "\n" not in text
    assert str(path) in text
    assert reason in text
    assert f"{safe} messages, {path.stat().st_size / 1e6:.1f} MB, are safe in it" in text
    assert error.hint
    return recording


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EFBIG, errno.EDQUOT, errno.EIO])
def test_a_write_that_fails(tmp_path, monkeypatch, code):
    path, open_new = tmp_path / "a.mcap", output.open_new
    monkeypatch.setattr(
        output, "open_new", lambda *given: LimitedFile(open_new(*given), 555_555, code)
    )
    flushed, error = record_until_full(path)
    recording = assert_safe(path, flushed, error, os.strerror(code).lower())
    closing = recording.metadata["rsenf.closing"]
    assert closing["reason"] == os.strerror(code).lower()
    assert int(closing[f"messages {ROWS}"]) == recording.topics[ROWS].messages
    assert recording.metadata["rsenf"]["run_id"] == "r"


def test_a_disk_that_fails_on_the_way(tmp_path, monkeypatch):
    """Only what an earlier flush had brought onto the disk counts as safe."""
    path, fsync, calls = tmp_path / "a.mcap", os.fsync, iter(range(10_000))

    def failing(number):
        if next(calls) == 12:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        fsync(number)

    monkeypatch.setattr(output.os, "fsync", failing)
    flushed, error = record_until_full(path)
    assert_safe(path, flushed, error, "no space left")


def test_no_room_to_begin_with_leaves_no_file(tmp_path, monkeypatch):
    for opener in ("open_new", "open_nameless"):
        with monkeypatch.context() as patch:
            real = getattr(output, opener)
            patch.setattr(output, opener, lambda *given, real=real: LimitedFile(real(*given), 100))
            with pytest.raises(RecordingError, match="can't record there, no space left"):
                Recorder(tmp_path / "a.mcap", run_info={}, clock_ns=Clock())
        assert list(tmp_path.iterdir()) == []


def test_no_room_for_the_end(tmp_path, monkeypatch):
    """The index gives way first, then the last chunk; what is left is a valid file."""
    whole = tmp_path / "whole.mcap"
    with Recorder(whole, run_info={}, clock_ns=Clock()) as recorder:
        for number in range(12):
            recorder.write(ROWS, rows(number))
            recorder.flush()
    content = whole.read_bytes()
    with open(whole, "rb") as stream:
        last = make_reader(stream).get_summary().chunk_indexes[-1]
    end = last.chunk_start_offset + last.chunk_length + last.message_index_length
    path = tmp_path / "a.mcap"
    for room, messages in ((len(BARE_TAIL), 12), (len(BARE_TAIL) - 1, 11)):
        path.write_bytes(content[: end + 7])
        with monkeypatch.context() as patch:
            patch.setattr(
                growing,
                "open_existing",
                lambda given, room=room: LimitedFile(output.open_existing(given), end + room),
            )
            assert close_truncated(path).messages == messages
        recording = open_recording(path)
        assert recording.complete
        assert [m.header.seq for _, m, _ in recording.messages()] == list(range(messages))


LIMITED = """
import resource, sys
sys.path.insert(0, {folder!r})
resource.setrlimit(resource.RLIMIT_FSIZE, ({limit}, {limit}))
from pathlib import Path
from test_record_disk_full import record_until_full
flushed, error = record_until_full(Path({path!r}))
print(flushed)
print(error)
"""


def test_a_limit_on_the_size_of_files(tmp_path):
    path, limit = tmp_path / "a.mcap", 1_500_000
    if resource.getrlimit(resource.RLIMIT_FSIZE)[1] not in (resource.RLIM_INFINITY, limit):
        pytest.skip("the size of files is limited already")
    folder = str(Path(__file__).parent)
    script = LIMITED.format(folder=folder, path=str(path), limit=limit)
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    flushed, text = done.stdout.splitlines()
    assert "file too large" in text
    assert limit - 150_000 < path.stat().st_size <= limit
    recording = open_recording(path)
    assert recording.complete
    read = [(topic, m.header.seq) for topic, m, _ in recording.messages()]
    assert len(read) >= int(flushed)
    assert [seq for topic, seq in read if topic == VIDEO] == list(range(len(read) // 2))


@pytest.fixture
def small_disk(tmp_path):
    """A disk of 4 MB, all of it ours."""
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=4m", "tmpfs", str(tmp_path)], capture_output=True
    )
    if mounted.returncode:
        pytest.skip("may not mount a small disk here")
    yield tmp_path
    subprocess.run(["umount", str(tmp_path)], check=True)


def fill(path):
    with open(path, "wb", buffering=0) as others, contextlib.suppress(OSError):
        while True:
            others.write(bytes(4096))


@pytest.mark.external
def test_a_disk_that_is_really_full(small_disk):
    path = small_disk / "a.mcap"
    flushed, error = record_until_full(path)
    recording = assert_safe(path, flushed, error, "no space left on device")
    assert path.stat().st_size > 2_000_000
    assert "rsenf.closing" in recording.metadata
    with open(path, "rb") as stream:
        assert make_reader(stream).get_summary().chunk_indexes  # there was room for the index
    assert [entry.name for entry in small_disk.iterdir()] == ["a.mcap"]


@pytest.mark.external
def test_a_disk_that_others_fill_to_the_last_byte(small_disk):
    path = small_disk / "a.mcap"
    recorder = Recorder(path, run_info={}, clock_ns=Clock())
    for number in range(30):
        recorder.write(VIDEO, packet(number, size=20_000))
        recorder.flush()
    fill(small_disk / "others")
    recorder.write(VIDEO, packet(30, size=20_000))
    with pytest.raises(RecordingError, match="no space left"):
        recorder.close()
    recording = open_recording(path)
    assert recording.complete
    assert recording.metadata["rsenf.closing"]
    assert [m.header.seq for _, m, _ in recording.messages()] == list(range(30))

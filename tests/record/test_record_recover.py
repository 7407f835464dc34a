"""What is whole in a damaged recording is saved; what was lost is said; nothing else changes."""

from __future__ import annotations

import os
import tracemalloc

import pytest
from mcap.reader import make_reader
from mcap.writer import Writer
from record_samples import ROWS, VIDEO, Clock, packet, rows, sample_file

from rsenf.cli.doctor import lost_words
from rsenf.errors import InputError, UsageError
from rsenf.messages import encode
from rsenf.record import Recorder, open_recording, output
from rsenf.record.container import HEAD, MAGIC
from rsenf.record.examine import RECOVERED, examine
from rsenf.record.recover import recover, recover_in_place


def encoded(path, **how):
    return [(topic, encode(message)) for topic, message, _ in open_recording(path).messages(**how)]


def numbers(path):
    return [(topic, message.header.seq) for topic, message, _ in open_recording(path).messages()]


def chunks_of(path):
    with open(path, "rb") as stream:
        return [
            (c.chunk_start_offset, c.chunk_length)
            for c in make_reader(stream).get_summary().chunk_indexes
        ]


def spoil(path, at):
    content = bytearray(path.read_bytes())
    content[at] ^= 0xFF
    path.write_bytes(content)


@pytest.fixture
def recorded(tmp_path):
    path = tmp_path / "a.mcap"
    written = [(topic, encode(message)) for topic, message in sample_file(path)]
    return path, written, chunks_of(path)


@pytest.mark.parametrize("place", [0, 2, -1])
def test_damage_costs_only_its_chunk(recorded, tmp_path, place):
    path, written, chunks = recorded
    start, length = chunks[place]
    spoil(path, start + length // 2)
    damaged = path.read_bytes()
    found = recover(path, tmp_path / "new.mcap")
    saved = encoded(tmp_path / "new.mcap")
    assert saved == encoded(path, tolerant=True)
    assert len(saved) >= len(written) - 30
    lost = {
        state.topic.name: sum(gap.messages for gap in state.gaps) + state.lost_at_end
        for state in found.topics
    }
    for topic in (ROWS, VIDEO):
        gone = sum(t == topic for t, _ in written) - sum(t == topic for t, _ in saved)
        assert lost[topic] == gone > 0
    assert path.read_bytes() == damaged
    again = examine(tmp_path / "new.mcap")
    assert again.whole
    assert f"lost {ROWS}" in again.contents.metadata[RECOVERED]
    assert again.contents.metadata["rsenf"] == found.contents.metadata["rsenf"]


def test_an_end_that_is_damaged_from_the_last_chunk_on_is_said(recorded, tmp_path):
    path, written, chunks = recorded
    content = bytearray(path.read_bytes())
    start, _ = chunks[-1]
    footer = len(content) - 40
    content[start:footer] = bytes(footer - start)  # with all that tells how much there was
    path.write_bytes(content)
    found = recover(path, tmp_path / "new.mcap")
    assert found.contents.complete
    saved = [seq for topic, seq in numbers(tmp_path / "new.mcap") if topic == ROWS]
    assert len(saved) < sum(topic == ROWS for topic, _ in written)
    assert lost_words(found)[ROWS] == f"what came after {saved[-1]} is not there"
    notes = open_recording(tmp_path / "new.mcap").metadata[RECOVERED]
    assert notes[f"lost {ROWS}"] == f"what came after {saved[-1]}"


def test_a_recovered_file_that_is_damaged_again(recorded, tmp_path):
    path, _, chunks = recorded
    spoil(path, chunks[0][0] + 99)
    recover(path, tmp_path / "new.mcap")
    spoil(tmp_path / "new.mcap", chunks_of(tmp_path / "new.mcap")[-1][0] + 99)
    assert "what came after" in lost_words(examine(tmp_path / "new.mcap"))[ROWS]


def test_chunks_go_back_to_their_places(recorded, tmp_path):
    path, written, chunks = recorded
    content = path.read_bytes()
    (a, b), (c, d) = chunks[1], chunks[3]
    e = c + d
    path.write_bytes(
        content[:a] + content[c:e] + content[a + b : c] + content[a : a + b] + content[e:]
    )
    assert not examine(path).whole
    assert bool(open_recording(path).loss)
    recover(path, tmp_path / "new.mcap")
    assert encoded(tmp_path / "new.mcap") == written


def test_the_chunk_that_defines_all_is_lost_and_there_is_no_end(recorded, tmp_path):
    path, written, chunks = recorded
    path.write_bytes(path.read_bytes()[: sum(chunks[-1])])
    spoil(path, chunks[0][0] + 2000)
    recover(path, tmp_path / "new.mcap")
    saved = encoded(tmp_path / "new.mcap")
    assert saved == written[-len(saved) :]
    assert len(saved) > len(written) / 2


def test_what_is_being_recorded_is_left_in_its_place(tmp_path):
    path = tmp_path / "a.mcap"
    with Recorder(path, run_info={}, clock_ns=Clock()) as recorder:
        recorder.write(ROWS, rows(0))
        recorder.flush()
        with pytest.raises(UsageError, match="is being recorded"):
            recover_in_place(path)
        assert [p.name for p in tmp_path.iterdir()] == ["a.mcap"]
        recover(path, tmp_path / "so_far.mcap")
    assert len(encoded(tmp_path / "so_far.mcap")) == 1
    assert len(encoded(path)) == 1


def test_in_place_keeps_the_damaged_file(recorded):
    path, _, chunks = recorded
    spoil(path, chunks[1][0] + 60)
    damaged = path.read_bytes()
    _, backup = recover_in_place(path)
    assert backup.read_bytes() == damaged
    assert examine(path).whole
    with pytest.raises(UsageError, match="backup already"):
        recover_in_place(path)
    assert {entry.name for entry in path.parent.iterdir()} == {path.name, backup.name}


def test_a_power_cut_costs_what_came_after_the_last_flush(tmp_path, monkeypatch):
    """Blocks that were written and not waited for may come back as zeros."""
    path, synced, clock = tmp_path / "a.mcap", [], Clock()

    def fsync(number):
        synced.append((os.fstat(number).st_size, clock.now_ns))

    monkeypatch.setattr(output.os, "fsync", fsync)
    recorder = Recorder(path, run_info={}, clock_ns=clock)
    for seq in range(100):
        for topic, message in ((VIDEO, packet(seq, size=150_000)), (ROWS, rows(seq))):
            recorder.write(topic, message)
        size, at_ns = synced[-1]
        assert clock.now_ns - at_ns < 0.54e9  # by default, and with nothing else said
        clock.advance(0.04)
    monkeypatch.undo()
    content = path.read_bytes()
    assert size < len(content)
    path.write_bytes(content[:size] + bytes(len(content) - size))
    recover(path, tmp_path / "new.mcap")
    numbers = [m.header.seq for _, m, _ in open_recording(tmp_path / "new.mcap").messages([ROWS])]
    assert numbers == list(range(len(numbers)))
    assert len(numbers) >= 100 - 0.54 * 25


def test_a_recording_whose_first_bytes_are_damaged_is_still_ours(recorded, tmp_path):
    path, messages, _ = recorded
    content = bytearray(path.read_bytes())
    name = content.index(b"rsenf ")
    content[name + 4] ^= 1
    path.write_bytes(content)
    recover(path, tmp_path / "new.mcap")
    assert len(list(open_recording(tmp_path / "new.mcap").messages())) == len(messages)
    assert open_recording(tmp_path / "new.mcap").complete


def test_what_can_not_be_recovered(recorded, tmp_path):
    path, _, chunks = recorded
    with pytest.raises(UsageError, match="exists already"):
        recover(path, path, overwrite=True)
    path.write_bytes(path.read_bytes()[: chunks[0][0] + 50])
    with pytest.raises(InputError, match="no whole message"):
        recover(path, tmp_path / "new.mcap")
    other = tmp_path / "other.mcap"
    with open(other, "wb") as stream:
        writer = Writer(stream)
        writer.start(library="somebody")
        writer.finish()
    with pytest.raises(InputError, match="made by somebody"):
        recover(other, tmp_path / "new.mcap")
    assert not (tmp_path / "new.mcap").exists()


@pytest.mark.parametrize("opcode", [5, 6, 9, 12, 0x90])
def test_a_record_that_claims_a_million_gigabytes(recorded, tmp_path, opcode):
    path, _, chunks = recorded
    content = path.read_bytes()
    start = chunks[1][0]
    path.write_bytes(content[:start] + HEAD.pack(opcode, 10**15) + content[start + HEAD.size :])
    tracemalloc.start()
    try:
        recover(path, tmp_path / "new.mcap")
        assert tracemalloc.get_traced_memory()[1] < 20e6
    finally:
        tracemalloc.stop()
    assert len(chunks_of(tmp_path / "new.mcap")) == len(chunks) - 1


def test_nothing_but_a_beginning(tmp_path):
    path = tmp_path / "a.mcap"
    path.write_bytes(MAGIC)
    assert examine(path).messages == 0
    with pytest.raises(InputError):
        recover(path, tmp_path / "new.mcap")

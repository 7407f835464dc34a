"""The minutes about an alarm: from memory when nothing else is written, and never deleted."""

from __future__ import annotations

import fcntl
import json
import os
import threading
from pathlib import Path

import pytest
from archive_samples import CAM1, CAM2, archive, at, files, film, numbers, put, written_at
from record_samples import NOW_NS, SECOND_NS, Clock, header, packet, rows

from rsenf.messages import Alarm, encode
from rsenf.record import open_recording
from rsenf.record.archive.alarms import AlarmLog, AlarmSpan, add_alarm, alarms_of
from rsenf.record.archive.camera_files import Kept, Ring
from rsenf.record.archive.layout import Camera, archived_files
from rsenf.record.archive.writer import Keeper
from rsenf.record.limits import AlarmSettings, Retention, Rotation, Usage
from rsenf.record.output import hold, is_held

VIDEO, ROWS, ALARM = f"{CAM1}/video", f"{CAM1}/rows", f"{CAM1}/alarm"
ONLY = AlarmSettings(before_s=2.0, after_s=1.0, only=True)
DAY_NS = 86_400 * SECOND_NS
LAB = Camera("lab", "cam1")


def test_the_ring_is_written_when_an_alarm_comes(tmp_path):
    clock = Clock()
    with archive(tmp_path, clock, alarms=ONLY) as recorder:
        film(recorder, clock, range(205), (CAM1, CAM2))
        assert files(tmp_path) == []
        recorder.alarm(ALARM, "test")
        film(recorder, clock, range(205, 300), (CAM1, CAM2))
        (path,) = files(tmp_path)
        assert open_recording(path).complete  # already closed, a second after the alarm
    assert path.parent.parent.name == "cam1"
    assert path.name.endswith("Z.alarm.mcap")
    # Two seconds before are 50 frames, from the key frame on; one second after is 25.
    for topic in (VIDEO, ROWS):
        assert numbers(path, topic) == list(range(150, 231))
    messages = list(open_recording(path).messages([VIDEO]))
    assert messages[0][1].keyframe
    assert [t - NOW_NS for _, _, t in messages] == [at(k)["pts_ns"] for k in range(150, 231)]
    (file,) = archived_files(tmp_path)
    assert file.of_alarm


def test_alarms_that_go_on_are_one_file_until_it_is_full(tmp_path):
    clock = Clock()
    with archive(tmp_path, clock, alarms=ONLY, rotation=Rotation(every_s=4.0)) as recorder:
        for begin in range(0, 250, 10):
            film(recorder, clock, range(begin, begin + 10))
            if begin >= 100:
                recorder.alarm(ALARM, "again")
        film(recorder, clock, range(250, 400))
        recorder.alarm(None, "a new one")
    of_files = [numbers(path, VIDEO) for path in files(tmp_path)]
    assert of_files[0] == list(range(50, 210))
    assert of_files[1] == list(range(210, 276))
    assert of_files[2][-1] == 399
    assert of_files[2][0] % 10 == 0
    closing = open_recording(files(tmp_path)[2]).metadata["rsenf.closing"]
    assert closing[f"missed {VIDEO}"] == "0"  # what wasn't to be recorded isn't missed


def test_memory_is_bounded_and_what_that_costs_is_said(tmp_path):
    clock = Clock()
    little = AlarmSettings(before_s=60.0, after_s=1.0, only=True, memory_mb=0.5)
    with archive(tmp_path, clock, alarms=little) as recorder:
        film(recorder, clock, range(200), size=10_000)
        recorder.alarm(None, "SIGUSR1")
    (path,) = files(tmp_path)
    recording = open_recording(path)
    kept = numbers(path, VIDEO)
    assert kept[0] % 10 == 0
    assert 25 < len(kept) <= 45
    assert recording.metadata["rsenf.forgotten"]["messages"] == str(2 * kept[0])


def test_a_ring_without_key_frames_is_bounded_too():
    ring = Ring(10**12, 100_000)
    for seq in range(1, 200):
        message = packet(10 * seq + 1, 5000)
        ring.add(Kept(seq, VIDEO, type(message), encode(message), message.header))
        assert sum(len(kept.payload) for kept in ring) <= 100_000
        assert seq < 20 or sum(len(kept.payload) for kept in ring) > 75_000
    assert ring.forgotten > 150


def kept(ring, seconds, made=rows, topic=ROWS, since_s=0.0):
    """Add ten messages a second; return the times of those that the ring has."""
    for tenth in range(round(10 * since_s), round(10 * (since_s + seconds))):
        message = made(10 * tenth + 1)  # no key frame
        now_ns = tenth * SECOND_NS // 10
        ring.add(Kept(now_ns, topic, type(message), encode(message), message.header))
    return [message.received_ns / 1e9 for message in ring if message.topic == topic]


def test_the_ring_of_a_camera_that_has_gone_dark_keeps_its_time():
    ring = Ring(5 * SECOND_NS, 10**9)
    kept(ring, 2, packet, VIDEO)
    assert kept(ring, 60, since_s=2)[0] == pytest.approx(56, abs=1.1)
    assert kept(ring, 0, topic=VIDEO) == []


def test_the_ring_of_a_video_without_key_frames_keeps_its_time():
    ring = Ring(5 * SECOND_NS, 10**9)
    assert 45 < kept(ring, 60, packet, VIDEO)[0] <= 55
    assert ring.forgotten == 0


def test_what_was_forgotten_long_ago_is_no_loss():
    ring = Ring(5 * SECOND_NS, 100_000)
    kept(ring, 2, lambda seq: packet(seq, 20_000), VIDEO)
    assert ring.forgotten > 0
    assert kept(ring, 20, since_s=2)[0] <= 17
    assert ring.forgotten == 0


def test_keys_that_are_no_camera_s_are_left_out(tmp_path):
    said = []
    with archive(tmp_path / "a", Clock(), warn=said.append) as recorder:
        for key in (
            "rsenf/../../rows",
            f"rsenf/lab/{'x' * 300}/rows",
            "rsenf/lab",
            "rsenf/./c/rows",
        ):
            assert not put(recorder, key, rows(0))
        assert put(recorder, ROWS, rows(0))
        assert recorder.refused == 4
    assert [p.relative_to(tmp_path / "a").parts[:2] for p in files(tmp_path / "a")] == [
        ("lab", "cam1")
    ]
    assert [p.name for p in tmp_path.iterdir()] == ["a"]
    assert said == ["'rsenf/../../rows' is no camera's key: not recorded, nor others like it"]


def test_an_alarm_of_what_is_no_camera_is_one_of_all(tmp_path):
    door = Alarm(header=header(0), kind="opened")
    with archive(tmp_path, Clock(), alarms=ONLY) as recorder:
        put(recorder, f"{CAM1}-reference/rows", rows(0))
        put(recorder, ROWS, rows(0))
        put(recorder, "rsenf/lab/door/alarm", door)
        recorder.alarm("rsenf/lab/door/alarm", "opened")
        assert len(files(tmp_path)) == 3
    with archive(tmp_path / "b", Clock(), alarms=ONLY) as recorder:
        for camera in ("rsenf/lab/reference-hall", CAM1):
            put(recorder, f"{camera}/rows", rows(0))
        recorder.alarm("rsenf/lab/reference-hall/alarm", "opened")
        assert [p.parts[-3] for p in files(tmp_path / "b")] == ["reference-hall"]


def filled(root, clock, camera=CAM1, files_wanted=5):
    """Five files of a second each; when each was last written is as the clock has it."""
    with archive(root, clock, rotation=Rotation(every_s=1.0)) as recorder:
        for seq in range(files_wanted):
            put(recorder, f"{camera}/rows", rows(seq))
            clock.advance(1.0)
            recorder.tick()
    for file in archived_files(root):
        written_at(file.path, file.start_ns + SECOND_NS)


def keep(root, clock, disk_bytes=10**12, **rules):
    return Keeper(
        root, Retention(**rules), clock, usage=lambda folder: Usage(disk_bytes, disk_bytes)
    ).apply()


def test_old_files_go(tmp_path):
    clock = Clock()
    filled(tmp_path, clock)
    before = files(tmp_path)
    clock.now_ns = NOW_NS + 3 * DAY_NS + round(2.5 * SECOND_NS)
    assert keep(tmp_path, clock) == []
    assert keep(tmp_path, clock, days=3) == before[:2]
    assert files(tmp_path) == before[2:]
    clock.advance(1e6)
    (tmp_path / "lab/cam1/2026-09-21/notes.mcap").write_text("not ours")
    assert keep(tmp_path, clock, days=3) == before[2:]
    assert [p.name for p in files(tmp_path)] == ["notes.mcap"]


def test_the_oldest_go_when_the_archive_takes_too_much(tmp_path):
    clock = Clock()
    filled(tmp_path, clock)
    filled(tmp_path, clock, CAM2)
    before = sorted(files(tmp_path), key=lambda path: path.name)
    size = sum(path.stat().st_size for path in before)
    assert keep(tmp_path, clock, 2 * size, disk_share=0.5) == []
    assert keep(tmp_path, clock, 2 * size - 4, disk_share=0.5) == before[:1]
    assert keep(tmp_path, clock, round(0.9 * size), disk_share=0.5) == before[1:6]
    assert not (tmp_path / "lab/cam1/2026-09-21").exists()


def test_the_oldest_go_before_a_disk_that_others_fill_is_full(tmp_path):
    clock = Clock()
    filled(tmp_path, clock)
    before = files(tmp_path)
    disk = Usage(10**12, 3 * 10**9 - 10)
    keeper = Keeper(tmp_path, Retention(disk_share=0.95), clock, usage=lambda folder: disk)
    assert keeper.apply() == before[:1]
    assert Keeper(tmp_path, Retention(days=9), clock, usage=lambda folder: disk).apply() == []


def test_a_file_that_can_t_go_costs_no_other(tmp_path, monkeypatch):
    clock, said = Clock(), []
    filled(tmp_path, clock)
    before = files(tmp_path)
    unlink = Path.unlink

    def refuse(path, missing_ok=False):
        if path == before[0]:
            raise PermissionError(1, "Operation not permitted", str(path))
        unlink(path, missing_ok=missing_ok)

    monkeypatch.setattr(Path, "unlink", refuse)
    clock.advance(1e7)
    keeper = Keeper(tmp_path, Retention(days=1), clock, warn=said.append)
    assert keeper.apply() == before[1:]
    assert keeper.apply() == []
    assert said == [f"{before[0]}: operation not permitted; it stays in the archive"]


def test_a_writer_waits_for_who_asks_whether_it_writes(tmp_path):
    path = tmp_path / "a"
    with open(path, "w") as writer, open(path) as asking:
        fcntl.flock(asking, fcntl.LOCK_SH)
        waiting = threading.Thread(target=hold, args=(writer.fileno(),))
        waiting.start()
        fcntl.flock(asking, fcntl.LOCK_UN)
        waiting.join()
        assert is_held(path)


def test_a_file_being_written_stays(tmp_path):
    clock = Clock()
    with archive(tmp_path, clock) as recorder:
        put(recorder, ROWS, rows(0))
        (path,) = files(tmp_path)
        clock.advance(1e7)
        assert keep(tmp_path, clock, 1, days=1, disk_share=0.1) == []
    assert numbers(path, ROWS) == [0]
    assert keep(tmp_path, clock, 1, days=1, disk_share=0.1) == [path]


def test_what_an_alarm_refers_to_stays(tmp_path):
    clock = Clock()
    alarms = AlarmSettings(before_s=1.5, after_s=0.2)
    with archive(tmp_path, clock, rotation=Rotation(every_s=1.0), alarms=alarms) as recorder:
        for seq in range(6):
            put(recorder, ROWS, rows(seq))
            put(recorder, f"{CAM2}/rows", rows(seq))
            clock.advance(0.5)
            if seq == 3:
                recorder.alarm(ALARM, "test")
            clock.advance(0.5)
            recorder.tick()
    for file in archived_files(tmp_path):
        written_at(file.path, file.start_ns + SECOND_NS)
    clock.advance(1e9)
    mine = [p for p in files(tmp_path) if "cam1" in p.parts]
    keep(tmp_path, clock, days=1)
    # Between 2.0 and 3.9 s (kept for twice the time after): files that begin at 1, 2 and 3 s.
    assert files(tmp_path) == mine[1:4]


def test_an_alarm_that_lasts_takes_few_lines(tmp_path):
    clock = Clock()
    with archive(tmp_path, clock, alarms=AlarmSettings(before_s=2, after_s=10)) as recorder:
        put(recorder, ROWS, rows(0))
        begun_ns = clock.now_ns
        for _ in range(300):
            recorder.alarm(ALARM, "lasts")
            clock.advance(0.1)
    spans = alarms_of(tmp_path, LAB)
    assert len(spans) == 3
    for tenth in range(300):
        now_ns = begun_ns + tenth * SECOND_NS // 10
        for wanted_ns in (now_ns - 2 * SECOND_NS, now_ns + 10 * SECOND_NS):
            assert any(span.covers(wanted_ns, wanted_ns) for span in spans)


def test_a_line_that_broke_off_costs_no_other(tmp_path):
    add_alarm(tmp_path, LAB, AlarmSpan(1, 2, "one"))
    path = tmp_path / "lab/cam1/alarms.jsonl"
    with open(path, "a") as file:
        for from_ns in ("Infinity", 10**30, -1, "[" * 100_000):  # of damage
            file.write(f'{{"version": 1, "from_ns": {from_ns}, "to_ns": 7, "why": ""}}\n')
        file.write(json.dumps({"version": 1, "from_ns": "3"})[:-4])
    add_alarm(tmp_path, LAB, AlarmSpan(5, 6, "two"))
    assert alarms_of(tmp_path, LAB) == [AlarmSpan(1, 2, "one"), AlarmSpan(5, 6, "two")]


def test_what_is_noted_of_an_alarm_is_on_the_disk(tmp_path, monkeypatch):
    waited = []
    monkeypatch.setattr(os, "fsync", waited.append)
    add_alarm(tmp_path, LAB, AlarmSpan(1, 2, "one"))
    AlarmLog(tmp_path).note("one", {"feed": "lab/cam1", "ack": None})
    assert len(waited) == 2


def test_a_clock_that_is_set_back_does_not_keep_the_file_open(tmp_path):
    clock = Clock()
    with archive(tmp_path, clock, alarms=ONLY) as recorder:
        film(recorder, clock, range(205), (CAM1,))
        recorder.alarm(ALARM, "test")
        clock.advance(-3600.0)
        film(recorder, clock, range(205, 300), (CAM1,))
        assert all(open_recording(path).complete for path in files(tmp_path))

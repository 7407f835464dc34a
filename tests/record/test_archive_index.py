"""What an archive says that it has, against what was put into it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from archive_samples import CAM1, CAM2, archive, at, files, film, put
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader
from record_samples import NOW_NS, SECOND_NS, Clock, header, random_message, rows

from rsenf.cli import main
from rsenf.messages import EnfEstimate, IdleEstimate
from rsenf.record.archive import index as index_module
from rsenf.record.archive.alarms import NAME, READ_BYTES, AlarmLog
from rsenf.record.archive.holdings import HoldingGap, extent_of, holding
from rsenf.record.archive.index import MOST_STRETCHES, read_archive
from rsenf.record.archive.layout import Camera
from rsenf.record.index import Stretch, Stretches, joined
from rsenf.record.limits import AlarmSettings, Rotation
from rsenf.record.recover import recover_in_place
from rsenf.timebase import utc_text

VIDEO, ROWS = f"{CAM1}/video", f"{CAM1}/rows"
LAB = Camera("lab", "cam1")
TWO_S = Rotation(every_s=2.0)


def frame_ns(seq):
    return NOW_NS + at(seq)["pts_ns"]


def pause(recorder, clock, seconds):
    for _ in range(round(seconds / 0.1)):
        clock.advance(0.1)
        recorder.tick()


def gaps_of(root, topic=VIDEO, first=None, last=None):
    entries = read_archive(root)
    asked = extent_of(entries, LAB)
    asked = Stretch(
        asked.first_ns if first is None else frame_ns(first),
        asked.last_ns if last is None else frame_ns(last),
    )
    return holding(entries, LAB, asked).topics[topic].gaps


def test_files_that_follow_each_other_leave_no_gap(tmp_path):
    clock = Clock()
    with archive(tmp_path, clock, rotation=TWO_S) as recorder:
        film(recorder, clock, range(200))
    assert len(files(tmp_path)) == 4
    assert gaps_of(tmp_path) == gaps_of(tmp_path, ROWS) == []
    assert gaps_of(tmp_path, first=-100, last=300) == [
        HoldingGap(frame_ns(-100), frame_ns(0), None),
        HoldingGap(frame_ns(199), frame_ns(300), None),
    ]


def test_a_gap_within_a_file_and_one_between_two(tmp_path):
    clock = Clock()
    with archive(tmp_path, clock, rotation=Rotation(every_s=20.0)) as recorder:
        film(recorder, clock, range(100))
        pause(recorder, clock, 4.0)
        film(recorder, clock, range(200, 300))  # a hundred were lost
    clock.advance(6.0)
    with archive(tmp_path, clock) as recorder:
        film(recorder, clock, range(450, 600))
    assert len(files(tmp_path)) == 2
    gaps = [
        HoldingGap(frame_ns(99), frame_ns(200), None),
        HoldingGap(frame_ns(299), frame_ns(450), 150),
    ]
    assert gaps_of(tmp_path) == gaps_of(tmp_path, ROWS) == gaps
    found = holding(read_archive(tmp_path), LAB, Stretch(frame_ns(0), frame_ns(170)))
    assert found.topics[VIDEO].gaps == [HoldingGap(frame_ns(99), frame_ns(170), None)]
    assert found.topics[VIDEO].missed == 100
    assert len(found.files) == 1


def test_a_pause_in_which_nothing_was_sent(tmp_path):
    clock = Clock()
    with archive(tmp_path, clock, rotation=TWO_S) as recorder:
        for seq in range(50):
            put(recorder, ROWS, rows(seq, **at(seq)))
            recorder.tick()
            clock.advance(0.04)
        clock.advance(10)
        recorder.tick()
        for seq in range(50, 80):
            put(recorder, ROWS, rows(seq, **at(seq + 250)))
    assert gaps_of(tmp_path, ROWS) == [HoldingGap(frame_ns(49), frame_ns(300), 0)]


def test_few_numbers_missing_between_files_show_though_the_pause_is_short(tmp_path):
    clock = Clock()
    with archive(tmp_path, clock) as recorder:
        film(recorder, clock, range(100))
    with archive(tmp_path, clock) as recorder:
        film(recorder, clock, range(110, 200))
    assert gaps_of(tmp_path) == [HoldingGap(frame_ns(99), frame_ns(110), 10)]


def test_an_alarm_file_beside_the_others_makes_no_gap(tmp_path):
    clock, again = Clock(), Clock()
    with archive(tmp_path, clock, rotation=TWO_S) as recorder:
        film(recorder, clock, range(200))
    only = AlarmSettings(before_s=1, after_s=1, only=True)
    with archive(tmp_path, again, alarms=only) as recorder:
        film(recorder, again, range(75))
        recorder.alarm(VIDEO, "test")
        film(recorder, again, range(75, 120))
    assert len(files(tmp_path)) == 5
    assert gaps_of(tmp_path) == []


def test_a_truncated_file_is_listed_with_what_is_left(tmp_path):
    clock = Clock()
    with archive(tmp_path, clock, rotation=Rotation(every_s=6.0)) as recorder:
        film(recorder, clock, range(450))
    paths = files(tmp_path)
    whole = paths[1].stat().st_size
    with open(paths[1], "r+b") as file:
        file.truncate(whole // 2)
    entries = read_archive(tmp_path)
    states = [e.summary.state for e in entries]
    assert states == ["complete", "truncated", "complete"]
    left = entries[1].summary.topics[VIDEO]
    assert 0 < left.messages < 150
    assert entries[1].summary.cut_bytes > 0
    (gap,) = gaps_of(tmp_path)
    assert frame_ns(150) < gap.first_ns < gap.last_ns == frame_ns(300)
    assert gap.missing is None
    paths[2].write_bytes(b"no recording")
    assert read_archive(tmp_path)[2].summary.state == "unreadable"


def send(recorder, clock, topic, cls, numbers, every_s, **changed):
    """Record a message every so many seconds; what ``changed`` names isn't as in other messages."""
    for seq in numbers:
        now_ns = clock()
        head = header(seq, **{"pts_ns": now_ns - NOW_NS, "arrival_time_ns": now_ns, **changed})
        put(recorder, topic, random_message(cls, 1, head))
        for _ in range(round(every_s / 0.5)):
            clock.advance(0.5)
            recorder.tick()


def test_a_camera_that_is_started_anew_is_found_where_it_ran(tmp_path):
    clock = Clock()
    with archive(tmp_path, clock) as recorder:
        for run_id in ("first", "second"):
            for seq in range(50):
                put(recorder, ROWS, rows(seq, run_id=run_id, arrival_time_ns=clock()))
                recorder.tick()
                clock.advance(0.04)
            pause(recorder, clock, 58.0)
    (gap,) = gaps_of(tmp_path, ROWS)
    assert gap == HoldingGap(frame_ns(49), frame_ns(1500), None)


def test_a_slow_topic_has_gaps_of_its_own_measure(tmp_path):
    clock, track = Clock(), f"{CAM1}/track"
    with archive(tmp_path, clock, rotation=Rotation(every_s=300.0)) as recorder:
        send(recorder, clock, track, EnfEstimate, range(67), 9.0)
        pause(recorder, clock, 120.0)
        send(recorder, clock, track, EnfEstimate, range(80, 120), 9.0)
    (gap,) = gaps_of(tmp_path, track)
    assert gap.last_ns - gap.first_ns == 129 * SECOND_NS
    assert gap.missing == 13
    assert sum(len(e.summary.topics[track].stretches) for e in read_archive(tmp_path)) < 10


def test_of_a_day_of_gaps_the_index_keeps_a_few(tmp_path, capsys):
    clock, track = Clock(), f"{CAM1}/track"
    with archive(tmp_path, clock, rotation=Rotation(every_s=2e4), fsync=False) as recorder:
        for n in range(100):
            send(recorder, clock, track, EnfEstimate, range(12 * n, 12 * n + 12), 0.5)
            clock.advance(20.0 if n % 10 else 200.0)
    (entry,) = read_archive(tmp_path)
    kept = entry.summary.topics[track]
    assert len(kept.stretches) <= MOST_STRETCHES
    assert kept.messages == 1200
    assert 20 * SECOND_NS <= kept.coarse_ns < 200 * SECOND_NS
    assert main(["archive", str(tmp_path)]) == 0
    assert "10 gaps (those of up to 37 s aren't told)" in capsys.readouterr().out


def test_estimates_of_all_so_far_stretch_no_file_back_to_the_beginning(tmp_path):
    clock, idle = Clock(), f"{CAM1}/idle"
    with archive(tmp_path, clock, rotation=TWO_S) as recorder:
        for seq in range(200):
            number = seq + 7 * (seq >= 160)  # some are missed, late
            put(recorder, ROWS, rows(number, **at(seq)))
            if seq % 10 == 0:
                head = header(seq // 10, pts_ns=0, arrival_time_ns=clock())
                put(recorder, idle, random_message(IdleEstimate, 1, head))
            recorder.tick()
            clock.advance(0.04)
    entries = read_archive(tmp_path)
    assert len(entries) == 4
    found = holding(entries, LAB, Stretch(frame_ns(10), frame_ns(40)))
    assert found.files == entries[:1]
    assert (found.topics[ROWS].messages, found.topics[ROWS].missed) == (50, 0)
    last = holding(entries, LAB, Stretch(frame_ns(160), frame_ns(190)))
    assert last.files == entries[3:]
    assert (last.topics[ROWS].missed, last.topics[idle].messages) == (7, 5)
    assert last.topics[idle].gaps is None


def test_what_a_topic_missed_at_another_time_is_not_counted(tmp_path):
    clock = Clock()
    with archive(tmp_path, clock) as recorder:
        send(recorder, clock, f"{CAM1}/track", EnfEstimate, range(20), 1.0)
        for seq in (*range(500, 600), *range(607, 700)):
            put(recorder, ROWS, rows(seq, **at(seq)))
    found = holding(read_archive(tmp_path), LAB, Stretch(NOW_NS, NOW_NS + 10 * SECOND_NS))
    assert (found.topics[ROWS].messages, found.topics[ROWS].missed) == (0, 0)
    assert found.topics[ROWS].gaps == [HoldingGap(*found.asked, None)]


def spoil_last_chunks(path, count):
    with path.open("rb") as stream:
        chunks = make_reader(stream).get_summary().chunk_indexes
    content = bytearray(path.read_bytes())
    for chunk in chunks[-count:]:
        content[chunk.chunk_start_offset + 60] ^= 0xFF
    path.write_bytes(content)


def test_what_damage_took_is_no_pause_in_which_nothing_was_sent(tmp_path, capsys):
    clock = Clock()
    with archive(tmp_path, clock, rotation=Rotation(every_s=20.0), fsync=False) as recorder:
        film(recorder, clock, range(1000))
    first, _ = files(tmp_path)
    spoil_last_chunks(first, 8)
    assert gaps_of(tmp_path) == []  # the end of a file is believed
    assert main(["archive", str(tmp_path), "--check", "--json"]) == 0
    (camera,) = json.loads(capsys.readouterr().out)["cameras"]
    states = [(f["checked"], f["damaged"] > 0) for f in camera["files"]]
    assert states == [(True, True), (True, False)]
    (gap,) = gaps_of(tmp_path)  # what was found out stays known
    assert frame_ns(390) < gap.first_ns < gap.last_ns == frame_ns(500)
    assert gap.missing is None
    recover_in_place(first)
    assert gaps_of(tmp_path) == [gap]
    assert main(["archive", str(tmp_path)]) == 0
    out = capsys.readouterr().out
    assert "nothing was sent" not in out
    assert "what was left of a damaged one" in out


@pytest.mark.parametrize("note", ["missed", "first", "last", "messages", "joined_at"])
@pytest.mark.parametrize("value", [b"p", b"-", b" "])
def test_metadata_that_have_become_something_else_spoil_no_answer(tmp_path, note, value):
    clock = Clock()
    with archive(tmp_path, clock, rotation=TWO_S) as recorder:
        film(recorder, clock, range(100))
    first, _ = files(tmp_path)
    content, key = bytearray(first.read_bytes()), f"{note} {ROWS}".encode()
    start = content.index(key) + len(key) + 4  # after the text's length
    content[start : start + 1] = value
    first.write_bytes(content)
    assert gaps_of(tmp_path, ROWS) == []
    assert main(["archive", str(tmp_path)]) == 0
    assert main(["doctor", str(first)]) == 0


def test_the_index_is_made_once_and_again_for_what_has_changed(tmp_path, monkeypatch):
    clock = Clock()
    with archive(tmp_path, clock, rotation=TWO_S) as recorder:
        film(recorder, clock, range(200))
    first, read = read_archive(tmp_path), []
    real = index_module.summarise

    def summarise(path, *, check):
        read.append(path)
        return real(path, check=check)

    monkeypatch.setattr(index_module, "summarise", summarise)
    assert read_archive(tmp_path) == first
    assert read == []
    paths = files(tmp_path)
    with open(paths[1], "r+b") as file:
        file.truncate(5000)
    paths[2].unlink()
    assert len(read_archive(tmp_path)) == 3
    assert read == [paths[1]]
    whole = (tmp_path / "index.json").read_text()
    other = whole.replace('"messages": ', '"messages": 1')
    for broken in ('{"version": 0, "files": {}}', "{", "[" * 100_000, "[]", other):
        (tmp_path / "index.json").write_text(broken)
        read.clear()
        assert len(read_archive(tmp_path)) == len(read) == 3


@given(st.lists(st.tuples(st.integers(0, 400), st.integers(0, 5)), max_size=30))
def test_stretches_as_by_counting(pairs):
    half_s = SECOND_NS // 2
    found, there = Stretches(), set()
    for begin, length in pairs:
        found.add(Stretch(begin * half_s, (begin + length) * half_s))
        there |= set(range(begin, begin + length + 1))
    out = []
    for tick in sorted(there):
        if out and tick - out[-1][1] <= 1:
            out[-1][1] = tick
        else:
            out.append([tick, tick])
    assert [[a // half_s, b // half_s] for a, b in found.all()] == out


def test_of_too_many_stretches_the_closest_become_one():
    found = Stretches()
    for hour in range(20_000):
        found.add(Stretch(hour * 3 * SECOND_NS, hour * 3 * SECOND_NS + 1))
    found.add(Stretch(10**15, 10**15 + 1))
    assert found.all() == [Stretch(0, 19_999 * 3 * SECOND_NS + 1), Stretch(10**15, 10**15 + 1)]
    assert joined([Stretch(0, 9), Stretch(2, 3), Stretch(15, 16)], 5) == [
        Stretch(0, 9),
        Stretch(15, 16),
    ]


@pytest.fixture
def gappy(tmp_path):
    """Cameras at 14:13:20, with a gap of four seconds from 14:13:24 on; an alarm; a broken file."""
    clock, root = Clock(), tmp_path / "archive"
    with archive(root, clock, rotation=TWO_S) as recorder:
        film(recorder, clock, range(100))
        recorder.alarm(f"{CAM1}/alarm", "the light changed")
        pause(recorder, clock, 4.0)
        film(recorder, clock, range(200, 300))
    return root


def test_the_command_answers(gappy, capsys):
    words = ["archive", str(gappy), "--camera", "cam1", "--from", "14:13:22", "--to", "14:13:30"]
    assert main(words) == 0
    out = capsys.readouterr().out
    assert out.startswith("lab/cam1  2026-09-21T14:13:22.000Z to 2026-09-21T14:13:30.000Z\n")
    assert "  video      49.5 % of the time, 1 gap, 100 missed\n" in out
    assert "    gap      14:13:23.960Z to 14:13:28.000Z  4.0 s, 100 messages missing\n" in out
    assert "the light changed" in out
    assert main([*words, "--json"]) == 0
    (camera,) = json.loads(capsys.readouterr().out)["cameras"]
    video = next(t for t in camera["topics"] if t["topic"] == VIDEO)
    assert [(g["from_ns"], g["missing"]) for g in video["gaps"]] == [(str(frame_ns(99)), 100)]
    assert video["covered_s"] == pytest.approx(3.96)
    assert {f["state"] for f in camera["files"]} == {"complete"}
    assert camera["from_utc"] == utc_text(NOW_NS + 2 * SECOND_NS)


def test_the_command_refuses(gappy, capsys):
    for words, text in (
        (["--camera", "cam9"], "nothing of 'cam9' (its cameras: lab/cam1)"),
        (["--from", "25:00"], "--from '2026-09-21T25:00' is not a time"),
        (["--from", "2026-09-21T11:00", "--to", "10:00"], "nothing lies between --from and --to"),
        (["--from", "11:00", "--to", "11:00"], "nothing lies between --from and --to"),
        (["--day", "garbage"], "--day 'garbage' is not a date"),
        (["--day", "2026-13-01"], "--day '2026-13-01' is not a time"),
    ):
        assert main(["archive", str(gappy), *words]) == 2
        assert text in capsys.readouterr().err
    assert main(["archive", str(gappy / "nowhere")]) == 2
    assert "no such folder" in capsys.readouterr().err
    (gappy / "empty").mkdir()
    assert main(["archive", str(gappy / "empty")]) == 0
    assert "holds no recordings" in capsys.readouterr().err


@pytest.fixture
def several(tmp_path):
    """A camera until 14:13:24, another for a while before and after midnight, and the reference."""
    clock = Clock()
    with archive(tmp_path, clock) as recorder:
        put(recorder, "rsenf/lab/reference/ce", rows(0, source="reference/ce"))
        film(recorder, clock, range(100))
        clock.advance(34_600 - 4)  # to 23:50
        for minute in range(30):
            head = header(minute, pts_ns=minute * 60 * SECOND_NS, arrival_time_ns=clock())
            put(recorder, f"{CAM2}/track", random_message(EnfEstimate, 1, head))
            clock.advance(60)
            recorder.tick()
    return tmp_path


@pytest.mark.parametrize(
    ("words", "first", "last"),
    [
        (["--from", "14:13:30"], "2026-09-22T14:13:30", "2026-09-22T14:13:30"),
        (["--from", "00:05"], "2026-09-22T00:05:00", "2026-09-22T00:19:00"),
        (["--to", "00:05"], "2026-09-21T23:50:00", "2026-09-22T00:05:00"),
        (["--day", "2026-09-22"], "2026-09-22T00:00:00", "2026-09-23T00:00:00"),
        (["--day", "2026-09-21", "--from", "23:00"], "2026-09-21T23:00:00", "2026-09-22T00:00:00"),
        (["--from", "23:55", "--to", "00:10"], "2026-09-21T23:55:00", "2026-09-22T00:10:00"),
        (["--from", "00:10", "--to", "00:05"], "2026-09-22T00:10:00", "2026-09-23T00:05:00"),
        (
            ["--from", "23:55", "--to", "00:10", "--day", "2026-09-20"],
            "2026-09-20T23:55:00",
            "2026-09-21T00:10:00",
        ),
    ],
)
def test_from_when_to_when_of_all_cameras(several, capsys, words, first, last):
    assert main(["archive", str(several), *words, "--json"]) == 0
    cameras = {c["camera"]: c for c in json.loads(capsys.readouterr().out)["cameras"]}
    assert set(cameras) == {"cam1", "cam2", "reference"}
    assert cameras["cam2"]["from_utc"] == f"{first}.000Z"
    assert cameras["cam2"]["to_utc"] == f"{last}.000Z"
    ended = cameras["cam1"]
    assert bool(ended["files"]) == (words == ["--to", "00:05"])
    assert ended["from_ns"] <= ended["to_ns"]


def test_a_file_being_written_is_called_so(tmp_path, capsys):
    clock = Clock()
    with archive(tmp_path, clock) as recorder:
        film(recorder, clock, range(50))
        assert main(["archive", str(tmp_path)]) == 0
        assert "MB  writing\n" in capsys.readouterr().out


def test_it_lists_who_has_seen_an_alarm(tmp_path, capsys):
    clock = Clock()
    with archive(tmp_path, clock) as recorder:
        film(recorder, clock, range(100))
    begun_ms = NOW_NS / 1e6 + 1000
    alarm = {"feed": "lab/cam1", "kind": "frozen", "start_ms": begun_ms, "end_ms": begun_ms + 500}
    seen = {"by": "Ann", "note": "the lens was covered", "at_ms": begun_ms + 60_000}
    log = AlarmLog(tmp_path)
    log.note("one", {**alarm, "ack": None})
    log.note("one", {**alarm, "ack": seen})
    log.note("not seen", {**alarm, "ack": None})
    log.note("of another", {**alarm, "feed": "lab/cam2", "ack": seen})
    log.note("of another day", {**alarm, "start_ms": 0, "end_ms": 1, "ack": seen})
    with (tmp_path / NAME).open("a") as file:  # more than the dashboard reads again
        file.write(f"{json.dumps({**alarm, 'version': 1, 'id': 'x', 'ack': None})}\n" * 80_000)
    assert (tmp_path / NAME).stat().st_size > READ_BYTES
    main(["archive", str(tmp_path), "--json"])
    (camera,) = json.loads(capsys.readouterr().out)["cameras"]
    (found,) = camera["acknowledged"]
    assert (found["kind"], found["by"], found["note"]) == ("frozen", "Ann", seen["note"])
    assert found["from_utc"] == utc_text(NOW_NS + SECOND_NS)
    main(["archive", str(tmp_path)])
    assert "frozen, by Ann: the lens was covered" in capsys.readouterr().out


def test_the_log_of_alarms_is_read_once_for_all_cameras(several, capsys, monkeypatch):
    AlarmLog(several).note("one", {"feed": "lab/cam1", "ack": None})
    opened, opening = [], Path.open

    def counted(path, *args, **more):
        opened.append(path)
        return opening(path, *args, **more)

    monkeypatch.setattr(Path, "open", counted)
    assert main(["archive", str(several)]) == 0
    assert capsys.readouterr().out.count("lab/") > 2
    assert opened.count(several / NAME) == 1

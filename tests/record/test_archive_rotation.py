"""Each file of an archive is complete in itself, and nothing is missing between two."""

from __future__ import annotations

import itertools
import os
import time

import pytest
from archive_samples import CAM1, CAM2, archive, at, files, film, numbers, put
from mcap.reader import make_reader
from record_samples import NOW_NS, SECOND_NS, Clock, packet, rows

from rsenf.errors import RecordingError, UsageError
from rsenf.messages import Mark, VideoPacket
from rsenf.record import open_recording, scan
from rsenf.record.archive.layout import camera_of
from rsenf.record.limits import Rotation
from rsenf.record.sequence import MessagePlace

VIDEO, ROWS = f"{CAM1}/video", f"{CAM1}/rows"


def assert_whole(paths):
    """Every file stands alone, and numbers and times go on from each to the next."""
    for path in paths:
        recording = open_recording(path)
        assert recording.complete
        assert recording.metadata["rsenf"]["run_id"] == "run"
        first = next(m for t, m, _ in recording.messages([VIDEO]))
        assert first.keyframe
        assert first.data
        with open(path, "rb") as stream:
            schemas = {s.name for s in make_reader(stream).get_summary().schemas.values()}
        assert schemas == {"foxglove.CompressedVideo", "rsenf.VideoPacket", "rsenf.RowBlock"}
    for topic in (VIDEO, ROWS):
        of_files = [numbers(path, topic) for path in paths]
        assert list(itertools.chain(*of_files)) == list(range(sum(map(len, of_files))))
        closing = [open_recording(path).metadata["rsenf.closing"] for path in paths]
        for notes, seqs in zip(closing, of_files, strict=True):
            assert (
                MessagePlace.read(notes[f"first {topic}"]).seq,
                int(notes[f"joined_at {topic}"]),
            ) == (
                seqs[0],
                seqs[0],
            )
            assert MessagePlace.read(notes[f"last {topic}"]).seq == seqs[-1]
            assert notes[f"missed {topic}"] == "0"
        times = [t for p in paths for _, _, t in open_recording(p).messages([topic])]
        assert [t - NOW_NS for t in times] == [at(k)["pts_ns"] for k in range(len(times))]


def test_by_time_at_the_next_key_frame(tmp_path):
    clock = Clock()
    with archive(tmp_path, clock, rotation=Rotation(every_s=1.0)) as recorder:
        film(recorder, clock, range(100))
    paths = files(tmp_path)
    assert_whole(paths)
    # 25 frames are a second; the next key frame is the thirtieth.
    assert [numbers(p, VIDEO)[0] for p in paths] == [0, 30, 60, 90]
    day = paths[0].parent
    assert (day.parent.name, day.name, paths[0].name) == (
        "cam1",
        "2026-09-21",
        "141320.000000Z.mcap",
    )


def test_by_size(tmp_path):
    clock = Clock()
    rotation = Rotation(size_mb=0.5)
    with archive(tmp_path, clock, rotation=rotation) as recorder:
        film(recorder, clock, range(200), size=10_000)
    paths = files(tmp_path)
    assert_whole(paths)
    assert len(paths) == 4
    assert all(450_000 < path.stat().st_size < 700_000 for path in paths[:-1])


def test_at_midnight(tmp_path):
    clock = Clock(NOW_NS - NOW_NS % (86_400 * SECOND_NS) + 86_398 * SECOND_NS)
    with archive(tmp_path, clock) as recorder:
        film(recorder, clock, range(100))
    assert [path.parent.name for path in files(tmp_path)] == ["2026-09-21", "2026-09-22"]


def test_video_without_key_frames_goes_on_at_twice_the_limit(tmp_path):
    clock = Clock()
    with archive(tmp_path, clock, rotation=Rotation(every_s=1.0)) as recorder:
        for seq in range(1, 100):
            message = packet(seq, **at(seq))
            put(recorder, VIDEO, VideoPacket(header=message.header, codec="h264", data=b"x"))
            recorder.tick()
            clock.advance(0.04)
    assert [numbers(p, VIDEO)[0] for p in files(tmp_path)] == [1, 52]


def test_video_that_has_ended_holds_up_nothing(tmp_path):
    clock = Clock()
    with archive(tmp_path, clock, rotation=Rotation(every_s=1.0)) as recorder:
        film(recorder, clock, range(10))
        end = packet(10).header.numbered(10, Mark.END)
        put(recorder, VIDEO, VideoPacket(header=end, codec="h264"))
        for seq in range(10, 40):
            put(recorder, ROWS, rows(seq, **at(seq)))
            clock.advance(0.04)
    _, second = files(tmp_path)
    assert numbers(second, ROWS) == list(range(25, 40))


def test_a_file_that_is_due_ends_though_nothing_comes(tmp_path):
    clock = Clock()
    with archive(tmp_path, clock, rotation=Rotation(every_s=1.0)) as recorder:
        put(recorder, ROWS, rows(0))
        clock.advance(1.5)
        recorder.tick()
        (path,) = files(tmp_path)
        assert open_recording(path).complete
        clock.advance(5)
        recorder.tick()
        assert files(tmp_path) == [path]


def test_losses_are_counted_in_the_file_they_fall_in(tmp_path):
    clock = Clock()
    with archive(tmp_path, clock, rotation=Rotation(every_s=1.0)) as recorder:
        for seq in [*range(20), *range(23, 33), *range(35, 45), 36]:
            put(recorder, ROWS, rows(seq))
            clock.advance(0.04)
    missed = [
        (notes[f"missed {ROWS}"], notes[f"duplicates {ROWS}"])
        for notes in (open_recording(p).metadata["rsenf.closing"] for p in files(tmp_path))
    ]
    assert missed == [("3", "0"), ("2", "1")]


def test_each_camera_has_files_of_its_own(tmp_path):
    clock = Clock()
    with archive(tmp_path, clock) as recorder:
        film(recorder, clock, range(10), (CAM1, CAM2))
        put(recorder, "rsenf/lab/reference/ce", rows(0))
        put(recorder, "rsenf/lab/@nodes/decode/health", rows(0))
    of = {p.parent.parent.name: set(open_recording(p).topics) for p in files(tmp_path)}
    assert of == {
        "cam1": {VIDEO, ROWS},
        "cam2": {f"{CAM2}/video", f"{CAM2}/rows"},
        "reference": {"rsenf/lab/reference/ce"},
        "@nodes": {"rsenf/lab/@nodes/decode/health"},
    }


def test_later_files_tell_of_the_run_as_it_is_now(tmp_path):
    clock, info = Clock(), {"run_id": "run", "config": "before"}
    with archive(tmp_path, clock, rotation=Rotation(every_s=1.0), run_info=info) as recorder:
        info["config"] = "of the caller alone"
        film(recorder, clock, range(10))
        recorder.update_run_info({"config": "after"})
        film(recorder, clock, range(10, 70))
    told = [open_recording(path).metadata["rsenf"]["config"] for path in files(tmp_path)]
    assert told == ["before", "after", "after"]
    assert info == {"run_id": "run", "config": "of the caller alone"}


def test_what_is_under_the_name_already(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(UsageError, match="this is no folder"):
        archive(tmp_path / "file", Clock())
    with archive(tmp_path, Clock()) as recorder:
        (tmp_path / "lab").write_text("")
        with pytest.raises(RecordingError, match=r"lab.*: recording stopped, not a directory"):
            put(recorder, ROWS, rows(0))


@pytest.mark.parametrize("closed", [False, True])
def test_what_a_process_that_died_has_recorded_is_not_recorded_again(tmp_path, closed):
    """Senders deliver the rows of the last minutes again; a full disk ends a recorder in order."""
    clock = Clock()
    died = archive(tmp_path, clock)
    film(died, clock, range(100), (CAM1, CAM2))
    for recorder in (died._cameras[camera_of(f"{cam}/rows")].recorder for cam in (CAM1, CAM2)):
        recorder.flush()
    if closed:
        died.close()
    before = files(tmp_path)
    with archive(tmp_path, clock, resumed=True) as recorder:
        for seq in range(60, 150):
            if seq != 120:
                for camera in (CAM1, CAM2):
                    put(recorder, f"{camera}/rows", rows(seq, **at(seq)))
        tallies = recorder._cameras[camera_of(f"{CAM1}/rows")].recorder.tallies
        assert tallies[f"{CAM1}/rows"].missed == 1
    for camera, path in zip((CAM1, CAM2), sorted(set(files(tmp_path)) - set(before)), strict=True):
        new = [seq for seq in range(100, 150) if seq != 120]
        assert numbers(path, f"{camera}/rows") == new


def test_files_of_long_ago_are_not_read_for_that(tmp_path):
    clock = Clock(time.time_ns())
    with archive(tmp_path, clock) as recorder:
        film(recorder, clock, range(100))
    (before,) = files(tmp_path)
    os.utime(before, (time.time() - 3600,) * 2)
    with archive(tmp_path, clock, resumed=True) as recorder:
        film(recorder, clock, range(90, 110))
    assert numbers(files(tmp_path)[-1], f"{CAM1}/rows") == list(range(90, 110))


@pytest.mark.parametrize("closed", [False, True])
def test_only_the_chunks_that_tell_where_its_topics_ended_are_read(tmp_path, monkeypatch, closed):
    """Video that isn't recorded meanwhile is lost: it is sent once."""
    clock, unpacked, real = Clock(), [], scan.unpack_chunk
    died = archive(tmp_path, clock)
    film(died, clock, range(1000))
    put(died, f"{CAM1}/seldom", rows(0, **at(1000)))
    film(died, clock, range(1000, 2000))
    died._cameras[camera_of(ROWS)].recorder.flush()
    if closed:
        died.close()
    (before,) = files(tmp_path)
    with monkeypatch.context() as counting:
        counting.setattr(scan, "unpack_chunk", lambda *a, **k: unpacked.append(a) or real(*a, **k))
        recorder = archive(tmp_path, clock, resumed=True)
    # The first chunk defines two topics, the last has their end; one has all of the third.
    assert len(unpacked) == 3
    with recorder:
        taken = [put(recorder, ROWS, rows(seq, **at(seq))) for seq in range(1500, 2010)]
        assert taken == [False] * 500 + [True] * 10
        assert not put(recorder, f"{CAM1}/seldom", rows(0, **at(1000)))
    assert numbers(before, ROWS) == list(range(2000))


def test_streams_that_had_ended_before_the_last_chunk_are_not_recorded_again(tmp_path):
    clock = Clock()
    runs = {"run": range(100), "run.decode1": range(100, 200)}
    sent = [rows(n - span[0], run_id=run, **at(n)) for run, span in runs.items() for n in span]
    died = archive(tmp_path, clock)
    for message in sent:
        put(died, ROWS, message)
        died.tick()
        clock.advance(0.04)
    died._cameras[camera_of(ROWS)].recorder.flush()
    with archive(tmp_path, clock, resumed=True) as recorder:
        assert not any(put(recorder, ROWS, message) for message in sent)
        assert put(recorder, ROWS, rows(100, run_id="run.decode1", **at(200)))
        # The host's clock was set back: a stream that begins now is new all the same.
        assert put(recorder, ROWS, rows(0, run_id="run.decode2", **at(0)))

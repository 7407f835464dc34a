"""Recordings opened as what they are, with what they lack."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest

from rsenf.errors import InputError, UsageError
from rsenf.messages import Frame, Header, RowBlock
from rsenf.record.writer import Recorder
from rsenf.rows.stage import blocks_from_luminance
from rsenf.run.inputs import open_input_file, read_npz


def some_blocks(camera: str, count: int, epoch: int = 0) -> list[RowBlock]:
    level = np.random.default_rng(1).normal(100.0, 1.0, (8 * count, 4, 2)).astype(np.float32)
    header = Header(source=f"home/{camera}", run_id="r")
    blocks = list(blocks_from_luminance(level, np.arange(8 * count) / 30, header))
    for block in blocks:
        object.__setattr__(block.header, "epoch", epoch)
    return blocks


def recorded(path: Path, blocks: Iterable[RowBlock]) -> Path:
    # Ten milliseconds pass between any two looks at the clock: a chunk is flushed now and then.
    clock = itertools.count(1_700_000_000 * 10**9, 10_000_000)
    with Recorder(path, run_info={"run_id": "r"}, clock_ns=lambda: next(clock)) as out:
        for block in blocks:
            out.write(f"rsenf/{block.header.source}/rows", block)
    return path


def test_a_video(clip: Path) -> None:
    video = open_input_file(clip)
    assert (video.name, video.begins_with) == ("clip.mp4", "frames")
    assert video.duration_s == pytest.approx(1349 * 1001 / 30000)
    frame = next(iter(video.messages()))
    assert isinstance(frame, Frame)
    assert frame.header.source == "file/clip"
    assert (video.loss, video.warnings) == ("", [])


def test_what_a_thing_is_counts_not_its_name(clip: Path, tmp_path: Path) -> None:
    (tmp_path / "film.txt").write_bytes(clip.read_bytes())
    assert open_input_file(tmp_path / "film.txt").begins_with == "frames"
    recorded(tmp_path / "x.mcap", some_blocks("door", 1)).rename(tmp_path / "rows.bin")
    (block,) = open_input_file(tmp_path / "rows.bin").messages()
    assert isinstance(block, RowBlock)


def test_a_graph_may_name_the_source(clip: Path) -> None:
    frame = next(iter(open_input_file(clip, source="home/door").messages()))
    assert frame.header.source == "home/door"


@pytest.mark.parametrize("where", ["rtsp://u:p@h/cam", "/dev/null"])
def test_a_live_source_is_for_a_graph(where: str) -> None:
    with pytest.raises(UsageError, match="is a live source") as refused:
        open_input_file(where)
    assert "u:p" not in str(refused.value)


def test_row_blocks_come_back_as_they_were_recorded(tmp_path: Path) -> None:
    blocks = some_blocks("door", 5)
    recording = open_input_file(recorded(tmp_path / "x.mcap", blocks))
    back = list(recording.messages())
    assert [b.header.seq for b in back] == [0, 1, 2, 3, 4]
    for sent, read in zip(blocks, back, strict=True):
        assert np.array_equal(sent.level, read.level)
        assert np.array_equal(sent.frame_pts_ns, read.frame_pts_ns)
    assert (recording.loss, recording.warnings) == ("", [])


def test_one_camera_of_several(tmp_path: Path) -> None:
    path = recorded(tmp_path / "x.mcap", [*some_blocks("door", 2), *some_blocks("yard", 3)])
    with pytest.raises(UsageError, match="several cameras: door, yard") as refused:
        open_input_file(path)
    assert "--camera" in refused.value.hint
    assert len(list(open_input_file(path, camera="yard").messages())) == 3
    with pytest.raises(UsageError, match="no row blocks of camera 'roof'") as refused:
        open_input_file(path, camera="roof")
    assert "door, yard" in refused.value.hint


def test_row_blocks_that_are_missing_are_counted(tmp_path: Path) -> None:
    first, second = some_blocks("door", 9), some_blocks("door", 9, epoch=1)
    recording = open_input_file(
        recorded(tmp_path / "x.mcap", [*first[:4], *first[6:], *second[1:]])
    )
    assert len(list(recording.messages())) == 15
    assert recording.warnings == ["row blocks that were not recorded: 3"]
    assert recording.loss == ""


def test_a_recording_that_broke_off(tmp_path: Path) -> None:
    whole = recorded(tmp_path / "x.mcap", some_blocks("door", 1000)).read_bytes()
    (tmp_path / "cut.mcap").write_bytes(whole[: len(whole) * 3 // 4])
    recording = open_input_file(tmp_path / "cut.mcap")
    assert 0 < len(list(recording.messages())) < 1000
    assert recording.loss.startswith("the recording is cut short")


def test_a_damaged_recording_gives_the_rest(tmp_path: Path) -> None:
    path = recorded(tmp_path / "x.mcap", some_blocks("door", 1000))
    content = bytearray(path.read_bytes())
    content[len(content) // 5] ^= 0xFF
    path.write_bytes(content)
    recording = open_input_file(path)
    assert 0 < len(list(recording.messages())) < 1000
    assert "damaged parts, left out: " in recording.loss


def test_rows_of_an_npz(tmp_path: Path) -> None:
    level = np.random.default_rng(1).normal(100.0, 1.0, (20, 6, 3)).astype(np.float32)
    time_s = np.arange(20) / 25 + 3.0
    np.savez(tmp_path / "x.npz", rows=level, frame_time_s=time_s)
    npz = open_input_file(tmp_path / "x.npz")
    assert npz.duration_s == pytest.approx(19 / 25)
    blocks = list(npz.messages())
    assert np.array_equal(np.concatenate([b.level for b in blocks]), level)
    assert np.concatenate([b.frame_pts_ns for b in blocks]).tolist() == [
        round(t * 1e9) for t in time_s
    ]
    assert {b.read_out_axis for b in blocks} == {"rows"}


def test_frame_means_of_an_npz(tmp_path: Path) -> None:
    np.savez(tmp_path / "x.npz", luminance=np.arange(30), frame_rate_hz=30000 / 1001)
    blocks = list(open_input_file(tmp_path / "x.npz").messages())
    assert np.concatenate([b.level for b in blocks])[:, 0, 0].tolist() == list(range(30))
    assert {(b.rows, b.strips, b.read_out_axis) for b in blocks} == {(1, 1, "frame")}
    assert blocks[0].frame_pts_ns[3] == 100_100_000


def test_rows_without_strips(tmp_path: Path) -> None:
    np.savez(tmp_path / "x.npz", rows=np.ones((9, 6)), frame_time_s=np.arange(9) / 25)
    assert next(iter(open_input_file(tmp_path / "x.npz").messages())).level.shape == (8, 6, 1)


def test_an_npz_says_what_it_needs(tmp_path: Path) -> None:
    np.savez(tmp_path / "x.npz", luminance=np.ones(9))
    with pytest.raises(InputError, match=r"x\.npz holds luminance") as refused:
        read_npz(tmp_path / "x.npz", "file/x")
    assert "with 'frame_rate_hz'" in refused.value.hint


def test_rows_without_times_are_counted_at_a_rate(tmp_path: Path) -> None:
    rows = np.random.default_rng(5).normal(100.0, 1.0, (32, 6, 2))
    np.savez(tmp_path / "bare.npz", rows=rows)
    with pytest.raises(InputError, match="holds rows"):
        open_input_file(tmp_path / "bare.npz")
    blocks = list(open_input_file(tmp_path / "bare.npz", frame_rate_hz=23.5).messages())
    assert blocks[-1].frame_pts_ns[-1] == pytest.approx(31e9 / 23.5, abs=1)
    assert {block.header.rate_basis for block in blocks} == {"given"}
    np.savez(tmp_path / "means.npz", luminance=rows[:, 0, 0], frame_rate_hz=30.0)
    for given_hz, rate_hz, basis in ((None, 30.0, "declared"), (25.0, 25.0, "given")):
        (*_, last) = open_input_file(tmp_path / "means.npz", frame_rate_hz=given_hz).messages()
        assert last.frame_pts_ns[-1] == pytest.approx(31e9 / rate_hz, abs=1)
        assert last.header.rate_basis == basis


def test_times_that_stand_are_not_counted_anew(tmp_path: Path) -> None:
    np.savez(tmp_path / "x.npz", rows=np.ones((9, 4)), frame_time_s=np.arange(9) / 30)
    (block,) = itertools.islice(open_input_file(tmp_path / "x.npz").messages(), 1)
    assert block.header.rate_basis == ""
    for path in (tmp_path / "x.npz", recorded(tmp_path / "x.mcap", some_blocks("door", 1))):
        with pytest.raises(UsageError, match="frame times of its own"):
            open_input_file(path, frame_rate_hz=25.0)

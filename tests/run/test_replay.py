"""A player: what it plays, when, under which names and epochs, and what it does when told."""

from __future__ import annotations

import dataclasses
import os
import threading
import time
from collections import Counter
from io import BytesIO
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from conftest import Film
from mcap.opcode import Opcode
from replay_samples import (
    TRACK,
    blocks,
    data,
    hashes,
    in_one_process,
    places,
    played,
    player,
    record,
)

from rsenf.errors import InputError, UsageError
from rsenf.messages import canonical
from rsenf.record import Recorder, container
from rsenf.record.reader import open_recording
from rsenf.run.inputs import open_input_file
from rsenf.run.process import wait_until
from rsenf.run.replay.control import Control, Pace, keyboard, obey
from rsenf.run.replay.player import Replayed
from rsenf.run.runner import Runner
from rsenf.track import make_tracker
from tests.decode.decode_clips import make_clip
from tests.in_time import in_time

BEGIN = ("frames", "rows", "track")


@pytest.fixture(scope="module")
def recorded(short_film: Film, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record(short_film, tmp_path_factory.mktemp("replay") / "film.mcap")


def of(path: Path, topic: str) -> list[Any]:
    return [
        message
        for key, message, _ in open_recording(path).messages()
        if key.endswith(topic) and not message.header.is_end
    ]


@pytest.mark.parametrize("begin", BEGIN)
@pytest.mark.parametrize("rate", [0.0, 1.0, 10.0])
def test_equal_results_from_every_topic_at_every_speed(
    recorded: Path, short_film: Film, begin: str, rate: float
) -> None:
    of_film = in_one_process(open_input_file(short_film.video, source="lab/cam"), short_film)
    begun = time.monotonic()
    again = in_one_process(Replayed(open_recording(recorded), begin=begin, rate=rate), short_film)
    took_s = time.monotonic() - begun
    assert again == {topic: of_film[topic] for topic in again}
    assert {"track", "match"} <= set(again)
    assert took_s > 2.0 / rate if rate else True


def test_all_topics_come_back_as_they_were_recorded(recorded: Path) -> None:
    items = played(recorded)
    for topic, messages in data(items).items():
        assert [canonical(m) for m in messages] == [canonical(m) for m in of(recorded, topic)]
    assert {key.split("/")[-1] for key, _ in items} == {
        "ce", "video", "rows", "track", "match", "idle"
    }  # fmt: skip
    assert {m.header.run_id for _, m in items} == {"new"}
    ends = [key for key, m in items if m.header.is_end]
    assert len(ends) == len(set(ends)) == 6
    assert [key for key, _ in items[-6:]] == ends


def test_frames_are_those_that_were_recorded_with_their_pixels(
    recorded: Path, short_film: Film
) -> None:
    frames = data(played(recorded, topics=("cam/frames",)))["cam/frames"]
    assert [canonical(m) for m in frames] == [canonical(m) for m in of(recorded, "frames")]
    filmed = open_input_file(short_film.video).messages()
    assert all((a.luma == b.luma).all() for a, b in zip(frames, filmed, strict=True))


@pytest.fixture(scope="module")
def avi(short_film: Film, tmp_path_factory: pytest.TempPathFactory) -> tuple[Film, Path]:
    """The film with B frames in a container that has no times for them; and a recording of it."""
    folder = tmp_path_factory.mktemp("avi")
    lumas = [frame.luma for frame in open_input_file(short_film.video).messages()]
    video = make_clip(
        folder / "film.avi", lumas, options={"qp": "20", "bf": "3", "b_strategy": "0"}
    )
    film = dataclasses.replace(short_film, video=video)
    return film, record(film, folder / "film.mcap")


def test_frames_of_an_avi_have_their_times_though_its_packets_have_none(
    avi: tuple[Film, Path],
) -> None:
    film, path = avi
    assert all(packet.untimed for packet in of(path, "video"))
    frames = data(played(path, topics=("cam/frames",)))["cam/frames"]
    assert [canonical(m) for m in frames] == [canonical(m) for m in of(path, "frames")]
    filmed = open_input_file(film.video).messages()
    assert all((a.luma == b.luma).all() for a, b in zip(frames, filmed, strict=True))


def test_frames_whose_times_are_of_decoding_are_not_played(
    avi: tuple[Film, Path], tmp_path: Path
) -> None:
    """A version of rsenf once recorded AVI without saying so."""
    path = tmp_path / "once.mcap"
    with Recorder(path, run_info={"run_id": "r"}, clock_ns=time.time_ns) as recorder:
        for packet in of(avi[1], "video"):
            recorder.write("rsenf/lab/cam/video", dataclasses.replace(packet, untimed=False))
    with pytest.raises(InputError, match="without the times of its pictures"):
        played(path, topics=("cam/frames",))


def test_a_part_of_it(recorded: Path) -> None:
    topics = ("cam/rows", "cam/frames", "reference/ce")
    part = data(played(recorded, topics=topics, start_s=1.0, end_s=2.0))
    frames, rows = part["cam/frames"], part["cam/rows"]
    assert [f.header.pts_ns for f in frames] == [
        f.header.pts_ns for f in of(recorded, "frames") if 1.0 <= f.header.pts_ns / 1e9 < 2.0
    ]
    assert 1.0 <= rows[0].header.pts_ns / 1e9 < rows[-1].header.pts_ns / 1e9 < 2.0
    assert places(frames) == [(0, n) for n in range(len(frames))]  # numbered from 0
    assert places(rows) == [(0, n) for n in range(len(rows))]
    # Whatever part it is, there is the whole reference.
    assert sum(b.samples for b in part["reference/ce"]) == 1200
    whole = {f.header.pts_ns: f.luma for f in data(played(recorded, topics=topics))["cam/frames"]}
    assert all((f.luma == whole[f.header.pts_ns]).all() for f in frames)


@pytest.mark.parametrize(
    ("playing", "words"),
    [
        ({"start_s": 99.0}, "ends before 99 s"),
        ({"start_s": 2.0, "end_s": 1.0}, "nothing lies between 2 s and 1 s"),
        ({"topics": ("cam/live",)}, "nothing to play as 'cam/live'"),
        ({"topics": ("*/rows",), "rename": {"door": "yard"}}, "'door' isn't played"),
        ({"rename": {"cam/rows": "cam/track"}}, "another message"),
        ({"rename": {"cam/rows": "@nodes/rows"}, "site": "a b"}, "no name"),
        ({"rename": {"cam": "a/b"}}, "'rsenf/lab/a/b/.*' is no name for a topic"),
        ({"rename": {"cam/rows": "rows"}}, "'rsenf/lab/rows' is no name for a topic"),
    ],
)
def test_what_cant_be_played(recorded: Path, playing: dict[str, Any], words: str) -> None:
    with pytest.raises(UsageError, match=words):
        played(recorded, **playing)


def test_other_names(recorded: Path) -> None:
    rename = {"cam": "door", "cam/track": "yard/track", "reference/ce": "reference/gb"}
    items = played(recorded, rename=rename, site="home")
    sources = {key: message.header.source for key, message in items}
    assert sources == {
        "rsenf/home/reference/gb": "reference/gb",
        "rsenf/home/yard/track": "home/yard",
        **{f"rsenf/home/door/{topic}": "home/door" for topic in ("video", "rows", "match", "idle")},
    }
    assert {m.grid for key, m in items if key.endswith("gb")} <= {"gb"}


def test_a_loop_is_another_epoch_on_every_topic(recorded: Path, short_film: Film) -> None:
    items = played(recorded, topics=("cam/rows", "cam/track", "reference/ce"), loop=3)
    looped = data(items)
    for topic in ("cam/rows", "cam/track"):
        once = of(recorded, topic)
        assert places(looped[topic]) == [(e, n) for e in range(3) for n in range(len(once))]
    assert len(looped["reference/ce"]) == len(blocks(short_film))  # once is enough
    assert sum(m.header.is_end for _, m in items) == 3


def test_no_stage_mixes_two_passes(recorded: Path) -> None:
    runner = Runner("track", lambda: make_tracker(TRACK))
    out = [
        dataclasses.replace(e, header=dataclasses.replace(e.header, epoch=0))
        for _, block in played(recorded, topics=("cam/rows",), loop=2)
        for e in runner.feed(block)
        if not e.header.is_end
    ]
    once = of(recorded, "track")
    assert hashes({"track": out[: len(once)]}) == hashes({"track": once})
    assert hashes({"track": out[len(once) :]}) == hashes({"track": once})


class Told:
    """Yields the next message of a player that plays in a thread, as far as it lets them pass."""

    def __init__(self, path: Path, control: Control, **playing: Any) -> None:
        self.seen: list[Any] = []
        self._thread = threading.Thread(target=self._play, args=(path, control, playing))
        self._control = control
        self._thread.start()

    def _play(self, path: Path, control: Control, playing: dict[str, Any]) -> None:
        for _, message in player(path, control, **playing):
            self.seen.append(message)

    def settled(self, least: int) -> int:
        """How many messages have passed, once so many have and no more do."""
        assert wait_until(lambda: len(self.seen) >= least)
        count = -1
        while count != len(self.seen):
            count = len(self.seen)
            time.sleep(0.3)
        return count

    def stop(self) -> None:
        self._control.stop.set()
        assert wait_until(lambda: not self._thread.is_alive())


def test_keys_pause_step_seek_and_end(recorded: Path) -> None:
    """Keys from a script: a pause before anything has passed, three steps, and so on."""
    control = Control()
    obey(" ", control)
    told = Told(recorded, control, topics=("cam/rows",), rate=1.0)
    assert told.settled(0) == 0
    obey("..", control)
    assert told.settled(2) == 2
    obey([".", "\x1b[D", "."], control)
    assert told.settled(3) in (3, 4)  # a step was overtaken by the seek, or wasn't
    obey([" "], control)  # goes on
    while told.seen[-1].header.epoch == 0:
        time.sleep(0.05)
    again = next(m for m in told.seen if m.header.epoch == 1)
    assert (again.header.seq, again.header.pts_ns) == (0, 0)
    obey(["\x1b[C"], control)  # beyond the end: it ends
    assert wait_until(lambda: not told._thread.is_alive())
    assert told.seen[-1].header.is_end
    assert all(b.header.seq == a.header.seq + 1 for a, b in pairwise(told.seen) if
               a.header.epoch == b.header.epoch)  # fmt: skip
    told.stop()


def test_a_seek_lands_where_it_should(recorded: Path) -> None:
    control, seen = Control(), []
    for _, message in player(recorded, control, topics=("cam/frames",)):
        seen.append(message)
        if len(seen) == 31:  # at second 1 of 3: another one back or forth
            control.seek(1.0)
    first = next(m for m in seen if m.header.epoch == 1)
    assert first.header.pts_ns / 1e9 == pytest.approx(2.0, abs=0.04)
    assert first.header.seq == 0
    assert len(seen) == 31 + 30 + 1


def test_seeks_add_up_whatever_was_played_between(recorded: Path) -> None:
    """The video before a place, from its key frame on, isn't the place."""
    control = Control()
    playing = player(recorded, control, topics=("cam/video", "cam/rows"))
    landed = []
    for number, _ in enumerate(playing):
        landed.append(playing.position_s)
        if number in (10, 11, 12):
            control.seek(0.7)
    assert landed[11] == pytest.approx(landed[10] + 0.7, abs=1e-6)
    assert landed[12] == pytest.approx(landed[10] + 1.4, abs=1e-6)
    assert landed[13] == pytest.approx(landed[10] + 2.1, abs=1e-6)
    assert landed[13:] == sorted(landed[13:])


def test_what_leads_up_to_a_place_is_not_paced(recorded: Path) -> None:
    """At a rate at which half a second takes hours."""
    control, playing = Control(), {"topics": ("cam/video",), "rate": 1e-4, "start_s": 0.5}
    told = Told(recorded, control, **playing)
    told.settled(2)
    told.stop()
    seen = [m for m in told.seen if not m.header.is_end]
    assert seen[0].keyframe
    assert seen[0].header.pts_ns < 0.4e9 < 0.45e9 < seen[-1].header.pts_ns < 0.6e9


def test_references_come_first_and_whole_however_soon_one_seeks(recorded: Path) -> None:
    whole = of(recorded, "ce")
    for sought_at in range(3):
        control, keys = Control(), []
        for key, _ in player(recorded, control, topics=("cam/video", "reference/ce"), start_s=1.0):
            keys.append(key.split("/")[3])
            if len(keys) == sought_at:
                control.seek(0.5)
        assert keys[: len(whole)] == ["ce"] * len(whole)
        assert keys.count("ce") == len(whole) + 1  # its end


@pytest.fixture(scope="module")
def overlapping(recorded: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three passes of a recording, played and recorded faster than they were filmed."""
    path = tmp_path_factory.mktemp("overlapping") / "loop.mcap"
    with Recorder(path, run_info={"run_id": "r"}, clock_ns=lambda: 0) as recorder:
        for key, message in played(recorded, topics=("cam/rows", "cam/video"), loop=3):
            arrival_ns = 10**18 + message.header.epoch * 10**7
            header = dataclasses.replace(message.header, arrival_time_ns=arrival_ns)
            recorder.write(key, dataclasses.replace(message, header=header))
    return path


@pytest.mark.parametrize("topic", ["rows", "video", "frames"])
def test_a_part_is_that_part_of_every_pass(recorded: Path, overlapping: Path, topic: str) -> None:
    for part in ({"end_s": 0.9}, {"start_s": 2.5}, {"start_s": 0.2, "end_s": 0.5}):
        once = data(played(recorded, topics=(f"cam/{topic}",), **part))[f"cam/{topic}"]
        passes = data(played(overlapping, topics=(f"cam/{topic}",), **part))[f"cam/{topic}"]
        per_pass = Counter(m.header.epoch for m in passes)
        assert list(per_pass) == [0, 1, 2]
        # Each lies a hundredth of a second later than the one before.
        assert all(abs(n - len(once)) <= 1 for n in per_pass.values())


def test_a_part_that_ends_early_costs_no_reading_of_the_rest(
    recorded: Path, tmp_path: Path
) -> None:
    last = list(container.walk(BytesIO(recorded.read_bytes()), 8, recorded.stat().st_size - 8))
    chunk = [record for record in last if record.opcode == Opcode.CHUNK][-1]
    content = bytearray(recorded.read_bytes())
    content[(chunk.start + chunk.end) // 2] ^= 0xFF
    (tmp_path / "bad.mcap").write_bytes(content)
    playing = {"topics": ("cam/rows",)}
    for end_s, is_met in ((0.3, False), (None, True)):
        some = player(tmp_path / "bad.mcap", None, end_s=end_s, **playing)
        assert list(some)
        assert bool(some.loss) == is_met


def test_the_pace_begins_anew_where_time_goes_back(monkeypatch: pytest.MonkeyPatch) -> None:
    now_s = 0.0
    monkeypatch.setattr("rsenf.run.replay.control.time.monotonic", lambda: now_s)
    pace = Pace(1.0)
    assert [pace.left_s(s * 10**9) for s in (0, 40)] == [0.0, 40.0]
    now_s = 40.0
    assert [pace.left_s(s * 10**9) for s in (40, 39, 1, 41)] == [0.0, -1.0, 0.0, 40.0]


def test_quitting_ends_every_stream(recorded: Path) -> None:
    control, seen = Control(), []
    for _, message in player(recorded, control, topics=("cam/rows", "cam/track"), loop=0):
        seen.append(message)
        if len(seen) == 40:
            obey("q", control)
    assert len(seen) == 42
    assert [m.header.is_end for m in seen[-2:]] == [True, True]


def test_a_terminal_has_its_keys_and_gets_its_settings_back() -> None:
    import termios

    ours, terminal = os.openpty()
    before, control = termios.tcgetattr(terminal), Control()
    with keyboard(terminal, control):
        os.write(ours, b" \x1b[C")
        by_s = None
        while by_s is None:
            by_s = control.sought_s()
        assert (control.paused, by_s) == (True, 10.0)
    assert termios.tcgetattr(terminal) == before


def test_rate_10_takes_a_tenth_of_the_time(recorded: Path) -> None:
    times = []
    for _, _ in player(recorded, None, topics=("cam/rows",), rate=10.0):
        times.append(time.monotonic())
    assert times[-1] - times[0] > 0.2
    assert in_time(times[-1] - times[0], 2.0)
    assert in_time(max(b - a for a, b in pairwise(times)), 1.0)


@pytest.fixture
def cut(recorded: Path, tmp_path: Path) -> Path:
    """The same recording, broken off."""
    path = tmp_path / "cut.mcap"
    whole = recorded.read_bytes()
    path.write_bytes(whole[: len(whole) * 2 // 3])
    return path


@pytest.mark.parametrize("begin", BEGIN[:2])
def test_a_truncated_recording_is_played_up_to_where_it_is_whole(
    recorded: Path, cut: Path, begin: str
) -> None:
    recording = Replayed(open_recording(cut), begin=begin)
    whole = [canonical(m) for m in Replayed(open_recording(recorded), begin=begin).messages()]
    there = [canonical(m) for m in recording.messages()]
    assert 0 < len(there) < len(whole)
    assert there == whole[: len(there)]
    assert recording.loss.startswith("the recording is cut short")
    assert "played up to " in recording.loss


def test_a_damaged_chunk_costs_pictures_up_to_the_next_key_frame(
    recorded: Path, tmp_path: Path
) -> None:
    """What a decoder would make of a gap is never taken for what was filmed."""
    content = bytearray(recorded.read_bytes())
    content[len(content) // 2] ^= 0xFF
    (tmp_path / "bad.mcap").write_bytes(content)
    recording = Replayed(open_recording(tmp_path / "bad.mcap"), begin="frames")
    whole = {m.header.seq: m for m in Replayed(open_recording(recorded), begin="frames").messages()}
    there = list(recording.messages())
    assert 0 < len(there) < len(whole)
    for frame in there:
        assert (frame.luma == whole[frame.header.seq].luma).all()
        assert frame.header.pts_ns == whole[frame.header.seq].header.pts_ns
    assert "damaged parts, left out: " in recording.loss


def test_what_a_recording_lacks_is_said(recorded: Path, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="no estimates of camera 'roof'"):
        Replayed(open_recording(recorded), "roof", "track")
    (tmp_path / "no.mcap").write_bytes(b"no")
    with pytest.raises(InputError):
        open_input_file(tmp_path / "no.mcap", begin="track")

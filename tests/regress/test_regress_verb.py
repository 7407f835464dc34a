"""The verb: exit codes, its JSON, and recordings that it can say little or nothing of."""

from __future__ import annotations

import dataclasses
import json
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from rsenf.bus.keys import health_key
from rsenf.cli import main
from rsenf.config import Graph, shown
from rsenf.config.load import with_replayed
from rsenf.errors import EXIT_DONE, EXIT_FAILED, EXIT_LOSS, EXIT_USAGE
from rsenf.idle import estimator_state as idle_state
from rsenf.messages import (
    EnfEstimate,
    Header,
    Health,
    Liveness,
    ReferenceBlock,
    RowBlock,
    VideoPacket,
)
from rsenf.record import Recorder, open_recording
from rsenf.record.growing import ABOUT
from rsenf.record.provenance import program_facts
from rsenf.regress import regress, rerun
from rsenf.regress.plan import History, changed_since, steps_of
from rsenf.regress.rerun import LATE, Pictures
from rsenf.timebase import NS_PER_S
from tests.golden.make import BEGINS_NS, FOLDER
from tests.live.live_feeds import AHEAD_S, Camera, reference
from tests.record.record_samples import sample_file

GOLDEN = FOLDER / "weak_cfl.mcap"
CAMERA = "rsenf/golden/cam"
Told = Callable[..., tuple[int, str, str]]


@pytest.fixture
def told(capsys: pytest.CaptureFixture[str]) -> Told:
    def run(*words: object) -> tuple[int, str, str]:
        code = main(["regress", *map(str, words)])
        out = capsys.readouterr()
        return code, out.out, out.err

    return run


def part_of(
    path: Path,
    keep: Callable[[str, Any], bool],
    change: Callable[[str, Any], Any] = lambda _, message: message,
    **told: str,
) -> Path:
    """Record those messages of a golden recording anew that are to be kept, changed or not.

    What made their values is what made the golden, wherever that was.
    """
    source = open_recording(GOLDEN)
    about = {**source.metadata[ABOUT], **told}
    with Recorder(path, run_info=about, clock_ns=lambda: BEGINS_NS) as recorder:
        for topic, message, _ in source.messages():
            if keep(topic, message):
                recorder.write(topic, change(topic, message))
    return path


def test_as_it_was(told: Told) -> None:
    code, out, _ = told(GOLDEN, "--json")
    assert code == EXIT_DONE
    found = json.loads(out)
    assert found["passed"] is True
    assert [t["stage"] for t in found["topics"]] == ["rows", "track", "idle", "match"]
    for topic in found["topics"]:
        assert topic["topic"] == f"{CAMERA}/{topic['stage']}"
        assert topic["messages"] > 0
        assert (topic["differing"], topic["max_abs_diff"], topic["since"]) == (0, 0.0, None)


def test_moved(told: Told, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(idle_state, "NORMAL_STDS", 2.1)
    path = FOLDER / "still_2997.mcap"
    code, out, _ = told(path)
    assert code == EXIT_FAILED
    assert out.startswith(f"{path}: moved, and first in idle\n")
    assert "idle_ratio_low by up to " in out
    assert "    since message " in out


def test_misuse(told: Told, tmp_path: Path) -> None:
    assert told()[0] == EXIT_USAGE
    assert told(GOLDEN, "--accept")[0] == EXIT_USAGE
    assert told(GOLDEN, "--reason", "none")[0] == EXIT_USAGE
    assert told(GOLDEN, "--accept", "--reason", " ")[0] == EXIT_USAGE
    code, _, err = told(tmp_path / "none.mcap")
    assert (code, err.count("\n")) == (EXIT_USAGE, 1)


def test_a_recording_without_its_graph(told: Told, tmp_path: Path) -> None:
    path = tmp_path / "bare.mcap"
    sample_file(path, seconds=1)
    code, out, err = told(path)
    assert (code, out, err.count("\n")) == (EXIT_FAILED, "", 1)
    assert "with which settings" in err


def test_accept_of_what_moved_wants_all_of_it(
    told: Told, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = part_of(tmp_path / "cut.mcap", lambda _, message: not message.header.is_end)
    monkeypatch.setattr("rsenf.rows.stage.WHITE_LEVEL", 20.0)
    before = path.read_bytes()
    code, _, err = told(path, "--accept", "--reason", "brighter")
    assert code == EXIT_FAILED
    assert "not whole" in err
    assert path.read_bytes() == before


def test_rows_without_video_are_left_out(told: Told, tmp_path: Path) -> None:
    path = part_of(tmp_path / "rows.mcap", lambda topic, _: not topic.endswith("/video"))
    code, out, _ = told(path, "--json")
    assert code == EXIT_DONE
    found = json.loads(out)
    assert [t["stage"] for t in found["topics"]] == ["track", "idle", "match"]
    (whole,) = found["recordings"]
    assert whole["left_out"] == {f"{CAMERA}/rows": f"{CAMERA}/video was not recorded"}


def test_only_video_is_nothing_to_compare(told: Told, tmp_path: Path) -> None:
    path = part_of(tmp_path / "video.mcap", lambda topic, _: topic.endswith("/video"))
    code, _, err = told(path)
    assert code == EXIT_FAILED
    assert "no stage can be run again" in err


def test_a_file_that_broke_off_is_judged_as_far_as_it_goes(told: Told, tmp_path: Path) -> None:
    path = tmp_path / "cut.mcap"

    def before(_: str, message: Any) -> bool:
        header: Header = message.header
        return header.source.startswith("reference") or (
            not header.is_end and header.pts_ns < 20_000_000_000
        )

    part_of(path, before)
    code, out, _ = told(path)
    assert code == EXIT_LOSS
    assert "as it was" in out
    assert "not judged to its end: the recording ends before this stage did" in out
    assert told(path, "--accept", "--reason", "nothing has moved")[0] == EXIT_LOSS


def test_blocks_that_are_missing_blame_nobody(tmp_path: Path) -> None:
    def keep(_: str, message: Any) -> bool:
        return not (isinstance(message, RowBlock) and message.header.seq == 40)

    result = regress(part_of(tmp_path / "gap.mcap", keep))
    for topic in result.topics:
        if topic.stage in ("track", "idle"):
            assert "rows lacks messages 40 to 40" in topic.unjudged
        assert topic.passed
    assert "rows lacks messages 40 to 40" in result.topics[0].unjudged


def test_an_estimate_that_was_not_recorded_is_no_difference(tmp_path: Path) -> None:
    def keep(_: str, message: Any) -> bool:
        return not (isinstance(message, EnfEstimate) and message.header.seq == 5)

    result = regress(part_of(tmp_path / "less.mcap", keep))
    (track,) = (topic for topic in result.topics if topic.stage == "track")
    assert track.passed
    assert track.unjudged == "1 of its messages were not recorded"


def test_pictures_that_are_missing_are_not_the_rows_fault(tmp_path: Path) -> None:
    """From the second key frame on nothing can be decoded until the third."""
    source = open_recording(GOLDEN)
    packets = [m for _, m, _ in source.messages([f"{CAMERA}/video"])]
    keys = [m.header.seq for m in packets if m.keyframe]

    def keep(_: str, message: Any) -> bool:
        return not (isinstance(message, VideoPacket) and message.header.seq == keys[1])

    result = regress(part_of(tmp_path / "hole.mcap", keep))
    (rows, *others) = result.topics
    assert f"video lacks messages {keys[1]} to {keys[1]}" in rows.unjudged
    assert all(topic.passed for topic in (rows, *others))


@pytest.mark.parametrize("untimed", [True, False])
def test_a_video_that_has_times_of_decoding_only(
    told: Told, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, untimed: bool
) -> None:
    """As AVI has with B frames. A version that didn't say so blames nobody."""
    packets = [m for _, m, _ in open_recording(GOLDEN).messages([f"{CAMERA}/video"])][:-1]
    times_ns = dict(enumerate(sorted(packet.header.pts_ns for packet in packets)))

    def decoding(_: str, message: Any) -> Any:
        if not isinstance(message, VideoPacket) or message.header.is_end:
            return message
        header = dataclasses.replace(message.header, pts_ns=times_ns[message.header.seq])
        return dataclasses.replace(message, header=header, untimed=untimed)

    path = part_of(tmp_path / "avi.mcap", lambda *_: True, decoding)
    result = regress(path)
    assert [t.topic for t in result.topics if not t.passed] == []
    assert result.whole == untimed
    if not untimed:
        monkeypatch.setattr(idle_state, "NORMAL_STDS", 2.1)
        code, _, err = told(path, "--accept", "--reason", "none")
        assert (code, err.count("without the times of its pictures")) == (EXIT_FAILED, 1)


def test_what_was_played_is_not_asked_for(told: Told, tmp_path: Path) -> None:
    source = open_recording(GOLDEN)
    graph = Graph.model_validate(yaml.safe_load(source.metadata[ABOUT]["config"]))
    config = yaml.safe_dump(shown(with_replayed(graph, {"decode": "x.mcap"})))
    path = part_of(tmp_path / "played.mcap", lambda *_: True, config=config)
    code, out, _ = told(path, "--json")
    assert code == EXIT_DONE
    found = json.loads(out)
    assert [t["stage"] for t in found["topics"]] == ["track", "idle", "match"]
    (whole,) = found["recordings"]
    assert whole["left_out"] == {f"{CAMERA}/rows": "it was played from x.mcap"}


def test_a_bad_file_does_not_silence_the_others(told: Told, tmp_path: Path) -> None:
    bad, bare = tmp_path / "bad.mcap", tmp_path / "bare.mcap"
    bad.write_bytes(b"no recording")
    sample_file(bare, seconds=1)
    code, out, err = told(bad, GOLDEN, bare)
    assert code == EXIT_FAILED
    assert out.startswith(f"{GOLDEN}: as it was")
    assert [line.split(":")[1] for line in err.splitlines()] == [f" {bad}", f" {bare}"]
    code, out, _ = told(bad, GOLDEN, "--json")
    found = json.loads(out)
    assert (code, found["passed"]) == (EXIT_FAILED, False)
    assert {t["recording"] for t in found["topics"]} == {str(GOLDEN)}
    first, second = found["recordings"]
    assert (first["passed"], second["passed"]) == (False, True)
    assert str(bad) in first["error"]
    assert second["error"] == ""


def test_one_that_cannot_be_accepted_leaves_the_others_their_turn(
    told: Told, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cut = part_of(tmp_path / "cut.mcap", lambda _, message: not message.header.is_end)
    whole = tmp_path / "whole.mcap"
    shutil.copy(FOLDER / "still_2997.mcap", whole)
    shutil.copy(cut, tmp_path / "before.mcap")
    monkeypatch.setattr("rsenf.rows.stage.WHITE_LEVEL", 20.0)
    code, _, err = told(cut, whole, "--accept", "--reason", "brighter")
    assert code == EXIT_FAILED
    assert "not whole" in err
    assert cut.read_bytes() == (tmp_path / "before.mcap").read_bytes()
    assert regress(whole).passed


def never_ended(path: Path) -> Path:
    """Record a camera whose decode node was killed: its video has no END mark, the rest has."""

    def keep(topic: str, message: Any) -> bool:
        return not (topic.endswith("/video") and message.header.is_end)

    return part_of(path, keep)


def test_a_killed_decode_moves_nothing(tmp_path: Path) -> None:
    """However many pictures the decoder holds back then: that depends on the processor, too."""
    result = regress(never_ended(tmp_path / "killed.mcap"))
    assert [t.topic for t in result.topics if not t.passed] == []
    assert result.whole


def test_what_a_killed_decode_made_is_recorded_anew_to_its_end(
    told: Told, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = never_ended(tmp_path / "killed.mcap")
    before = {name: topic.messages for name, topic in open_recording(path).topics.items()}
    monkeypatch.setattr("rsenf.rows.stage.WHITE_LEVEL", 20.0)
    assert told(path, "--accept", "--reason", "brighter")[0] == EXIT_DONE
    after = {name: topic.messages for name, topic in open_recording(path).topics.items()}
    assert after == before
    assert (regress(path).passed, regress(path).whole) == (True, True)


def test_accept_loses_no_frames_that_the_video_lacks(
    told: Told, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "less.mcap"
    shutil.copy(GOLDEN, path)
    before = path.read_bytes()
    monkeypatch.setattr(Pictures, "rest", lambda _: iter(()))
    code, _, err = told(path, "--accept", "--reason", "fewer")
    assert code == EXIT_FAILED
    assert "its video lacks frames" in err
    assert path.read_bytes() == before


def test_accept_leaves_what_has_not_moved(told: Told, tmp_path: Path) -> None:
    path = tmp_path / "same.mcap"
    shutil.copy(GOLDEN, path)
    code, _, err = told(path, "--accept", "--reason", "no need")
    assert (code, err) == (EXIT_DONE, "")
    assert path.read_bytes() == GOLDEN.read_bytes()


def test_what_was_cut_here_is_compared_as_what_it_was_cut_from(tmp_path: Path) -> None:
    path = part_of(tmp_path / "whole.mcap", lambda *_: True)
    assert regress(path).changed == regress(GOLDEN).changed


def test_bits_of_other_hosts_are_not_asked_for(tmp_path: Path) -> None:
    """The recorder knows its own processor, and each node's host from its health."""

    def recorded(host: str) -> Path:
        path = tmp_path / f"{host}.mcap"
        about = {**open_recording(GOLDEN).metadata[ABOUT], **program_facts(), "host": "recorder"}
        health = Health(header=Header(run_id="golden"), node="track", host=host)
        with Recorder(path, run_info=about, clock_ns=lambda: BEGINS_NS) as recorder:
            recorder.write(health_key("golden", "track"), health)
        return path

    assert changed_since(open_recording(recorded("recorder"))) == {}
    (told,) = changed_since(open_recording(recorded("other"))).items()
    assert told == ("host", ("other", program_facts()["host"]))


@pytest.mark.processes
def test_a_run_of_processes_is_what_its_stages_make_in_one(recording: Path) -> None:
    result = regress(recording)
    assert result.exact
    assert result.passed
    assert result.whole
    assert [t.stage for t in result.topics] == ["rows", "track"]


@pytest.mark.parametrize(
    ("late_s", "excused_s", "why"), [(1, 60, ""), (8, 60, LATE), (8, 0, "counts again later")]
)
def test_late_estimates_leave_what_live_said_unjudged(
    late_s: int, excused_s: int, why: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The recorder may get a late estimate before rows that ``live`` got first."""
    feed = Camera()

    def messages(until: int) -> Iterator[Any]:
        """All of 60 s; estimates from second 10 on come only with that of the rows."""
        yield reference()
        waiting: list[EnfEstimate] = []
        for second in range(60):
            yield feed.rows(second)
            if second >= AHEAD_S:
                waiting.append(feed.estimate(second - AHEAD_S, second))
            if not AHEAD_S + 10 <= second < until:
                yield from waiting
                waiting.clear()

    config = {
        "version": 1,
        "site": "lab",
        "nodes": {
            "made": {"kind": "external", "command": ["x"], "sends": ["cam/rows", "cam/track"]},
            "grid": {"kind": "reference", "grid": "ce", "input": "ce.csv"},
            "live": {
                "kind": "live",
                "cameras": ["cam"],
                "grid": "ce",
                "live": {"report_every_s": 1},
            },
        },
    }
    monkeypatch.setattr(rerun, "ABOUT_LATE_NS", excused_s * NS_PER_S)
    came = AHEAD_S + 10 + late_s
    step = next(step for step in steps_of(Graph.model_validate(config)) if step.stage == "live")
    live = step.make_runner(step.context(History()))
    path = tmp_path / "late.mcap"
    about = {"config": yaml.safe_dump(config), **program_facts()}
    topics = {RowBlock: "cam/rows", EnfEstimate: "cam/track", ReferenceBlock: "reference/ce"}
    with Recorder(path, run_info=about, clock_ns=lambda: BEGINS_NS) as recorder:
        for message in messages(came - 1):
            recorder.write(f"rsenf/lab/{topics[type(message)]}", message)
        for message in messages(came):
            for out in live.feed(message):
                if isinstance(out, Liveness):
                    recorder.write(step.topic, out)
    topic = next(topic for topic in regress(path).topics if topic.stage == "live")
    assert topic.passed == (excused_s > 0)
    assert topic.unjudged == (LATE if why == LATE else "the recording ends before this stage did")
    assert topic.messages > 0

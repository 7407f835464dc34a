"""The bench of the pipeline: films that go on, tables that say what the records say, a trial."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest

from rsenf.bench.pipeline import Film, Heard, Ran, Split, made, reference_of
from rsenf.bench.pipeline.feeds import RESULTS, _carried, _counts, _lateness_s, _measure_feeds
from rsenf.bench.pipeline.feeds import _tabulated as feeds_table
from rsenf.bench.pipeline.feeds import _text as feeds_text
from rsenf.bench.pipeline.table import (
    FFMPEG,
    LIVE,
    ONE,
    PYAV,
    SPLITS,
    _tabulated,
    _text,
    _time_it,
    _turns,
)
from rsenf.cli import main
from rsenf.messages import Header, Health
from rsenf.reference import open_reference
from tests.bench.bench_records import run_in

SHORT = Film("480p", "h264", frames=60, filmed=30)


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return made(SHORT, tmp_path_factory.mktemp("films"))


def test_a_film_is_played_over_and_over_with_times_that_go_on(short: Path) -> None:
    with av.open(str(short)) as container:
        stream = container.streams.video[0]
        times = [frame.time for frame in container.decode(stream)]
    np.testing.assert_allclose(np.diff(times), 1 / 30, atol=1e-4)
    assert len(times) == SHORT.frames


def test_what_was_filmed_is_filmed_once(short: Path) -> None:
    begun = (short.parent / SHORT.once).stat().st_mtime_ns
    longer = made(Film("480p", "h264", frames=90, filmed=30), short.parent)
    assert (short.parent / SHORT.once).stat().st_mtime_ns == begun
    assert longer.stat().st_size > 1.4 * short.stat().st_size


def test_the_flicker_goes_on_when_it_is_played_again() -> None:
    cycles = Film("480p", "h264", 3000).freq_hz.sum()
    assert cycles == pytest.approx(round(cycles), abs=1e-6)


def test_the_reference_is_the_grid_of_the_film(short: Path) -> None:
    reference = open_reference(str(reference_of(short)), timezone="UTC")
    expected = np.tile(SHORT.freq_hz, SHORT.frames // SHORT.filmed)
    np.testing.assert_allclose(np.asarray(reference.freq_hz), expected, atol=1e-6)


def test_everybody_has_a_turn_in_each_round() -> None:
    names = [contestant for _, contestant, _ in _turns([SHORT], 2).values()]
    assert names[-1] == LIVE
    half = (len(names) - 1) // 2
    assert names[:half] == names[half:-1]
    assert {PYAV, ONE, *SPLITS} <= set(names)


def test_a_turn_counts_its_frames(short: Path) -> None:
    bare, whole = (_time_it(name, SHORT, short) for name in (PYAV, ONE))
    assert bare["frames"] == whole["frames"] == SHORT.frames
    assert 0 < bare["cpu_s"] < whole["cpu_s"]


def test_frames_done_before_the_first_are_heard_of_do_not_count(
    short: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Blocks travel several at once: the first was made long before it came."""
    times_ms = {"rows": [1000.0, 1000.2, 1000.3, 1100.0], "track": [1000.1]}
    heard = [
        Heard(round(1e6 * ms), "bench/cam1", topic, Header(frame_last=8 * k + 7))
        for topic, of in times_ms.items()
        for k, ms in enumerate(of)
    ]
    ran = Ran(sorted(heard, key=lambda h: h.at_ns), last={"live": Health(time_ns=1_500_300_000)})
    ran.run_cpu_s = 2.0
    monkeypatch.setattr("rsenf.bench.pipeline.run_split", lambda *_: ran)
    timed = _time_it("fused", SHORT, short)
    assert (timed["frames"], timed["seconds"]) == (SHORT.frames - 24, pytest.approx(0.5))
    assert timed["cpu_s"] == timed["node_cpu_s"]["run"] == pytest.approx(2.0 * 36 / 60)


def _record(name: str, number: int, seconds: float, **more: Any) -> dict[str, Any]:
    return {
        "contestant": name, "size": "720p", "codec": "h264", "bitrate_bps": 2_000_000,
        "number": number, "frames": 1000, "seconds": seconds, "cpu_s": 2 * seconds,
        "peak_mb": 100.0, "others_ratio": 0.02, "cores": 2, "rsenf": "1", "lost": 0, **more,
    }  # fmt: skip


def test_the_ratio_is_that_of_each_round() -> None:
    # The machine is twice as slow in the second round: nothing of that is in the ratios.
    records = [
        _record(name, number, slow * seconds)
        for number, slow in enumerate((1.0, 2.0, 1.0))
        for name, seconds in ((FFMPEG, 9.0), (ONE, 10.0), ("fused, recorded", 12.0))
    ]
    rows = {row["contestant"]: row for row in _tabulated(records)["rows"]}
    assert rows[ONE]["rate_ratio"] == pytest.approx(0.9)
    assert rows[ONE]["cpu_ratio"] == pytest.approx(10 / 9)
    assert rows["fused, recorded"]["rate_ratio"] == pytest.approx(0.75)
    shown = _text(_tabulated(records))
    assert "median of the rounds" in shown.replace("\n", " ")


def test_a_profile_shows_what_each_node_takes_of_a_frame() -> None:
    spent = {"decode-cam1": 3.0, "track": 1.0, "run": 0.0}
    ran = _record("apart, recorded", 0, 9.0, node_cpu_s=spent, node_peak_mb={})
    shown = _text(_tabulated([_record(FFMPEG, 0, 9.0), ran]))
    assert f"{ran['size']} {ran['codec']}, apart, recorded: 4.0 ms of CPU a frame\n" in shown
    bars = re.findall(r"^ +([\w-]+) +([\d.]+) ?(█*)$", shown, re.MULTILINE)
    assert bars == [
        ("decode-cam1", "3.00", 30 * "█"), ("track", "1.00", 10 * "█"), ("run", "0.00", ""),
    ]  # fmt: skip


def test_without_ffmpeg_the_table_says_so() -> None:
    shown = _text(_tabulated([_record(PYAV, 0, 9.0), _record(ONE, 0, 10.0)]))
    assert "ffmpeg isn't here: compared with PyAV" in shown


def test_a_busy_machine_is_told() -> None:
    busy = [_record(FFMPEG, 0, 9.0), _record(ONE, 0, 8.0, others_ratio=0.6)]
    shown = _text(_tabulated(busy))
    assert "other programs took up to 60 % of the machine" in shown


def test_a_round_that_others_took_part_in_does_not_count_where_there_are_others() -> None:
    records = [
        _record(FFMPEG, 0, 9.0), _record(ONE, 0, 10.0),
        _record(FFMPEG, 1, 9.0, others_ratio=0.4), _record(ONE, 1, 6.0),
        _record(FFMPEG, 2, 9.0), _record(ONE, 2, 5.0, others_ratio=0.2),
    ]  # fmt: skip
    row = _tabulated(records)["rows"][1]
    assert (row["rounds"], row["disturbed"]) == (1, 2)
    assert row["rate_ratio"] == pytest.approx(0.9)
    shown = _text(_tabulated(records))
    assert "1 of 3" in shown
    assert "other programs took" not in shown.replace("\n", " ").split("medians of")[1]


def test_latencies_are_told_by_topic() -> None:
    late = _record(LIVE, 0, 1.0, latency_s={"rows": [0.1] * 99 + [0.9]})
    (row,) = _tabulated([late])["latency"]
    assert row["p50_s"] == pytest.approx(0.1)
    assert row["p99_s"] > 0.1
    assert "100 ms" in _text(_tabulated([late]))


def test_feeds_are_added_one_by_one_in_the_end() -> None:
    tried = _counts(6)
    assert [next(tried) for _ in range(6)] == [1, 2, 4, 6, 7, 8]


def test_a_feed_is_behind_its_own_speed() -> None:
    blocks = [
        Heard(10**9 + round(k * 1e8 * 1.5), "a/b", "rows", Header(pts_ns=round(k * 1e8)))
        for k in range(5)
    ]
    np.testing.assert_allclose(_lateness_s(blocks), [0, 0.05, 0.1, 0.15, 0.2], atol=1e-9)


def test_the_table_of_feeds_says_how_many_are_carried() -> None:
    def run(feeds: int, _carried: bool, **more: str) -> dict[str, Any]:
        return {
            **more,
            "size": "1080p", "codec": "h264", "bitrate_bps": 4_000_000, "feeds": feeds,
            "seconds": 10.0, "cores": 2, "others_ratio": 0.02, "cpu_s": 2.0 * feeds, "lost": 0,
            "node_peak_mb": {"decode-cam1": 100.0, "run": 50.0}, "late_p50_s": 0.01,
            "late_p99_s": 0.02, "carried": _carried,
        }  # fmt: skip

    fast = [run(11, True, effort="fast"), run(12, False, effort="fast")]
    document = feeds_table([run(9, True), run(10, False, effort="full"), *fast])
    film = {"size": "1080p", "codec": "h264"}
    assert document["carried"] == [
        {**film, "effort": "full", "feeds": 9}, {**film, "effort": "fast", "feeds": 11},
    ]  # fmt: skip
    assert document["rows"][1]["processor_ratio"] == pytest.approx(1.0)
    shown = feeds_text(document)
    assert "9 feeds of 1080p are carried with effort full; 11 feeds of 1080p" in shown
    assert len(re.findall(r"^.*1080p.* fast .*$", shown, re.MULTILINE)) >= 2


def test_feeds_that_others_disturbed_are_tried_again(tmp_path: Path) -> None:
    film = Film("1080p", "h264", 300)
    tried = [(1, 0, True, 0.0), (2, 0, False, 0.4), (2, 1, True, 0.0), (3, 0, False, 0.02)]
    with (tmp_path / RESULTS).open("w") as journal:
        for feeds, number, _carried, others in tried:
            record = {"key": f"{film.name} x{feeds} {number} v4", "feeds": feeds, "number": number,
                      "carried": _carried, "others_ratio": others}  # fmt: skip
            journal.write(json.dumps(record) + "\n")
    found = _measure_feeds(run_in(tmp_path), film, 1)
    assert [(r["feeds"], r["number"]) for r in found] == [(1, 0), (2, 1), (3, 0)]


def test_a_graph_of_feeds_has_one_process_for_what_they_share() -> None:
    graph: Any = Split(cameras=3, frames="fused").graph(Path("film.mp4"), Path("out.mcap"))
    kinds = [node["kind"] for node in graph["nodes"].values()]
    assert kinds.count("decode") == 3
    assert sorted(set(kinds)) == ["decode", "live", "record", "reference", "track"]
    assert graph["nodes"]["track"]["idle"] == {}
    assert all(kinds.count(kind) == 1 for kind in set(kinds) - {"decode"})


@pytest.mark.processes
def test_feeds_run_as_a_graph_that_loses_nothing(short: Path) -> None:
    record = _carried(SHORT, 2, "full", short.parent)
    assert record["lost"] == 0
    assert {"decode-cam1", "decode-cam2", "track", "live", "record", "run"} <= set(
        record["node_peak_mb"]
    )
    assert record["cpu_s"] > 0


def test_what_there_are_no_films_of_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "feeds", "--sizes", "8640p"]) == 2
    assert "no size" in capsys.readouterr().err

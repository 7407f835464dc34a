"""The blind benchmark on a foreign camera: what it draws, how it judges, and that it runs."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from rsenf.bench import CAMERA
from rsenf.bench.discover import CasePlan, Hidden
from rsenf.bench.discover.foreign import NEEDED, _sizes, hideable, tried
from rsenf.bench.discover.judge import (
    _closed,
    _judged,
    judged_description,
    parameter_errors,
    recorded,
)
from rsenf.bench.discover.table import _tabulated, _text
from rsenf.bench.foreign import camera_at
from rsenf.errors import UsageError

PATH = Path(__file__).resolve().parents[2] / CAMERA
LIKE = {"gamma": ("harmonics",), "frame_drop": (), "knee": ("gamma",), "burst_lines": ()}


def _told(verdict: str, *named: str) -> dict[str, Any]:
    effects = [
        {"name": None, "class": name.split("|")} if "|" in name else {"name": name, "class": []}
        for name in named
    ]
    return {"verdict": verdict, "effects": effects}


@pytest.mark.parametrize(
    ("kind", "hidden", "told", "outcome", "wrong"),
    [
        ("none", "", _told("no_discrepancy"), "right", 0),
        ("none", "", _told("explained", "harmonics"), "right", 0),
        ("none", "", _told("explained", "gamma|harmonics"), "right", 0),
        ("none", "", _told("unexplained", "harmonics"), "a rest", 0),
        ("none", "", _told("unexplained", "gamma"), "wrong", 1),
        ("none", "", _told("refused"), "missed", 0),
        ("one", "frame_drop", _told("explained", "harmonics", "frame_drop"), "right", 0),
        ("one", "frame_drop", _told("explained", "frame_drop|capture_jitter"), "right", 0),
        ("one", "frame_drop", _told("unexplained", "frame_drop"), "right, and a rest", 0),
        ("one", "frame_drop", _told("explained", "frame_drop", "pwm_tone"), "wrong", 1),
        ("one", "frame_drop", _told("unexplained", "harmonics"), "missed", 0),
        ("one", "gamma", _told("explained", "harmonics"), "right", 0),
        ("pair", "gamma frame_drop", _told("explained", "frame_drop", "gamma"), "right", 0),
        ("pair", "gamma frame_drop", _told("unexplained", "frame_drop", "gamma"),
         "right, and a rest", 0),
        ("pair", "gamma frame_drop", _told("explained", "frame_drop"), "half", 0),
        ("pair", "gamma frame_drop", _told("explained", "frame_drop|gamma"), "half", 0),
        ("pair", "gamma frame_drop", _told("unexplained"), "missed", 0),
        ("unknown", "knee", _told("unexplained", "harmonics"), "right", 0),
        ("unknown", "knee", _told("unexplained", "harmonics", "pwm_tone"), "right", 1),
        ("unknown", "knee", _told("explained", "gamma"), "right", 0),
        ("unknown", "knee", _told("explained", "gamma", "pwm_tone"), "wrong", 1),
        ("unknown", "knee", _told("explained", "harmonics"), "missed", 0),
        ("unknown", "burst_lines", _told("no_discrepancy"), "missed", 0),
    ],
)  # fmt: skip
def test_an_answer_is_judged(
    kind: str, hidden: str, told: dict[str, Any], outcome: str, wrong: int
) -> None:
    judgement = _judged(kind, {name: LIKE[name] for name in hidden.split()}, told, ("harmonics",))
    assert (judgement["outcome"], len(judgement["wrong_names"])) == (outcome, wrong)


FAN = {"place": ["light"], "form": "periodic", "hz": 4.0, "size_ratio": 0.01}
WALL = {**FAN, "place": ["added_light"], "rows": [0.2, 0.6]}
MIST = {"place": ["gain"], "form": "drifting band", "speed_per_s": 0.05, "size_ratio": None}
CLOCK = {"place": [], "form": "clock", "size_ratio": None}
CYCLE = {"place": ["light"], "form": "event", "at_s": [3.0], "size_ratio": None}
BAND = {"tone_hz": 4.0, "top_ratio": 0.22, "bottom_ratio": 0.57}


def _described(*named: str, size: float = 0.01, **parameters: Any) -> dict[str, Any]:
    told = _told("explained", *named)
    for effect in told["effects"]:
        effect.update(parameters=parameters or {"tone_hz": 4.0}, size=size)
    return told


@pytest.mark.parametrize(
    ("truth", "told", "outcome", "wrong"),
    [
        (FAN, _described("light_tone"), "right", 0),
        (FAN, _described("harmonics", "light_tone"), "right", 0),
        (FAN, _described("light_tone|interharmonic"), "right", 0),
        (FAN, _described("interharmonic|light_tone", flicker_hz=4.0, depth_ratio=0.01), "right", 0),
        (FAN, _described("interharmonic", flicker_hz=4.0, depth_ratio=0.02), "wrong", 1),
        (FAN, _described("light_tone", tone_hz=4.1), "wrong", 1),
        (FAN, _described("light_tone", size=0.02), "wrong", 1),
        (FAN, _described("gain_tone"), "wrong", 1),
        (FAN, _described("light_step", at_s=1.0), "wrong", 1),
        (FAN, _described("light_tone_band", **BAND), "wrong", 1),
        (FAN, _described(), "missed", 0),
        (FAN, {**_described("light_tone"), "verdict": "unexplained"}, "a rest", 0),
        (FAN, {**_described("gain_tone"), "verdict": "unexplained"}, "a rest", 1),
        (WALL, _described("added_light_tone_band", **BAND), "right", 0),
        (WALL, _described("added_light_tone_band", **BAND | {"top_ratio": 0.0}), "wrong", 1),
        (WALL, _described("added_light_tone"), "wrong", 1),
        (MIST, _described("gain_passing", speed_per_s=0.05), "right", 0),
        (MIST, _described("gain_tone"), "wrong", 1),
        (CYCLE, _described("light_tone"), "wrong", 1),
        (CLOCK, _described("harmonics"), "unseen", 0),
        (CLOCK, _described("light_tone"), "wrong", 1),
    ],
)
def test_a_description_is_judged(
    truth: dict[str, Any], told: dict[str, Any], outcome: str, wrong: int
) -> None:
    judgement = judged_description(truth, told, ("harmonics",))
    assert (judgement["outcome"], len(judgement["wrong_names"])) == (outcome, wrong)


def test_what_rows_do_not_show_is_no_right_description() -> None:
    told = {**_told("explained"), "gap": {}, "refused": "", "cpu_s": 1.0}
    records = [
        recorded(Hidden("physical", (name,), 3, 3.0, 60.0, rows=64), {name: ()}, {}, told)
        | {"outcome": outcome}
        for name, outcome in (("fan_shadow", "missed"), ("warming_clock", "unseen"))
    ]
    rows = {row["hidden"]: row for row in _tabulated(records)["rows"]}
    assert (rows["fan_shadow"]["named"], rows["warming_clock"]["named"]) == (0.0, None)
    assert (rows["physical programs"]["named"], rows["physical programs"]["cases"]) == (0.0, 2)


def test_a_pure_tone_has_no_harmonics_to_name() -> None:
    assert _judged("none", {}, _told("explained", "harmonics"), ())["outcome"] == "wrong"


def test_a_name_for_what_is_like_it_is_counted() -> None:
    hidden = {"gamma": ("harmonics",)}
    assert _judged("one", hidden, _told("explained", "harmonics"), ())["by_like"] == 1
    assert _judged("one", hidden, _told("explained", "gamma"), ())["by_like"] == 0


def _errors(name: str, truth: dict[str, Any], **parameters: Any) -> list[float | None]:
    effect = {"name": name, "class": [], "parameters": parameters, "stderr": {}}
    errors = parameter_errors(_sizes({name: truth}), {"effects": [effect]}, 60.0)
    return [relative for relative, _ in errors.values()]


def test_sizes_are_compared_with_the_true_ones() -> None:
    truth = {"depth_ratio": 0.002, "tone_hz": 800.0}
    off, beside = _errors("pwm_tone", truth, depth_ratio=0.0021, tone_hz=800.0)
    assert off == pytest.approx(0.05)
    assert beside == 0.0
    assert _errors("pwm_tone", truth) == [None, None]
    # A straight course of 0.02 a minute is 0.02 from end to end.
    drift = {"drift_rms_ratio": 0.02 / 12**0.5}
    assert _errors("readout_drift", drift, drift_per_min=-0.02) == [pytest.approx(0.0)]
    even = {"drift_per_min": -0.02, "drift_ratio": 0.0}
    assert _errors("readout_drift", drift, **even) == [pytest.approx(0.0)]
    assert _errors("readout_drift", drift, drift_ratio=0.02) == [pytest.approx(12**0.5 - 1)]
    # Of all light, the other lamp's too.
    assert _errors("second_lamp", {"weight": 0.25}, weight=0.2) == [pytest.approx(0.0)]
    truth = {"depth_ratio": 0.004, "tone_hz": 800.0, "strip_ratio": [1.0, 0.5]}
    assert _errors("pwm_tone", truth, depth_ratio=0.003, tone_hz=800.0) == [0.0, 0.0]


def test_lost_and_doubled_frames_are_compared_as_captured() -> None:
    lost = {"at_frames": [100, 200], "frames_lost": [2, 1]}
    assert _errors("frame_drop", lost, at_frames=[100, 101, 202]) == [0.0]
    assert _errors("frame_drop", lost, at_frames=[100, 101]) == [pytest.approx(1 / 3)]
    twice = {"at_frames": [100, 201], "form": "between"}
    assert _errors("frame_duplicate", twice, at_frames=[99, 199]) == [0.0]
    twice = {"at_frames": [100, 201], "form": "in place"}
    assert _errors("frame_duplicate", twice, at_frames=[99, 200]) == [0.0]


def test_what_the_lamp_closes_of_the_gap_is_told_apart() -> None:
    told = _told("unexplained", "harmonics", "frame_drop")
    told["gap"] = {"before": 1.0, "after": -0.02, "floor": 0.0, "limit": 0.001}
    for effect, (before, after) in zip(told["effects"], ((1.0, 0.1), (-0.1, 0.02)), strict=True):
        effect |= {"gap_before": before, "gap_after": after}
    own = ("harmonics",)
    assert _closed(told, {"frame_drop": ()}, own) == pytest.approx((0.98, 0.8))
    assert _closed(told, {"gamma": own}, own) == (pytest.approx(0.98), None)
    assert _closed({**told, "gap": {}}, {"frame_drop": ()}, own) == (None, None)


def test_a_plan_has_every_effect_so_often_and_no_seed_twice() -> None:
    camera = camera_at(PATH, NEEDED)
    can = hideable(camera)
    plan = CasePlan(
        first_seed=50, each=2, none=5, outside=16, pairs=7, triples=3, effects=can.effects
    )
    cases = plan.cases(can)
    assert len({case.seed for case in cases}) == len({case.key for case in cases}) == len(cases)
    never = {"variable_frame_rate", "clock_skew", "image_wobble", "moving_object"}
    assert {*never, *camera.NEUTRAL} == set(can.never)
    for name in can.effects:
        assert sum(case.hidden == (name,) for case in cases) == 2
    assert {case.hidden[0] for case in cases if case.kind == "unknown"} == set(camera.UNKNOWN)
    for kind, size, count in (("pair", 2, 7), ("triple", 3, 3)):
        assert [len(case.hidden) for case in cases if case.kind == kind] == [size] * count
    assert sum(bool(case.hidden) for case in cases if case.kind == "none") == 2
    assert cases == plan.cases(can)


def test_every_truth_is_plain_values() -> None:
    camera = camera_at(PATH, NEEDED)
    for name in (*camera.EFFECTS, *camera.UNKNOWN):
        filmed = camera.film(camera.Case(hidden=(name,), seed=3, duration_s=8.0, rows=120))
        json.dumps([filmed.truth, filmed.hidden])


def test_cases_are_tried_and_counted() -> None:
    cases = [
        Hidden("one", ("frame_drop",), 8, 3.0, 27.0, rows=120),
        Hidden("unknown", ("burst_lines",), 99026, 6.0, 16.0, rows=64),
    ]
    records = json.loads(json.dumps([tried(case, PATH) for case in cases]))
    drop, burst = records
    assert "frame_drop" in drop["named"]
    assert drop["relative_error"] == {"frame_drop.at_frames": 0.0}
    assert abs(drop["idle_error"]) < 0.01
    assert burst["verdict"] == "unexplained"
    document = _tabulated(records)
    assert [row["cases"] for row in document["rows"]] == [1] * 4 + [2]  # one by one, and in all
    written = _text(document)
    assert all(word in written for word in ("all single effects", "in no catalogue", "all"))
    assert "| hidden |" in _text(document, on_page=True)


@pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="needs the ffmpeg command")
def test_a_film_is_tried_as_its_rows_are() -> None:
    record = tried(Hidden("one", ("frame_drop",), 8, 3.0, 27.0, rows=160, video=True), PATH)
    assert (record["video"], record["wrong_names"]) == (True, [])
    assert "frame_drop" in record["named"]
    films = hideable(camera_at(PATH, NEEDED), video=True)
    assert "constant rate" in films.never["timestamp_jitter"]
    assert "frame_drop" in films.effects


def test_a_camera_that_is_none_is_one_clear_line(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="run it from a checkout, or name another camera"):
        camera_at(tmp_path / "nowhere", NEEDED)
    (tmp_path / "broken.py").write_text("import nothing_of_that_name")
    with pytest.raises(UsageError, match="can't be run: ModuleNotFoundError"):
        camera_at(tmp_path / "broken.py", NEEDED)
    (tmp_path / "half.py").write_text("Case = film = EFFECTS = UNKNOWN = NEUTRAL = None")
    with pytest.raises(UsageError, match="it has no go_together"):
        camera_at(tmp_path / "half.py", NEEDED)

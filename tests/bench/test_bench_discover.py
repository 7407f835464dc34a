"""The blind benchmark: what it draws, how it judges, and that it runs."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rsenf.bench.discover import CasePlan, listed, trial
from rsenf.bench.discover.judge import _judged, parameter_errors
from rsenf.bench.discover.table import _tabulated, _text
from rsenf.bench.discover.trial import _as_shown, _drawn, clock_cases, tried
from rsenf.model import CaptureModel, Light, Scene, Shutter, simulate_rows, synthetic_grid

LIKE = {"brightened": ("auto_exposure",), "sawn": ("auto_exposure",)}


def _told(verdict: str, *named: str) -> dict[str, Any]:
    effects = [
        {"name": None, "class": name.split("|")} if "|" in name else {"name": name, "class": []}
        for name in named
    ]
    return {"verdict": verdict, "effects": effects}


@pytest.mark.parametrize(
    ("kind", "hidden", "told", "outcome"),
    [
        ("one", ("gamma",), _told("explained", "gamma"), "right"),
        ("one", ("gamma",), _told("explained", "harmonics|gamma"), "right"),
        ("one", ("gamma",), _told("unexplained", "gamma"), "right, and a rest"),
        ("one", ("gamma",), _told("explained", "harmonics"), "wrong"),
        ("one", ("gamma",), _told("explained", "gamma", "pwm_tone"), "wrong"),
        ("one", ("gamma",), _told("no_discrepancy"), "missed"),
        ("one", ("gamma",), _told("unexplained"), "missed"),
        ("none", (), _told("no_discrepancy"), "right"),
        ("none", (), _told("unexplained"), "a rest"),
        ("none", (), _told("explained", "gamma"), "wrong"),
        ("unknown", ("shaken",), _told("unexplained"), "right"),
        ("unknown", ("shaken",), _told("explained", "gamma"), "wrong"),
        ("unknown", ("shaken",), _told("no_discrepancy"), "missed"),
        ("unknown", ("sawn",), _told("explained", "auto_exposure"), "right"),
        ("pair", ("gamma", "frame_drop"), _told("explained", "frame_drop", "gamma"), "right"),
        ("pair", ("gamma", "frame_drop"), _told("unexplained", "gamma"), "half"),
        ("pair", ("gamma", "frame_drop"), _told("explained", "gamma"), "half"),
        ("pair", ("gamma", "frame_drop"), _told("unexplained"), "missed"),
    ],
)
def test_an_answer_is_judged(
    kind: str, hidden: tuple[str, ...], told: dict[str, Any], outcome: str
) -> None:
    like = {name: LIKE.get(name, ()) for name in hidden}
    assert _judged(kind, like, told)["outcome"] == outcome


def test_a_size_is_compared_with_the_true_one() -> None:
    told = _told("explained", "gamma")
    told["effects"][0] |= {"parameters": {"exponent": 1.32}, "stderr": {"exponent": 0.01}}
    sizes = {"gamma": {"exponent": 1.2}, "reverse_readout": {}, "harmonics": {"second_ratio": 0.1}}
    errors = parameter_errors(sizes, told, 60.0)
    assert errors.pop("gamma.exponent") == pytest.approx((0.1, 12.0))
    assert errors == {"harmonics.second_ratio": (None, None)}


def test_a_plan_has_every_effect_so_often_and_no_seed_twice() -> None:
    cases = CasePlan(first_seed=50, each=2, none=3, outside=6, pairs=5).cases()
    assert len({case.seed for case in cases}) == len({case.key for case in cases}) == len(cases)
    for name in listed():
        assert sum(case.hidden == (name,) for case in cases) == 2
    assert not [case for case in cases if case.kind == "unknown"]  # of a foreign camera only
    assert cases == CasePlan(first_seed=50, each=2, none=3, outside=6, pairs=5).cases()
    assert cases != CasePlan(first_seed=51, each=2, none=3, outside=6, pairs=5).cases()


def test_a_case_is_its_seed() -> None:
    case = CasePlan(each=1, none=0, outside=0, pairs=0, effects=("pwm_tone",)).cases()[0]
    first, second = _drawn(case, None), _drawn(case, None)
    assert first.truth == second.truth
    assert first.hidden["pwm_tone"]["depth_ratio"] == pytest.approx(3 * 5e-4)
    # What is given to the workflow hasn't the effect, and knows nothing of the shutter.
    assert [effect.name for effect in first.given.effects] in ([], ["exposure"])
    assert first.given.shutter != first.truth.shutter


def test_what_an_exposure_leaves_of_a_tone_is_what_the_rows_show() -> None:
    """Measured in simulated rows with and without the exposure."""
    grid, exposure_s, tone_hz = synthetic_grid(3, 20.0, start_s=4.0), 7e-4, 431.0
    scene = Scene(texture_ratio=0.0, vignetting_ratio=0.0)
    light = Light(lamp="tone", flicker_ratio=1e-4)
    plain = CaptureModel(light=light, scene=scene, shutter=Shutter(rows=60, idle_ratio=0.3))
    tone = {"tone_hz": tone_hz, "depth_ratio": 0.01, "phase_rad": 0.0}
    size = {}
    for untold_s in (0.0, exposure_s):
        model = plain.with_effect("pwm_tone", **tone)
        model = model.with_effect("exposure", exposure_s=untold_s) if untold_s else model
        level = simulate_rows(model, grid, 6.0, 3, noise=False).level
        size[untold_s] = level.std()
        shown = _as_shown("pwm_tone", tone, untold_s, 50.0)["depth_ratio"]
        assert shown / 0.01 == pytest.approx(size[untold_s] / size[0.0], rel=0.01)
    assert size[exposure_s] < 0.9 * size[0.0]


def test_a_second_harmonic_is_shown_relative_to_what_is_left_of_the_first() -> None:
    shown = _as_shown("harmonics", {"second_ratio": 0.01}, 1e-3, 50.0)
    assert shown["second_ratio"] == pytest.approx(0.01 * np.cos(np.pi * 100.0 * 1e-3))
    assert _as_shown("gamma", {"exponent": 1.2}, 1e-3, 50.0) == {"exponent": 1.2}


def test_a_case_is_tried_and_counted() -> None:
    cases = CasePlan(
        first_seed=60, each=1, none=0, outside=0, pairs=0, duration_s=27.0, effects=("harmonics",)
    ).cases()
    record = tried(cases[0], None)
    assert record["outcome"] == "right"
    assert record["gap"]["after"] < record["gap"]["before"]
    assert record["given_back"] == "no_discrepancy"
    document = _tabulated([record])
    assert document["rows"][0]["right"] == 1
    assert document["rows"][0]["given_back_lack_nothing"] == 1
    assert "harmonics" in _text(document)


def test_clocks_have_seeds_of_their_own_after_all_others() -> None:
    cases = clock_cases(2, first_seed=70, duration_s=60.0)
    assert [case.seed for case in cases] == list(range(70, 78))
    assert [case.times for case in cases] == [3.0, 3.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0]
    assert len({case.key for case in cases}) == len(cases)


def test_a_clock_is_tried_and_counted() -> None:
    case = clock_cases(1, first_seed=80, duration_s=60.0)[0]
    record = tried(case, None)
    assert abs(record["true_ppm"]) == 60.0
    assert record["outcome"] in ("right", "right, and a rest")
    assert abs(record["ppm"] - record["true_ppm"]) < 6.0
    assert abs(record["lag_off_s"]) < 0.5
    row, whole = _tabulated([record])["rows"]
    assert row["hidden"] == "clock_skew, 60 ppm"
    assert {**row, "hidden": "all"} == whole
    wrong = record | {"hidden": [], "times": 0.0, "outcome": "wrong"}
    assert [r["cases"] for r in _tabulated([record, wrong])["rows"]] == [1, 1, 2]


def test_a_clock_of_the_wrong_sign_is_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    case = clock_cases(1, first_seed=80, duration_s=60.0)[0]
    for sign, outcome in ((1.0, "right"), (-1.0, "wrong")):
        told = {**_told("explained", "clock_skew"), "gap": {}, "refused": "", "cpu_s": 0.0}
        effect = {
            "parameters": {"clock_ppm": sign * trial._drawn_beside(case, None)[-1]},
            "stderr": {},
        }
        told["effects"][0] |= effect
        answer = (told, {"gap": {}, "lag_s": 100.0, "std_hz": 1e-3})
        monkeypatch.setattr(trial, "answered", lambda _, answer=answer: answer)
        assert tried(case, None)["outcome"] == outcome

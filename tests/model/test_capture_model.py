from __future__ import annotations

import dataclasses
import json
from fractions import Fraction
from pathlib import Path

import pytest
import yaml

from rsenf.errors import UsageError
from rsenf.model import (
    CaptureModel,
    Codec,
    Light,
    ParameterError,
    Scene,
    Shake,
    Shutter,
    parse_frame_rate,
)
from rsenf.model.effects.delivery import FrameDrop
from rsenf.model.effects.light import SecondLamp
from rsenf.model.effects.scene import MovingObject
from rsenf.model.effects.shutter import ClockSkew

CONFIGS = sorted((Path(__file__).parents[2] / "configs/model").glob("*.yaml"))

RICH = CaptureModel(
    name="rich",
    light=Light(lamp="cfl", daylight_ratio=0.3, phase_rad=1.0),
    scene=Scene(shake=Shake(shake_px=0.3)),
    shutter=Shutter(frame_rate=Fraction(24000, 1001), read_out="columns"),
    codec=Codec(name="h265", bitrate_bps=150_000, preset="medium"),
    effects=(
        MovingObject(period_s=3.0),
        ClockSkew(clock_ppm=-20.0),
        FrameDrop(at_frames=(7, 90)),
        SecondLamp(weight=0.1),
        SecondLamp(weight=0.2, phase_rad=-2.0),
    ),
)


@pytest.mark.parametrize("model", [CaptureModel(), RICH])
def test_to_a_dictionary_and_back_through_json(model: CaptureModel) -> None:
    data = json.loads(json.dumps(model.to_dict()))
    assert data["version"] == 2
    assert CaptureModel.from_dict(data) == model


def test_where_a_model_comes_from_is_kept() -> None:
    told = {"fitted_to": "clip.npz", "std": {"effects.1.clock_skew.clock_ppm": 0.4}}
    model = CaptureModel.from_dict({**RICH.to_dict(), "provenance": told})
    assert model.provenance == told
    assert CaptureModel.from_dict(model.to_dict()).provenance == told
    assert model == RICH  # it says nothing of the capture
    assert "provenance" not in RICH.to_dict()
    with pytest.raises(ParameterError, match=r"provenance is 3, not of the kind dict"):
        CaptureModel.from_dict({"version": 2, "provenance": 3})


@pytest.mark.parametrize("path", CONFIGS, ids=lambda p: p.stem)
def test_the_model_files_load_and_carry_their_name(path: Path) -> None:
    model = CaptureModel.from_dict(yaml.safe_load(path.read_text()))
    assert model.name == path.stem


def test_the_paper_s_model() -> None:
    assert "paper" in {p.stem for p in CONFIGS}
    path = next(p for p in CONFIGS if p.stem == "paper")
    model = CaptureModel.from_dict(yaml.safe_load(path.read_text()))
    assert model.shutter.frame_rate == Fraction(30000, 1001)
    assert model.shutter.idle_ratio == 0.38
    assert model.light.lamp == "led"


@pytest.mark.parametrize(
    ("data", "path", "says"),
    [
        ({"shuter": {}}, "shuter", "did you mean 'shutter'"),
        ({"shutter": {"idle_ration": 0.3}}, "shutter.idle_ration", "did you mean 'idle_ratio'"),
        ({"scene": {"shake": {"shak_px": 3}}}, "scene.shake.shak_px", "did you mean 'shake_px'"),
        ({"light": {"zzz": 1}}, "light.zzz", "known: lamp, "),
        ({"light": {"lamp": "hallogen"}}, "light.lamp", "did you mean 'halogen'"),
        ({"light": {"daylight_ratio": 1.4}}, "light.daylight_ratio", "not between 0 and 1"),
        ({"shutter": {"rows": 720.5}}, "shutter.rows", "not of the kind int"),
        ({"shutter": {"rows": True}}, "shutter.rows", "not of the kind int"),
        ({"shutter": {"idle_ratio": float("nan")}}, "shutter.idle_ratio", "is nan"),
        ({"effects": {"gamma": {}}}, "effects", "not a list"),
        ({"effects": ["gamma"]}, "effects.0", "not one 'name: {parameter: value}'"),
        ({"effects": [{"gama": {}}]}, "effects.0.gama", "did you mean 'gamma'"),
        ({"effects": [{"gamma": {"exp": 2}}]}, "effects.0.gamma.exp", "known: exponent"),
        ({"effects": [{"gamma": 2}]}, "effects.0.gamma", "is 2, not a mapping"),
        (
            {"effects": [{"gamma": None}, {"exposure": {"exposure_s": 0.2}}]},
            "effects.1.exposure.exposure_s",
            "longer than a frame",
        ),
        (
            {"effects": [{"frame_drop": {"at_frames": [1, 0]}}]},
            "effects.0.frame_drop.at_frames",
            "is 0, not between",
        ),
        ({"effects": [{"moving_object": {}}] * 2}, "effects", "more than one thing"),
        ({"shutter": {"frame_rate": "fast"}}, "shutter.frame_rate", "'fast', not a frame rate"),
        ({"shutter": {"idle_ratio": 10**400}}, "shutter.idle_ratio", "larger than any number"),
        ({"shutter": {"frame_rate": 5000}}, "shutter.frame_rate", "not between 1 and 1000"),
        ({"shutter": 5}, "shutter", "is 5, not a mapping"),
        ({"codec": {"bitrate_bps": "150k"}}, "codec.bitrate_bps", "not of the kind int"),
        ({"version": 1}, "version", "this program reads 2"),
    ],
)
def test_what_a_model_can_t_say(data: dict[str, object], path: str, says: str) -> None:
    with pytest.raises(ParameterError) as caught:
        CaptureModel.from_dict({"version": 2, **data})
    assert ".".join(map(str, caught.value.path)) == path
    assert path in str(caught.value)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)
    assert caught.value.exit_code == 2


def test_a_model_needs_its_version() -> None:
    with pytest.raises(UsageError, match="begins with 'version: 2'"):
        CaptureModel.from_dict({"shutter": {}})


def test_every_parameter_says_what_it_is() -> None:
    for part in (Light, Scene, Shake, Shutter, Codec):
        for f in dataclasses.fields(part):
            assert f.name == "shake" or f.metadata["doc"], f"{part.__name__}.{f.name}"


def test_the_truth_names_effects_and_what_the_lamp_has_of_its_own() -> None:
    named = RICH.named_effects(100.0)
    names = [e["name"] for e in named]
    assert names == ["harmonics", *(e.name for e in RICH.effects)]
    own = named[0]["parameters"]
    assert (own["second_ratio"], own["third_ratio"]) == pytest.approx((0.25, 0.10))
    assert named[2]["parameters"] == {"clock_ppm": -20.0}
    tone = CaptureModel(light=Light(lamp="tone"))
    assert tone.named_effects(100.0) == []
    given = RICH.with_effect("harmonics", second_ratio=0.01).named_effects(100.0)
    assert [e["parameters"]["second_ratio"] for e in given if e["name"] == "harmonics"] == [0.01]


def test_an_effect_takes_the_place_of_those_of_its_name() -> None:
    model = RICH.with_effect("second_lamp", weight=0.3)
    assert [e.to_dict()["weight"] for e in model.effects if e.name == "second_lamp"] == [0.3]
    assert len(model.effects) == len(RICH.effects) - 1
    with pytest.raises(ParameterError, match=r"effects\.gamma\.exponent is 9\.0, not between"):
        RICH.with_effect("gamma", exponent=9)


@pytest.mark.parametrize(
    ("text", "rate"),
    [
        ("30000/1001", Fraction(30000, 1001)), ("29.97", Fraction(30000, 1001)),
        (29.97, Fraction(30000, 1001)), (23.976, Fraction(24000, 1001)), (25, Fraction(25)),
        (25.0, Fraction(25)), ("12.5", Fraction(25, 2)), (59.94, Fraction(60000, 1001)),
    ],
)  # fmt: skip
def test_frame_rates(text: object, rate: Fraction) -> None:
    assert parse_frame_rate(text) == rate


@pytest.mark.parametrize(
    "text", ["", "x", "0", "-25", "1/0", "1e999999999", 10**400, "nan", "inf", True, None]
)
def test_what_isn_t_a_frame_rate(text: object) -> None:
    with pytest.raises(UsageError, match="not a frame rate"):
        parse_frame_rate(text)

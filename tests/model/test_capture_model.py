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
    Delivery,
    Light,
    MovingBox,
    ParameterError,
    Scene,
    Shutter,
    parse_frame_rate,
)

CONFIGS = sorted((Path(__file__).parents[2] / "configs/model").glob("*.yaml"))

RICH = CaptureModel(
    name="rich",
    light=Light(lamp="cfl", harmonic_ratios=(0.2, 0.1), daylight_ratio=0.3, phase_rad=1.0),
    scene=Scene(moving=MovingBox(period_s=3.0)),
    shutter=Shutter(frame_rate=Fraction(24000, 1001), clock_ppm=-20.0),
    delivery=Delivery(drops_per_min=2.0, retimed=True),
    codec=Codec(name="h265", bitrate_bps=150_000, preset="medium"),
)


@pytest.mark.parametrize("model", [CaptureModel(), RICH])
def test_to_a_dictionary_and_back_through_json(model: CaptureModel) -> None:
    data = json.loads(json.dumps(model.to_dict()))
    assert data["version"] == 1
    assert CaptureModel.from_dict(data) == model


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
        ({"scene": {"moving": {"perod_s": 3}}}, "scene.moving.perod_s", "did you mean 'period_s'"),
        ({"light": {"zzz": 1}}, "light.zzz", "known: lamp, "),
        ({"light": {"lamp": "hallogen"}}, "light.lamp", "did you mean 'halogen'"),
        ({"light": {"daylight_ratio": 1.4}}, "light.daylight_ratio", "not between 0 and 1"),
        ({"light": {"harmonic_ratios": [0.1, 3]}}, "light.harmonic_ratios", "is 3.0, not between"),
        ({"shutter": {"rows": 720.5}}, "shutter.rows", "not of the kind int"),
        ({"shutter": {"rows": True}}, "shutter.rows", "not of the kind int"),
        ({"shutter": {"exposure_s": float("nan")}}, "shutter.exposure_s", "is nan"),
        ({"shutter": {"exposure_s": 0.2}}, "shutter.exposure_s", "longer than a frame"),
        ({"shutter": {"frame_rate": "fast"}}, "shutter.frame_rate", "'fast', not a frame rate"),
        ({"shutter": {"frame_rate": 5000}}, "shutter.frame_rate", "not between 1 and 1000"),
        ({"shutter": 5}, "shutter", "is 5, not a mapping"),
        ({"codec": {"bitrate_bps": "150k"}}, "codec.bitrate_bps", "not of the kind int"),
        ({"version": 2}, "version", "this program reads 1"),
    ],
)
def test_what_a_model_can_t_say(data: dict[str, object], path: str, says: str) -> None:
    with pytest.raises(ParameterError) as caught:
        CaptureModel.from_dict({"version": 1, **data})
    assert ".".join(caught.value.path) == path
    assert path in str(caught.value)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)
    assert caught.value.exit_code == 2


def test_a_model_needs_its_version() -> None:
    with pytest.raises(UsageError, match="begins with 'version: 1'"):
        CaptureModel.from_dict({"shutter": {}})


def test_every_parameter_says_what_it_is() -> None:
    for part in (Light, Scene, MovingBox, Shutter, Delivery, Codec):
        for f in dataclasses.fields(part):
            assert f.name == "moving" or f.metadata["doc"], f"{part.__name__}.{f.name}"


def test_effects_have_the_catalogue_s_names() -> None:
    names = [e["name"] for e in RICH.effects()]
    assert names == ["harmonics", "moving_object", "exposure", "clock_skew", "frame_drop"]
    plain = CaptureModel(light=Light(harmonic_ratios=()), shutter=Shutter(exposure_s=0.0))
    assert plain.effects() == []


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


@pytest.mark.parametrize("text", ["", "x", "0", "-25", "1/0", "nan", "inf", True, None])
def test_what_isn_t_a_frame_rate(text: object) -> None:
    with pytest.raises(UsageError, match="not a frame rate"):
        parse_frame_rate(text)

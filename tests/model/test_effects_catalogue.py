"""Every effect says what it has to say; an expert's own joins them."""

from __future__ import annotations

import dataclasses
import inspect
import re
from pathlib import Path

import numpy as np
import pytest

from rsenf.errors import UsageError
from rsenf.model import (
    CATALOGUE,
    CaptureModel,
    Light,
    Scene,
    Shutter,
    exposures,
    load_effects,
    make_effect,
    simulate_rows,
    synthetic_grid,
)
from rsenf.model.effects import Effect, base
from rsenf.model.line_light import LineLight
from rsenf.model.shutter import ReadOut
from tests.model.bare import RATE_HZ, bare, film

ROOT = Path(__file__).parents[2]
TEMPLATE = ROOT / "configs/model/my_effect.py"

# The names that a discovery may give.
NAMES = [
    "harmonics",
    "gamma",
    "exposure",
    "clock_skew",
    "frame_drop",
    "frame_duplicate",
    "rate_conversion",
    "timestamp_jitter",
    "capture_jitter",
    "auto_exposure",
    "rows_cropped",
    "image_wobble",
    "reverse_readout",
    "second_lamp",
    "pwm_tone",
    "interharmonic",
    "gop_attenuation",
    "row_banding",
    "readout_drift",
    "variable_frame_rate",
    "moving_object",
    "moving_stripes",
    "interlace",
    "codec_lowpass",
]
SOURCE = re.compile(
    r"(paper, (Eq|Section)|\b(ITU|ISO|IEC|EMVA|RFC) [\w/-]*\d|ITU-[RT] \w+\.\d|IEEE Std \d"
    r"|, (19|20)\d\d\))"
)
# What isn't an effect but can look like one: parameters of every capture, and the grid itself.
FITTED = {
    *(f.name for part in (Light, Scene, Shutter) for f in dataclasses.fields(part)),
    "daylight", "texture", "light phase", "grid frequency",
}  # fmt: skip


@pytest.fixture
def catalogue(monkeypatch: pytest.MonkeyPatch) -> object:
    """Give the catalogue back as it was."""
    monkeypatch.setattr(CATALOGUE, "_items", dict(CATALOGUE._items))
    return CATALOGUE


def test_all_names_are_there() -> None:
    assert sorted(CATALOGUE) == sorted(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_every_effect_tells_of_itself(name: str) -> None:
    effect = CATALOGUE[name]
    assert effect.name == name
    assert len((effect.__doc__ or "").split()) > 25
    assert re.search(r"``[^`]*[=+−·/][^`]*``", effect.__doc__ or ""), "its formula"
    assert SOURCE.search(effect.source), "an equation, an article with its year, or a standard"
    assert effect.told_apart_by
    assert effect.confused_with
    for other in effect.confused_with:
        assert other in NAMES or other in FITTED, other
        assert other != name
    for f in dataclasses.fields(effect):
        low, high = f.metadata["low"], f.metadata["high"]
        assert f.metadata["doc"]
        if f.type in ("float", "int"):
            assert -1e5 <= low < high <= 1e5, f.name
        elif f.type == "str":
            assert f.metadata["choices"]


@pytest.mark.parametrize("name", NAMES)
def test_every_effect_survives_a_model_file(name: str) -> None:
    model = bare().with_effect(name)
    assert CaptureModel.from_dict(model.to_dict()) == model
    assert film(model, 1.0).truth["effects"][-1]["name"] == name


@pytest.mark.parametrize("name", NAMES)
def test_every_effect_begins_a_longer_clip_as_a_shorter_one(name: str) -> None:
    model = bare(rows=16, columns=32).with_effect(name)
    short, long = film(model, 5.0), film(model, 9.0)
    assert np.array_equal(short.level[:64], long.level[:64])
    assert np.array_equal(short.frame_time_s[:64], long.frame_time_s[:64])


@pytest.mark.parametrize("name", NAMES)
def test_no_effect_depends_on_how_a_clip_is_cut_into_blocks(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without noise, as in a fit, blocks are longer than with it, as in a simulation."""
    model = bare(rows=16, columns=32).with_effect(name)
    grid = synthetic_grid(1, 12.0)
    long = simulate_rows(model, grid, 9.0, 1, noise=False).level
    monkeypatch.setattr(exposures, "FEWEST_VALUES", 0)
    short = simulate_rows(model, grid, 9.0, 1, noise=False).level
    np.testing.assert_allclose(short, long, rtol=1e-6)


def test_an_effect_is_not_told_how_a_clip_is_cut_into_blocks() -> None:
    told = {f.name for kind in (LineLight, ReadOut) for f in dataclasses.fields(kind)}
    assert "block" not in told
    assert list(inspect.signature(base.Run.rng).parameters) == ["self"]


def test_two_of_a_kind_have_their_own_numbers() -> None:
    one = film(bare(flicker=0.0).with_effect("auto_exposure", gain_ratio=0.02))
    two = film(
        bare(flicker=0.0)
        .with_effect("auto_exposure", gain_ratio=0.02)
        .plus(make_effect("auto_exposure", {"gain_ratio": 0.02}))
    )
    first = one.level.mean(axis=(1, 2)) / 110
    second = two.level.mean(axis=(1, 2)) / 110 / first
    assert abs(np.corrcoef(first, second)[0, 1]) < 0.9


def test_places_are_documented_in_their_order() -> None:
    places = [
        cls.__name__
        for cls in vars(base).values()
        if isinstance(cls, type) and issubclass(cls, Effect) and cls is not Effect
    ]
    told = re.findall(r"^    (\w+Effect) ", base.__doc__ or "", re.MULTILINE)
    assert told == places


def test_the_template_works(catalogue: dict[str, type[Effect]]) -> None:
    (cls,) = load_effects(TEMPLATE)
    assert catalogue["hum_bars"] is cls
    assert cls.guesses(None), "discover tries it"
    data = film(bare(flicker=0.0).with_effect("hum_bars", depth_ratio=0.02), 4.0)
    n, line = np.mgrid[: len(data.level), :64]
    bars = 1 + 0.02 * np.cos(2 * np.pi * (1.5 * line / 64 - 0.7 * n / RATE_HZ))
    assert data.level[:, :, 0] == pytest.approx(110 * bars, abs=0.12)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "defines no effect"),
        ("import nothing_of_this_name", "can't be run: ModuleNotFoundError"),
        ("raise SystemExit", "can't be run: SystemExit"),
        (
            "from rsenf.model.effects import SensorEffect\nclass Mine(SensorEffect):\n  'Mine.'\n",
            "lacks name, source, confused_with, told_apart_by, apply",
        ),
        (
            "from rsenf.model.effects import SensorEffect\nclass Mine(SensorEffect):\n  'Mine.'\n"
            "  name = source = told_apart_by = 'x'\n  confused_with = 'xy'\n",
            "Mine lacks apply",
        ),
    ],
)
def test_what_is_no_effect(
    tmp_path: Path, catalogue: dict[str, type[Effect]], text: str, says: str
) -> None:
    path = tmp_path / "mine.py"
    path.write_text(text)
    with pytest.raises(UsageError, match=says):
        load_effects(path)
    assert sorted(catalogue) == sorted(NAMES)

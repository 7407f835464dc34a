"""The workflow finds what was hidden, and nothing where nothing was."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from rsenf.discrepancy.measured import measured_of
from rsenf.discrepancy.result import discovery_json, model_of
from rsenf.discrepancy.start import PLAIN
from rsenf.discrepancy.verdict import discover
from rsenf.errors import InputError
from rsenf.messages import Header
from rsenf.model import CaptureModel, GridPath, Shutter, simulate_rows
from rsenf.rows.stage import blocks_from_luminance
from tests.discrepancy.hidden_effects import LINES, SECONDS, hidden


def test_nothing_is_found_where_nothing_is_hidden() -> None:
    case = hidden(seed=11)
    found = case.discover()
    assert found.verdict == "no_discrepancy"
    assert found.steps == ()
    assert abs(found.first.gap.value) < found.floor.limit
    theory, truth = found.last.forward.model, case.made.truth
    errors = dict(zip((k.name for k in found.last.parameters), found.last.stderr, strict=True))
    # The exposure, which the plain model hasn't, only lowers the flicker: by sinc(100 Hz · 2 ms).
    swallowed = float(np.sinc(0.2))
    away = theory.light.flicker_ratio - 0.1 * swallowed
    assert abs(away) < 4.0 * errors["flicker_ratio"] + 1e-6
    assert abs(theory.shutter.idle_ratio - truth["idle_ratio"]) < 4.0 * errors["idle_ratio"] + 1e-6


# Three times the weakest that is to be named, or thereabouts; seeds as they came.
@pytest.mark.parametrize(
    ("effect", "values", "checked"),
    [
        ("second_lamp", {"weight": 0.06}, {"weight": 0.06}),
        ("pwm_tone", {"tone_hz": 1234.5, "depth_ratio": 0.0015}, {"tone_hz": 1234.5}),
        ("interharmonic", {"depth_ratio": 6e-4}, {"flicker_hz": 8.8, "depth_ratio": 6e-4}),
        ("pwm_tone", {"tone_hz": 75.3, "depth_ratio": 0.0015}, {"tone_hz": 75.3}),
        (
            "moving_stripes",
            {"depth_ratio": 6e-4, "stripes": 7.7, "rate_hz": -3.3},
            {"depth_ratio": 6e-4, "stripes": 7.7, "rate_hz": -3.3},
        ),
        ("gop_attenuation", {"loss_ratio": 0.03}, {"loss_ratio": 0.03, "period_frames": 30}),
        ("readout_drift", {"drift_per_min": 0.006}, {"drift_per_min": 0.006}),
        ("capture_jitter", {"jitter_s": 6e-5}, {}),
        ("auto_exposure", {"gain_ratio": 0.006}, {}),
        ("interlace", {"bottom_first": True}, {"bottom_first": True}),
        ("reverse_readout", {}, {}),
        ("row_banding", {"banding_ratio": 0.009}, {}),
        ("frame_drop", {"at_frames": (200, 600)}, {"at_frames": [200, 600]}),
        ("frame_duplicate", {"at_frames": (300, 650)}, {"at_frames": [300, 650]}),
        (
            "frame_duplicate",
            {"at_frames": (300, 650), "retimed": False},
            {"at_frames": [300, 650], "retimed": False},
        ),
    ],
)
def test_a_hidden_effect_is_named_and_explained(
    effect: str, values: dict[str, object], checked: dict[str, float]
) -> None:
    case = hidden(effect, seed=12, strips=2 if effect == "second_lamp" else 1, **values)
    told = discovery_json(case.discover(), "")
    assert told["verdict"] == "explained"
    (step,) = told["effects"]
    assert step["name"] == effect
    for name, value in checked.items():
        assert step["parameters"][name] == pytest.approx(value, rel=0.05)
    assert told["gap"]["after"] <= told["gap"]["limit"]
    if effect != "row_banding":  # which neighbouring rows don't share: the gap can't show it
        assert told["gap"]["shrinkage"] > 0.9
    assert told["held_out_mean_square"]["after"] < told["held_out_mean_square"]["before"]


@pytest.mark.parametrize(
    ("effect", "values"), [("harmonics", {"second_ratio": 0.009}), ("gamma", {"exponent": 1.2})]
)
def test_what_looks_alike_is_a_class(effect: str, values: dict[str, float]) -> None:
    told = discovery_json(hidden(effect, seed=13, **values).discover(), "")
    assert told["verdict"] == "explained"
    (step,) = told["effects"]
    assert step["name"] is None
    assert set(step["class"]) == {"harmonics", "gamma"}
    assert step["told_apart_by"]


def test_fields_are_found_where_the_flicker_stands_still() -> None:
    """25 fps and 50 Hz: fields differ by whole turns, and no unfitted start is near."""
    case = hidden("interlace", seed=12, rate=Fraction(25), bottom_first=True)
    told = discovery_json(case.discover(), "")
    assert (told["verdict"], [e["name"] for e in told["effects"]]) == ("explained", ["interlace"])
    assert told["effects"][0]["parameters"]["bottom_first"]


def test_a_steady_tone_beside_a_harmonic_is_no_harmonic() -> None:
    """Its alias is as near to that of 550 Hz as the grid's wander may bring that."""
    case = hidden("pwm_tone", seed=12, rate=Fraction(25), tone_hz=575.16, depth_ratio=0.0015)
    told = discovery_json(case.discover(), "")
    assert told["verdict"] == "explained"
    (step,) = told["effects"]
    assert step["parameters"]["tone_hz"] == pytest.approx(575.16, abs=1e-3)


def test_the_model_that_is_written_explains_the_data_it_was_fitted_to() -> None:
    case = hidden("interharmonic", seed=14, depth_ratio=6e-4)
    found = case.discover()
    extended = CaptureModel.from_dict(model_of(found, "a test").to_dict())
    assert [effect.name for effect in extended.effects] == ["interharmonic"]
    assert extended.provenance["stderr"]["interharmonic.flicker_hz"] < 1e-3
    # As many pixels as make the noise that was measured.
    assert extended.shutter.columns == pytest.approx(Shutter().columns, rel=0.02)
    again = case.discover(extended)
    assert again.verdict == "no_discrepancy"
    path = found.last.forward.course.grid()
    made = simulate_rows(
        extended, GridPath(path.freq_hz, path.step_s, path.start_s), SECONDS, 5, noise=False
    )
    left = case.made.level - made.level
    assert made.level.shape[1] == LINES
    row_var = found.last.noise_var * case.data.group
    assert float(left.std()) == pytest.approx(row_var**0.5, rel=0.05)


def test_something_else_is_not_explained_away() -> None:
    """A mechanical shake with a gain, which is in no catalogue."""
    case = hidden(seed=15)
    t_s = case.data.time_s[:, None, None]
    shaken = np.roll(case.data.level, 1, axis=1) - case.data.level
    case.data.level[...] += (0.2 * np.sin(2 * np.pi * 3.7 * t_s) * shaken).astype(np.float32)
    case.data.level[...] *= 1 + 0.001 * np.cos(2 * np.pi * 3.7 * t_s).astype(np.float32)
    told = discovery_json(case.discover(), "")
    assert told["verdict"] == "unexplained"
    aliases = [p for p in told["unexplained"]["places"] if p["axis"] == "alias_hz"]
    assert any(p["low"] - 0.1 < 3.7 < p["high"] + 0.1 for p in aliases)


def test_where_nothing_fits_no_effect_is_named() -> None:
    """One frame in six left out, and the others spread evenly: no effect of the catalogue."""
    case = hidden(seed=17, lines=48)
    level = case.made.level[np.arange(case.made.level.shape[0]) % 6 < 5]
    stamp_s = np.arange(level.shape[0]) / 25.0
    data = measured_of(list(blocks_from_luminance(level, stamp_s, Header())))
    told = discovery_json(discover(PLAIN, data), "")
    assert told["verdict"] == "unexplained"
    assert told["effects"] == []


def test_a_written_pattern_over_rows_is_taken_up_where_rows_are_averaged() -> None:
    case = hidden("row_banding", seed=14, lines=360, banding_ratio=0.01)
    assert case.data.group > 1
    found = case.discover()
    extended = CaptureModel.from_dict(model_of(found, "a test").to_dict())
    (pattern,) = [e for e in extended.effects if e.name == "row_banding"]
    assert len(pattern.to_dict()["offset_ratios"]) == 360
    assert case.discover(extended).verdict == "no_discrepancy"


def test_a_fit_whose_arrays_were_let_go_has_them_again() -> None:
    whole = hidden("harmonics", seed=16, lines=48).discover().last
    for part in (whole.released(), whole.released(rows=True)):
        again = part.restored()
        np.testing.assert_allclose(again.residual, whole.residual, atol=1e-4)
        np.testing.assert_allclose(again.jacobian.turn, whole.jacobian.turn, atol=1e-2)
    assert whole.restored() is whole


def test_too_short_a_recording_is_refused_with_the_shortest_that_is_of_use() -> None:
    case = hidden(seed=16)
    with pytest.raises(InputError, match=r"too short.*7 s"):
        _cut(case, 6.5)


def _cut(case: object, seconds: float) -> None:
    frames = int(seconds * 29.97)
    level = case.made.level[:frames]  # type: ignore[attr-defined]
    stamps = case.made.frame_time_s[:frames]  # type: ignore[attr-defined]
    measured_of(list(blocks_from_luminance(level, stamps, Header())), 50.0)

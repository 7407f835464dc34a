"""What every effect of the catalogue must do, whoever made it; and that a faulty one is caught.

That row level equals film is in ``tests/model/test_full_video.py``, of the whole catalogue too.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from fractions import Fraction
from typing import Any, ClassVar

import numpy as np
import pytest

from rsenf.bench.discover import CasePlan, left_out, listed
from rsenf.bench.discover.trial import SKEW
from rsenf.model import CATALOGUE, Effect, make_effect
from rsenf.model.effects import Hiding, LightEffect, Run, SensorEffect, Weakest
from rsenf.model.effects.light import Harmonics
from rsenf.model.effects.search import ResidualFeatures
from rsenf.model.effects.sensor import RowBanding
from rsenf.model.line_light import LineLight
from rsenf.model.parameters import fittings
from tests.model.bare import (
    DEPTH,
    F0_HZ,
    LEVEL,
    PHASE,
    RATE_HZ,
    bare,
    film,
    fit,
    frame_tones,
    line_times_s,
    phase_error_rad,
    wave,
)
from tests.model.test_effects_catalogue import FITTED

TURN = 2 * np.pi
SECONDS = 20.0
# Values with which an effect does nothing, where neither its fitting nor its weakest tells them.
NEUTRAL: dict[str, dict[str, float]] = {
    "clock_skew": {"clock_ppm": 0.0},
    "variable_frame_rate": {"rate_ratio": 0.0},
    "exposure": {"exposure_s": 0.0},
    "rows_cropped": {"crop_ratio": 0.0},
    "image_wobble": {"wobble_rows": 0.0},
    "frame_drop": {"drops_per_min": 0.0},
    "moving_stripes": {"depth_ratio": 0.0},
    "frame_duplicate": {"duplicates_per_min": 0.0},
    "codec_lowpass": {"gain": 1.0},
}
THERE_OR_NOT = ("reverse_readout", "interlace", "moving_object", "rate_conversion")
# Not proposed for what a fit leaves: found from the stamps, and beside a reference.
SOUGHT_ELSEWHERE = ("timestamp_jitter", "variable_frame_rate", SKEW)


def rows_with(name: str, seconds: float = SECONDS, **values: Any) -> Any:
    """Rows of a bare capture with one effect."""
    return film(bare().with_effect(name, **values), seconds)


def tone_of(data: Any, freq_hz: float) -> complex:
    """Amplitude at a frequency, beside the lamp's, over the mean."""
    return complex(fit(data.level[:, :, 0], line_times_s(data.frame_time_s), [F0_HZ, freq_hz])[1])


def late_s(data: Any) -> np.ndarray:
    """By how much the light of each frame is ahead of what its stamp says."""
    return phase_error_rad(frame_tones(data, line_times_s(data.frame_time_s))) / (TURN * F0_HZ)


# How strong an effect is by the rows alone: arithmetic on the bare lamp's cosine that calls nothing
# of the effect's. What is only there or not measures 1.
def _harmonics(second_ratio: float) -> float:
    data = rows_with("harmonics", 4.0, second_ratio=second_ratio)
    first, second = fit(data.level[:, :, 0], line_times_s(data.frame_time_s), [F0_HZ, 2 * F0_HZ])
    return abs(second / first)


def _gamma(exponent: float) -> float:
    data = rows_with("gamma", 4.0, exponent=exponent)
    light = LEVEL * wave(line_times_s(data.frame_time_s))
    before, after = np.log(light / 255).ravel(), np.log(data.level / 255).ravel()
    return float(np.polyfit(before, after, 1)[0])


def _exposure(exposure_s: float) -> float:
    data = rows_with("exposure", 4.0, exposure_s=exposure_s)
    tone = fit(data.level[:, :, 0], line_times_s(data.frame_time_s), [F0_HZ])[0]
    return float(phase_error_rad(np.array([tone]))[0] / (TURN * F0_HZ) * 2)


def _clock_skew(clock_ppm: float) -> float:
    ahead_s = late_s(data := rows_with("clock_skew", clock_ppm=clock_ppm))
    return float(-1e6 * np.polyfit(data.frame_time_s, ahead_s, 1)[0])


def _variable_frame_rate(rate_ratio: float) -> float:
    data = rows_with(
        "variable_frame_rate", 60.0, rate_ratio=rate_ratio, time_constant_s=0.1, stamped=False
    )
    return float(np.std(np.diff(late_s(data))[3:]) * RATE_HZ)


def _lost(drops_per_min: float) -> float:
    data = rows_with("frame_drop", 60.0, drops_per_min=drops_per_min)
    return float(_leaps(data, 1.0))


def _twice(duplicates_per_min: float) -> float:
    data = rows_with("frame_duplicate", 60.0, duplicates_per_min=duplicates_per_min)
    return float(_leaps(data, -1.0))


def _leaps(data: Any, frames: float) -> int:
    """How often the flicker leaps ahead by so many frames' turns."""
    phase = phase_error_rad(frame_tones(data, line_times_s(data.frame_time_s)))
    step = np.exp(1j * (np.diff(phase) - TURN * F0_HZ / RATE_HZ * frames))
    return int(np.sum(np.abs(np.angle(step)) < 0.3))


def _timestamp_jitter(jitter_s: float) -> float:
    data = rows_with("timestamp_jitter", 60.0, jitter_s=jitter_s)
    return float(np.std(data.frame_time_s - np.arange(data.frame_time_s.size) / RATE_HZ))


def _capture_jitter(jitter_s: float) -> float:
    return float(np.std(late_s(rows_with("capture_jitter", 60.0, jitter_s=jitter_s))))


def _auto_exposure(gain_ratio: float) -> float:
    data = rows_with("auto_exposure", 60.0, gain_ratio=gain_ratio, time_constant_s=0.1)
    gain = data.level[:, :, 0] / wave(line_times_s(data.frame_time_s))
    return float(np.std(gain.mean(axis=1)) / LEVEL)


def _rows_cropped(crop_ratio: float) -> float:
    data = rows_with("rows_cropped", 4.0, crop_ratio=crop_ratio)
    tones = data.level[:, :, 0] - data.level[:, :, 0].mean(axis=0)
    turns = np.exp(-1j * TURN * F0_HZ * data.frame_time_s) @ tones
    slope = np.polyfit(np.arange(64), np.unwrap(np.angle(turns)), 1)[0]
    return float(1 - slope * 64 / (TURN * F0_HZ) / (0.7 / RATE_HZ))


def _image_wobble(wobble_rows: float) -> float:
    data = rows_with("image_wobble", 60.0, wobble_rows=wobble_rows)
    return float(np.std(late_s(data)) / (0.7 / RATE_HZ / 64))


def _reverse_readout() -> float:
    data = rows_with("reverse_readout", 4.0)
    upward = LEVEL * wave(line_times_s(data.frame_time_s)[:, ::-1])
    return float(np.std(data.level[:, :, 0] - upward) < 0.05)


def _interlace() -> float:
    data = rows_with("interlace", 4.0)
    tones = np.exp(-1j * TURN * F0_HZ * data.frame_time_s) @ (data.level[:, :, 0] - LEVEL)
    apart = np.angle(tones[1::2] * np.conj(tones[::2]) * np.exp(-1j * np.pi * F0_HZ / RATE_HZ))
    return float(np.all(np.abs(apart) < 0.05))


def _second_lamp(weight: float) -> float:
    data = rows_with("second_lamp", 4.0, weight=weight, tilt_ratio=0.0)
    own, found = np.exp(1j * PHASE), tone_of_lamp(data) / DEPTH
    return float(abs(found - own) / abs(own * np.exp(2j * np.pi / 3) - own))


def tone_of_lamp(data: Any) -> complex:
    return complex(fit(data.level[:, :, 0], line_times_s(data.frame_time_s), [F0_HZ])[0])


def _pwm_tone(depth_ratio: float) -> float:
    return abs(tone_of(rows_with("pwm_tone", 4.0, tone_hz=733.0, depth_ratio=depth_ratio), 733.0))


def _interharmonic(depth_ratio: float) -> float:
    data = rows_with("interharmonic", flicker_hz=8.8, depth_ratio=depth_ratio)
    light = data.level[:, :, 0] / wave(line_times_s(data.frame_time_s))
    return abs(complex(fit(light, line_times_s(data.frame_time_s), [8.8])[0]))


def _moving_stripes(depth_ratio: float) -> float:
    data = rows_with("moving_stripes", 8.0, depth_ratio=depth_ratio, stripes=0.0, rate_hz=2.5)
    light = data.level[:, :, 0] / wave(line_times_s(data.frame_time_s))
    return abs(complex(fit(light, line_times_s(data.frame_time_s), [2.5])[0]))


def _rate_conversion() -> float:
    data = rows_with("rate_conversion", 8.0, to_rate=Fraction(25))
    even = np.allclose(np.diff(data.frame_time_s), 0.04)
    return float(even and len(data.truth["dropped_frames"]) > 30)


def _gop_attenuation(loss_ratio: float) -> float:
    data = rows_with("gop_attenuation", loss_ratio=loss_ratio, period_frames=30)
    size = np.abs(frame_tones(data, line_times_s(data.frame_time_s)))[: 30 * 19].reshape(-1, 30)
    return float(1 - (size[:, 29] / size[:, 0]).mean())


def _codec_lowpass(gain: float) -> float:
    data = rows_with("codec_lowpass", gain=gain)
    level = data.level[:, :, 0].astype(np.float64)
    plain = LEVEL * wave(line_times_s(data.frame_time_s))
    before, change = level[:-1], np.diff(level, axis=0)
    wanted = plain[1:] - before
    return float((change * wanted).sum() / (wanted**2).sum())


def _row_banding(banding_ratio: float) -> float:
    data = rows_with("row_banding", 10.0, banding_ratio=banding_ratio)
    pattern = data.level[:, :, 0] - LEVEL * wave(line_times_s(data.frame_time_s))
    return float(np.sqrt(np.mean(pattern.mean(axis=0) ** 2)) / LEVEL)


def _readout_drift(drift_per_min: float) -> float:
    data = rows_with("readout_drift", 60.0, drift_per_min=drift_per_min)
    last = data.level[-30:, :, 0] - data.level[-30:, :, 0].mean(axis=0)
    tones = np.exp(-1j * TURN * F0_HZ * data.frame_time_s[-30:]) @ last
    slope = np.polyfit(np.arange(64), np.unwrap(np.angle(tones)), 1)[0]
    return float(slope * 64 / (TURN * F0_HZ) / (0.7 / RATE_HZ) - 1)


def _moving_object(height_ratio: float) -> float:
    data = film(bare(flicker=0.0).with_effect("moving_object", height_ratio=height_ratio), 4.0)
    return float(np.mean(np.abs(data.level[:, :, 0] - LEVEL).max(axis=0) > 5.0))


# What measures it, with which value, and within what share of that it has to be.
STRENGTH: dict[str, tuple[Callable[..., float], tuple[float, ...], float]] = {
    "clock_skew": (_clock_skew, (200.0,), 0.02),
    "variable_frame_rate": (_variable_frame_rate, (1e-3,), 0.1),
    "capture_jitter": (_capture_jitter, (1e-4,), 0.06),
    "exposure": (_exposure, (0.003,), 0.01),
    "rows_cropped": (_rows_cropped, (0.2,), 0.02),
    "readout_drift": (_readout_drift, (0.06,), 0.05),
    "reverse_readout": (_reverse_readout, (), 0.0),
    "interlace": (_interlace, (), 0.0),
    "image_wobble": (_image_wobble, (1.0,), 0.1),
    "harmonics": (_harmonics, (0.05,), 0.01),
    "second_lamp": (_second_lamp, (0.1,), 0.01),
    "pwm_tone": (_pwm_tone, (0.01,), 0.02),
    "interharmonic": (_interharmonic, (0.005,), 0.02),
    "moving_object": (_moving_object, (0.3,), 0.05),
    "moving_stripes": (_moving_stripes, (0.1,), 0.02),
    "auto_exposure": (_auto_exposure, (0.02,), 0.1),
    "gamma": (_gamma, (1.2,), 0.01),
    "row_banding": (_row_banding, (0.01,), 0.2),
    "frame_drop": (_lost, (30.0,), 0.4),
    "frame_duplicate": (_twice, (30.0,), 0.4),
    "rate_conversion": (_rate_conversion, (), 0.0),
    "timestamp_jitter": (_timestamp_jitter, (1e-3,), 0.06),
    "gop_attenuation": (_gop_attenuation, (0.1,), 0.02),
    "codec_lowpass": (_codec_lowpass, (0.3,), 0.02),
}


def check_facts(name: str) -> None:
    effect = CATALOGUE[name]
    assert effect.name == name
    assert len((effect.__doc__ or "").split()) > 10
    assert effect.source
    assert effect.told_apart_by
    assert set(effect.confused_with) <= {*CATALOGUE, *FITTED} - {name}
    assert effect.confused_with
    assert set(effect.never_with) <= set(CATALOGUE) - {name}
    for f in dataclasses.fields(effect):
        assert f.metadata["doc"], f.name
    assert make_effect(name, make_effect(name, {}).to_dict()) == make_effect(name, {})


def neutral_of(name: str) -> dict[str, float]:
    """Return the values with which an effect says that it does nothing."""
    effect = CATALOGUE[name]
    values = {n: f.neutral for n, f in fittings(effect).items() if not (f.each or f.most)}
    neutral = {n: value for n, value in values.items() if value is not None}
    if effect.weakest and effect.weakest.size:
        neutral[effect.weakest.size] = effect.weakest.neutral
    return neutral | NEUTRAL.get(name, {})


def check_neutral(name: str) -> None:
    neutral = neutral_of(name)
    assert bool(neutral) != (name in THERE_OR_NOT), "say what it is when it does nothing"
    if neutral:
        plain, with_it = (
            film(bare(), 4.0, strips=2),
            film(bare().with_effect(name, **neutral), 4.0, strips=2),
        )
        assert np.array_equal(with_it.level, plain.level)
        assert np.array_equal(with_it.frame_time_s, plain.frame_time_s)
    # And with its defaults it does something.
    long, bare_long = rows_with(name, 90.0), film(bare(), 90.0)
    assert not (
        np.array_equal(long.level, bare_long.level)
        and np.array_equal(long.frame_time_s, bare_long.frame_time_s)
    )


def check_strength(name: str) -> None:
    assert name in STRENGTH, "measure here how strong it is, by the rows alone"
    measure, values, within = STRENGTH[name]
    expected = values[0] if values else 1.0
    assert measure(*values) == pytest.approx(expected, rel=within)


def check_sought(name: str) -> None:
    """It is proposed for what it leaves, or is sought elsewhere, or says why it isn't."""
    rng = np.random.default_rng(1)
    sawtooth = 1.0 - 0.2 * (np.arange(900) % 30) / 29
    angle = 0.01 * rng.standard_normal(900)
    angle[300:] += TURN * F0_HZ / RATE_HZ
    angle[600:] -= TURN * F0_HZ / RATE_HZ
    size = np.where(np.arange(900) == 0, 2.0, sawtooth)
    features = ResidualFeatures(0.2, 0.3, F0_HZ / RATE_HZ, angle, size, (8.8, 733.0), (5.2, -3.1))
    proposed = CATALOGUE[name].guesses(features)
    for values in proposed:
        make_effect(name, values)
    assert (
        proposed
        or name in SOUGHT_ELSEWHERE
        or left_out().get(name, Effect.not_hidden) != (Effect.not_hidden)
    )


def check_listed(name: str) -> None:
    """A blind test hides it, as strong as it says; or it says why it can't be hidden."""
    effect = CATALOGUE[name]
    if effect.weakest is None:
        assert effect.not_hidden != Effect.not_hidden
        assert left_out()[name] == effect.not_hidden
        return
    assert name in listed()
    assert any(case.hidden == (name,) for case in CasePlan(each=1, pairs=0).cases())
    for seed in range(3):
        rng = np.random.default_rng(seed)
        hiding = Hiding(rng, 3.0, 1800, Fraction(30), 0.001, 0.3)
        hidden = make_effect(name, effect.hidden(hiding))
        weakest = effect.weakest
        if weakest.size:
            off = abs(getattr(hidden, weakest.size) - weakest.neutral)
            assert off == pytest.approx(3.0 * weakest.change)


CHECKS = (check_facts, check_neutral, check_strength, check_sought, check_listed)


@pytest.mark.parametrize("name", CATALOGUE)
@pytest.mark.parametrize("check", CHECKS, ids=lambda c: c.__name__[6:])
def test_every_effect(check: Callable[[str], None], name: str) -> None:
    check(name)


class Doubled(RowBanding):
    """The pattern twice: it is half as strong by what it says as by what it does."""

    def apply(self, light: LineLight, run: Run) -> None:
        super().apply(light, run)
        super().apply(light, run)


class Unlisted(Harmonics):
    """Says neither how weak it may be nor why it can't be hidden, for whatever reason it has."""

    weakest: ClassVar[Weakest | None] = None


class NeverNothing(RowBanding):
    """Adds a level even where it says that it does nothing at all, which nobody would see."""

    def apply(self, light: LineLight, run: Run) -> None:
        super().apply(light, run)
        light.level = light.level + np.float32(1e-3)


class Idle(SensorEffect):
    """Does nothing at all, with whatever parameters it is given, and says that it does a lot."""

    name = "row_banding"
    source = told_apart_by = "nowhere"
    confused_with = ("texture",)

    def apply(self, light: LineLight, run: Run) -> None:
        pass


class Lookalike(RowBanding):
    """Looks like something that there isn't in any catalogue, so that nobody can tell it apart."""

    confused_with = ("no_such_effect",)


@pytest.mark.parametrize(
    ("fault", "check"),
    [
        (Doubled, check_strength),
        (Unlisted, check_listed),
        (NeverNothing, check_neutral),
        (Idle, check_neutral),
        (Idle, check_sought),
        (Lookalike, check_facts),
    ],
    ids=lambda x: x.__name__,
)
def test_a_fault_is_caught(
    fault: type[Effect], check: Callable[[str], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(CATALOGUE, "_items", dict(CATALOGUE._items))
    CATALOGUE.register(fault.name, fault)
    with pytest.raises(AssertionError):
        check(fault.name)


class New(LightEffect):
    """An effect that nobody has measured yet, as whoever adds one to the catalogue has it first."""

    name = "new"
    source = told_apart_by = "nowhere"
    confused_with = ("texture",)

    def apply(self, light: LineLight, run: Run) -> None:
        pass


def test_a_new_effect_has_to_be_measured_and_listed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(CATALOGUE, "_items", dict(CATALOGUE._items))
    CATALOGUE.register("new", New)
    for check in (check_neutral, check_strength, check_sought, check_listed):
        with pytest.raises(AssertionError):
            check("new")
    assert left_out()["new"] == Effect.not_hidden

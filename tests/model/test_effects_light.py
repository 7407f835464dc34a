"""Effects on the light and on what sensor and codec make of it, measured on rows."""

from __future__ import annotations

import dataclasses
from fractions import Fraction

import numpy as np
import pytest

from rsenf.model import Scene, Sensor, simulate_rows
from tests.model.bare import (
    DEPTH,
    F0_HZ,
    FLAT,
    LEVEL,
    PHASE,
    RATE_HZ,
    STEADY,
    bare,
    film,
    fit,
    frame_tones,
    line_times_s,
    wave,
)

TURN = 2 * np.pi


def test_harmonics_are_what_they_say() -> None:
    model = bare().with_effect(
        "harmonics", second_ratio=0.3, third_ratio=0.1, second_phase_rad=1.0, third_phase_rad=-2.0
    )
    data = film(model)
    lines = fit(data.level, line_times_s(data.frame_time_s), [100.0, 200.0, 300.0])
    assert np.abs(lines) == pytest.approx([0.5, 0.15, 0.05], abs=3e-5)
    assert np.angle(lines) == pytest.approx(
        [PHASE, 2 * PHASE + 1.0, np.angle(np.exp(1j * (3 * PHASE - 2.0)))], abs=1e-3
    )


@pytest.mark.parametrize("exponent", [0.6, 1.4])
def test_gamma_bends_levels_and_noise(exponent: float) -> None:
    data = film(bare().with_effect("gamma", exponent=exponent), 2.0)
    t_s = line_times_s(data.frame_time_s)
    curve = 255 * (LEVEL * wave(t_s) / 255) ** exponent
    assert data.level[:, :, 0] == pytest.approx(curve, abs=0.2)
    weak = film(bare(flicker=0.05).with_effect("gamma", exponent=exponent))
    lines = np.abs(fit(weak.level, line_times_s(weak.frame_time_s), [100.0, 200.0]))
    assert lines[0] == pytest.approx(0.05 * exponent, rel=2e-3)
    assert lines[1] / lines[0] == pytest.approx(abs(exponent - 1) / 4 * 0.05, rel=0.1)


def test_gamma_s_noise_is_that_of_pixels_through_the_curve() -> None:
    sensor = Sensor(white_e=5000.0, read_noise_e=20.0)
    rng = np.random.default_rng(3)
    for level in (60.0, 160.0):
        model = bare(Scene(mean_level=level, texture_ratio=0.0, vignetting_ratio=0.0), 0.0)
        model = dataclasses.replace(model, sensor=sensor).with_effect("gamma", exponent=0.5)
        electrons = rng.poisson(level / 255 * 5000, 400_000) + 20.0 * rng.standard_normal(400_000)
        pixels = np.round(255 * (np.clip(electrons, 0, None) / 5000) ** 0.5)
        got = film(model, 10.0).level
        assert np.var(got) * 320 == pytest.approx(np.var(pixels), rel=0.03)
        assert np.mean(got) == pytest.approx(np.mean(pixels), abs=0.15)


def test_a_second_lamp_shows_in_strips_alone() -> None:
    model = bare().with_effect("second_lamp", weight=0.2, phase_rad=2.0, tilt_ratio=0.9)
    data = film(model, 2.0, strips=4)
    t_s = line_times_s(data.frame_time_s)
    for strip in range(4):
        slow = np.zeros(t_s.shape)
        for pixel in range(80 * strip, 80 * (strip + 1)):  # one pixel after the other
            share = 0.2 * (1 + 0.9 * (2 * (pixel + 0.5) / 320 - 1))
            slow += ((1 - share) * wave(t_s) + share * wave(t_s, PHASE + 2.0)) / 80
        assert data.level[:, :, strip] == pytest.approx(LEVEL * slow, abs=0.25)
    means = film(model, 2.0).level[:, :, 0]
    one_tone = fit(means, t_s, [F0_HZ])[0]
    rest = means - LEVEL * (1 + np.real(one_tone * np.exp(1j * TURN * F0_HZ * t_s)))
    assert np.std(rest) == pytest.approx(np.sqrt((LEVEL * 255e-6 + 1 / 12) / 320), rel=0.05)


def test_a_second_lamp_of_another_kind() -> None:
    model = bare().with_effect(
        "second_lamp", weight=0.4, phase_rad=1.0, tilt_ratio=0.0, lamp="ideal"
    )
    data = film(model, 2.0)
    t_s = line_times_s(data.frame_time_s)
    # Its light written out: |cos| of half the phase over its mean, to eight harmonics.
    rectified = np.abs(np.cos((TURN * F0_HZ * t_s + PHASE + 1.0) / 2)) * np.pi / 2
    slow = LEVEL * (0.6 * wave(t_s) + 0.4 * rectified)
    assert data.level[:, :, 0] == pytest.approx(slow, abs=LEVEL * 0.4 * 0.1)
    assert np.mean(np.abs(data.level[:, :, 0] - slow)) < LEVEL * 0.4 * 0.01


@pytest.mark.parametrize("exposure_s", [0.0, 0.0004, 0.001])
def test_a_pwm_tone_is_a_line_that_exposure_can_hide(exposure_s: float) -> None:
    model = bare().with_effect("pwm_tone", tone_hz=1000.0, depth_ratio=0.02)
    data = film(model.with_effect("exposure", exposure_s=exposure_s), 5.0)
    t_s = line_times_s(data.frame_time_s)
    # The mean of a tone over an exposure, by adding it up.
    slow = abs(np.mean(np.exp(1j * TURN * 1000.0 * np.linspace(0, exposure_s, 10_001)[:-1])))
    assert abs(fit(data.level, t_s, [100.0, 1000.0])[1]) == pytest.approx(0.02 * slow, abs=2e-5)


@pytest.mark.parametrize("duty", [0.5, 0.8])
def test_pulses_switch_a_lamp_off(duty: float) -> None:
    """Against the share of each exposure in which it is on, written out."""
    depth, exposure_s, tone_hz = 2 * float(np.sinc(duty)), 0.0011, 170.0
    values = {"tone_hz": tone_hz, "depth_ratio": depth, "phase_rad": 0.5, "duty_ratio": duty}
    model = bare(flicker=0.0).with_effect("pwm_tone", **values)
    data = film(model.with_effect("exposure", exposure_s=exposure_s), 2.0)

    def on_until(t_s: np.ndarray) -> np.ndarray:
        turns = tone_hz * t_s + 0.5 / TURN + duty / 2  # a pulse begins with each whole one
        return (np.floor(turns) * duty + np.minimum(turns % 1.0, duty)) / tone_hz

    begin_s = line_times_s(data.frame_time_s)
    lit = (on_until(begin_s + exposure_s) - on_until(begin_s)) / exposure_s / duty
    assert data.level[:, :, 0] == pytest.approx(LEVEL * lit, abs=0.02 * LEVEL / duty)


@pytest.mark.parametrize("exposure_s", [0.0, 0.01])
def test_stripes_move_past_the_lines(exposure_s: float) -> None:
    values = {"depth_ratio": 0.3, "stripes": 3.0, "rate_hz": -25.0, "phase_rad": 0.2}
    model = bare().with_effect("moving_stripes", **values)
    data = film(model.with_effect("exposure", exposure_s=exposure_s), 5.0)
    begin_s, height = line_times_s(data.frame_time_s), np.arange(64) / 64
    during_s = (np.arange(200) + 0.5) / 200 * exposure_s  # added up over the exposure
    light = [
        1 + 0.3 * np.cos(TURN * (3.0 * height + 25.0 * (begin_s + late_s)) + 0.2)
        for late_s in during_s
    ]
    flicker = np.mean([wave(begin_s + late_s) for late_s in during_s], axis=0)
    expected = LEVEL * np.mean(light, axis=0) * flicker
    assert data.level[:, :, 0] == pytest.approx(expected, abs=0.2)


def test_stripes_of_averaged_rows_are_the_mean_of_rows() -> None:
    rows = bare(flicker=0.0).with_effect("moving_stripes", stripes=11.0, rate_hz=-40.0)
    lines = dataclasses.replace(rows, shutter=dataclasses.replace(rows.shutter, rows=16))
    mean = film(rows, 2.0).level.reshape(-1, 16, 4, 1).mean(axis=2)
    made = simulate_rows(lines, STEADY, 2.0, 1, noise=False, averaged_rows=4).level
    assert made == pytest.approx(mean, abs=0.05)


def test_an_interharmonic_has_side_lines() -> None:
    data = film(bare().with_effect("interharmonic", flicker_hz=8.8, depth_ratio=0.02), 20.0)
    t_s = line_times_s(data.frame_time_s)
    own, below, above = np.abs(fit(data.level, t_s, [8.8, 91.2, 108.8, 100.0]))[:3]
    assert own == pytest.approx(0.02, abs=2e-5)
    assert [below, above] == pytest.approx([DEPTH * 0.02 / 2] * 2, abs=2e-5)


def test_auto_exposure_scales_whole_frames() -> None:
    scene = Scene(texture_ratio=0.1)
    model = bare(scene, 0.0, rows=16).with_effect(
        "auto_exposure", gain_ratio=0.02, time_constant_s=2.0
    )
    level = film(model, 600.0).level[:, :, 0].astype(np.float64)
    gain = level.mean(axis=1) / level.mean()
    assert np.std(gain) == pytest.approx(0.02, rel=0.15)
    lag = round(2 * RATE_HZ)
    assert np.corrcoef(gain[lag:], gain[:-lag])[0, 1] == pytest.approx(np.exp(-1), abs=0.1)
    rest = level - gain[:, None] * level.mean(axis=0)
    assert np.std(rest) == pytest.approx(np.sqrt((LEVEL * 255e-6 + 1 / 12) / 320), rel=0.05)


def test_row_banding_isn_t_lit() -> None:
    data = film(bare().with_effect("row_banding", banding_ratio=0.02))
    t_s = line_times_s(data.frame_time_s)
    found = [fit(data.level[:, row], t_s[:, row], [F0_HZ])[0] for row in range(64)]
    static = np.array([
        np.mean(data.level[:, row, 0] / (1 + np.real(a * np.exp(1j * TURN * F0_HZ * t_s[:, row]))))
        for row, a in enumerate(found)
    ])  # fmt: skip
    assert np.std(static) == pytest.approx(0.02 * LEVEL, rel=0.25)
    flicker = np.abs(found) * static  # levels: the same in every row, whatever its static level
    assert flicker == pytest.approx(np.full(64, DEPTH * LEVEL), rel=1e-3)


def test_a_moving_object_comes_back() -> None:
    model = bare(FLAT, 0.0).with_effect(
        "moving_object", width_ratio=0.25, height_ratio=0.25, top_ratio=0.5, period_s=2.0,
        level_ratio=0.5, texture_ratio=0.0,
    )  # fmt: skip
    data = film(model, 4.0, strips=2)
    for n, t_s in enumerate(data.frame_time_s.tolist()):
        part = (t_s / 2.0) % 1.0
        left = round((320 - 80) * (2 * part if part < 0.5 else 2 - 2 * part))
        picture = np.full((64, 320), LEVEL)
        picture[32:48, left : left + 80] = LEVEL / 2
        slow = picture.reshape(64, 2, 160).mean(axis=2)
        assert data.level[n] == pytest.approx(slow, abs=0.25)


def test_gop_attenuation_is_a_sawtooth() -> None:
    data = film(bare().with_effect("gop_attenuation", loss_ratio=0.3, period_frames=12))
    depth = np.abs(frame_tones(data, line_times_s(data.frame_time_s)))
    for n in range(len(depth)):
        assert depth[n] == pytest.approx(DEPTH * (1 - 0.3 * (n % 12) / 11), rel=2e-3)


@pytest.mark.parametrize(("frame_rate", "rate_hz"), [("30000/1001", RATE_HZ), ("25", 25.0)])
def test_codec_lowpass_keeps_what_its_alias_lets_through(frame_rate: str, rate_hz: float) -> None:
    gain = 0.2
    model = bare(frame_rate=Fraction(frame_rate)).with_effect("codec_lowpass", gain=gain)
    data = film(model, 20.0)
    t_s = line_times_s(data.frame_time_s, read_out_s=0.7 / rate_hz)
    # The law is run on one line's light, a frame at a time, beside the model.
    line = 10
    wanted = LEVEL * wave(t_s[:, line])
    coded = [wanted[0]]
    for x in wanted[1:]:
        coded.append(coded[-1] + gain * (x - coded[-1]))
    assert data.level[:, line, 0] == pytest.approx(coded, abs=0.12)
    settled = slice(len(t_s) // 2, None)
    kept = abs(fit(data.level[settled], t_s[settled], [F0_HZ])[0]) / DEPTH
    turn = np.exp(-1j * TURN * F0_HZ / rate_hz)
    assert kept == pytest.approx(abs(gain / (1 - (1 - gain) * turn)), rel=0.01)

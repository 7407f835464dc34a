"""Effects on when frames and lines are exposed, each measured on the rows it makes."""

from __future__ import annotations

import numpy as np
import pytest

from rsenf.model import Scene, Shake
from tests.model.bare import (
    F0_HZ,
    FLAT,
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

NOISE = 0.12  # six times that of a line's mean, levels
TURN = 2 * np.pi


@pytest.mark.parametrize("clock_ppm", [-300.0, 300.0])
def test_clock_skew_makes_the_enf_read_low(clock_ppm: float) -> None:
    data = film(bare().with_effect("clock_skew", clock_ppm=clock_ppm))
    t_s = line_times_s(data.frame_time_s)
    phase = np.unwrap(phase_error_rad(frame_tones(data, t_s)))
    seen_hz = F0_HZ + np.polyfit(data.frame_time_s, phase, 1)[0] / TURN
    assert seen_hz == pytest.approx(F0_HZ / (1 + clock_ppm * 1e-6), abs=1e-4)
    assert (seen_hz < F0_HZ) == (clock_ppm > 0)
    assert data.truth["clock_ppm"] == clock_ppm


@pytest.mark.parametrize("exposure_s", [0.0, 0.003, 0.005, 0.01])
def test_exposure_is_a_mean_over_time(exposure_s: float) -> None:
    model = bare().with_effect("harmonics", second_ratio=0.4)
    data = film(model.with_effect("exposure", exposure_s=exposure_s), 1.0)
    t_s = line_times_s(data.frame_time_s)
    slow = np.zeros(t_s.shape)
    for k in range(1000):
        now = t_s + (k + 0.5) / 1000 * exposure_s
        second = 0.2 * np.cos(2 * (TURN * F0_HZ * now + PHASE))
        slow += (wave(now) + second) / 1000
    assert data.level[:, :, 0] == pytest.approx(LEVEL * slow, abs=NOISE)
    assert data.truth["exposure_s"] == exposure_s


def test_capture_jitter_is_white_and_in_the_phase() -> None:
    data = film(bare().with_effect("capture_jitter", jitter_s=1e-4), 60.0)
    assert data.frame_time_s == pytest.approx(np.arange(1798) / RATE_HZ)  # the stamps don't know
    late_s = phase_error_rad(frame_tones(data, line_times_s(data.frame_time_s))) / (TURN * F0_HZ)
    true_s = np.array(data.truth["frame_start_s"]) - data.frame_time_s
    assert late_s == pytest.approx(true_s, abs=2e-6)
    assert np.std(late_s) == pytest.approx(1e-4, rel=0.06)
    assert abs(np.corrcoef(late_s[1:], late_s[:-1])[0, 1]) < 0.08


@pytest.mark.parametrize("stamped", [True, False])
def test_variable_frame_rate(stamped: bool) -> None:
    model = bare().with_effect(
        "variable_frame_rate", rate_ratio=1e-3, time_constant_s=1.0, stamped=stamped
    )
    data = film(model, 120.0)
    start_s = np.array(data.truth["frame_start_s"])
    change = np.diff(start_s) * RATE_HZ - 1
    assert np.std(change) == pytest.approx(1e-3, rel=0.25)
    assert np.corrcoef(change[30:], change[:-30])[0, 1] == pytest.approx(np.exp(-1), abs=0.2)
    seen = phase_error_rad(frame_tones(data, line_times_s(data.frame_time_s)))
    late_s = start_s - data.frame_time_s
    assert np.exp(1j * seen) == pytest.approx(np.exp(1j * TURN * F0_HZ * late_s), abs=3e-3)
    assert (np.max(np.abs(late_s)) < 1e-6) == stamped


def test_a_crop_is_exactly_a_longer_idle_period() -> None:
    cropped = film(bare().with_effect("rows_cropped", crop_ratio=0.2))
    idle_ratio = 1 - 0.8 * 0.7
    t_s = line_times_s(cropped.frame_time_s, read_out_s=0.8 * 0.7 / RATE_HZ)
    later = wave(t_s + 0.1 * 0.7 / RATE_HZ)
    assert cropped.level[:, :, 0] == pytest.approx(LEVEL * later, abs=NOISE)
    assert cropped.truth["idle_ratio"] == pytest.approx(idle_ratio)
    assert cropped.truth["read_out_time_s"] == pytest.approx((1 - idle_ratio) / RATE_HZ)


def test_readout_drift_steepens_the_ramp() -> None:
    data = film(bare().with_effect("readout_drift", drift_per_min=0.06), 60.0)
    line = np.arange(64)
    for n in (0, 500, 1797):
        # The read-out time that explains this frame best, by trying many.
        tries_s = np.linspace(0.65, 0.8, 601) / RATE_HZ
        miss = [
            np.sum((data.level[n, :, 0] - LEVEL * wave(n / RATE_HZ + line / 64 * t)) ** 2)
            for t in tries_s
        ]
        minutes = n / RATE_HZ / 60
        expected_s = 0.7 / RATE_HZ * (1 + 0.06 * minutes)
        assert tries_s[np.argmin(miss)] == pytest.approx(expected_s, rel=1e-3)


def test_readout_drift_of_any_course_wanders_about_the_middle_line() -> None:
    effect = {"course": "any", "drift_ratio": 0.05, "drift_per_min": 0.2}
    data = film(bare().with_effect("readout_drift", **effect), 60.0)
    from_middle = np.arange(64) - 31.5
    tries = np.linspace(-0.2, 0.2, 401)
    line_s = 31.5 / 64 * 0.7 / RATE_HZ + np.outer(1 + tries, from_middle / 64 * 0.7 / RATE_HZ)
    frames = np.arange(0, 1797, 20)
    found = [
        tries[np.argmin(np.sum((level - LEVEL * wave(n / RATE_HZ + line_s)) ** 2, axis=1))]
        for n, level in zip(frames, data.level[frames, :, 0], strict=True)
    ]
    even = np.polyval(np.polyfit(frames, found, 1), frames)
    assert np.std(found - even) == pytest.approx(0.05, rel=0.4)


def test_reverse_readout_begins_at_the_bottom() -> None:
    data = film(bare().with_effect("reverse_readout"))
    t_s = line_times_s(data.frame_time_s)[:, ::-1]
    assert data.level[:, :, 0] == pytest.approx(LEVEL * wave(t_s), abs=NOISE)


@pytest.mark.parametrize(("bottom_first", "late_s"), [(False, 0.0), (True, 0.0), (True, -3e-4)])
def test_interlace_weaves_two_fields(bottom_first: bool, late_s: float) -> None:
    values = {"bottom_first": bottom_first, "second_late_s": late_s}
    data = film(bare().with_effect("interlace", **values), 2.0)
    for row in range(64):
        second_field = (row % 2 == 1) != bottom_first
        offset_s = (row // 2) * (0.7 / RATE_HZ / 64) + second_field * (0.5 / RATE_HZ + late_s)
        slow = LEVEL * wave(data.frame_time_s + offset_s)
        assert data.level[:, row, 0] == pytest.approx(slow, abs=NOISE)


TEXTURED = Scene(texture_ratio=0.3, vignetting_ratio=0.0)


def moved_rows(data: object, still: np.ndarray) -> np.ndarray:
    """How many rows further down each frame looks, by trying every shift of a tenth of a row."""
    rows, tries = np.arange(64), np.linspace(-8, 8, 161)
    inner = slice(10, -10)
    shifted = np.array([np.interp(rows + s, rows, still)[inner] for s in tries])
    return np.array([
        tries[np.argmin(np.sum((shifted - frame[inner]) ** 2, axis=1))] for frame in data
    ])  # fmt: skip


def test_image_wobble_moves_texture_and_phase_together() -> None:
    def wobbling(scene: Scene, flicker: float, residual_ratio: float) -> np.ndarray:
        model = bare(scene, flicker).with_effect(
            "image_wobble", wobble_rows=1.5, residual_ratio=residual_ratio
        )
        return film(model, 20.0)

    still = film(bare(TEXTURED, 0.0), 1.0).level.mean(axis=(0, 2))
    down = moved_rows(wobbling(TEXTURED, 0.0, 1.0).level[:, :, 0], still)
    assert np.std(down) == pytest.approx(1.5, rel=0.1)
    assert np.ptp(moved_rows(wobbling(TEXTURED, 0.0, 0.0).level[:, :, 0], still)) == 0
    flickering = wobbling(FLAT, 0.5, 1.0)
    late_s = phase_error_rad(frame_tones(flickering, line_times_s(flickering.frame_time_s)))
    rows = late_s / (TURN * F0_HZ) / (0.7 / RATE_HZ / 64)
    assert rows == pytest.approx(down, abs=0.15)


def test_a_shaken_camera_moves_the_texture_alone() -> None:
    still = film(bare(TEXTURED, 0.0), 1.0).level.mean(axis=(0, 2))
    shaken = Scene(texture_ratio=0.3, vignetting_ratio=0.0, shake=Shake(shake_px=1.0))
    down = moved_rows(film(bare(shaken, 0.0), 30.0).level[:, :, 0], still)
    # Sideways it moves as far, which changes the row means a little.
    assert np.std(down) == pytest.approx(1.0, rel=0.25)
    lag = round(0.1 * RATE_HZ)
    assert np.corrcoef(down[lag:], down[:-lag])[0, 1] == pytest.approx(np.exp(-1), abs=0.15)
    flat = Scene(texture_ratio=0.0, vignetting_ratio=0.0, shake=Shake(shake_px=1.0))
    data = film(bare(flat), 2.0)
    tone = fit(data.level, line_times_s(data.frame_time_s), [F0_HZ])[0]
    assert phase_error_rad(tone) == pytest.approx(0.0, abs=1e-3)

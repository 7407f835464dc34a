"""The matcher on measured data: a real camera, real grids with their gaps."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rsenf.match import Match, MatchSettings
from rsenf.match.correlate import match_ncc
from rsenf.match.series import Track
from rsenf.reference import Reference, read_reference, reference_blocks
from tests.match.decision_rates import Trials, grid_of_reference
from tests.match.match_clips import SMEAR_STD_HZ, clip_of, estimates_from, grid_from

pytestmark = pytest.mark.measured

STATIC = [
    "exp_HAL_50cm_wall",
    "exp_HAL_150cm_wall",
    "exp_HAL_300cm_wall",
    "exp_INC_100cm_wall",
    "exp_INC_200cm_wall",
    "exp_INC_350cm_wall",
]


def plain_stft(luminance, rate_hz, window_s=20.0, limit_hz=0.15):
    """A textbook STFT of frame means at the alias of 100 Hz; far outliers are unusable."""
    window = round(window_s * rate_hz)
    weights = np.hanning(window + 1)[:window]
    carrier_hz = 3 * rate_hz
    out = []
    for second in range(int((luminance.size - window) / rate_hz) + 1):
        part = luminance[round(second * rate_hz) :][:window]
        line = np.polyval(np.polyfit(np.arange(window), part, 1), np.arange(window))
        power = np.abs(np.fft.rfft((part - line) * weights, 16 * window))
        bins_hz = np.fft.rfftfreq(16 * window, 1 / rate_hz)
        near = np.flatnonzero(np.abs(bins_hz - (100 - carrier_hz)) < 1.0)
        peak = near[np.argmax(power[near])]
        a, b, c = np.log(power[peak - 1 : peak + 2])
        alias_hz = bins_hz[peak] + 0.5 * (a - c) / (a - 2 * b + c) * bins_hz[1]
        out.append((alias_hz + carrier_hz) / 2)
    enf = np.array(out)
    enf[np.abs(enf - np.median(enf)) > limit_hz] = np.nan
    variance = np.full(enf.size, 0.2e-3**2 + SMEAR_STD_HZ**2)
    return Track(window_s / 2, 1.0, window_s, enf, variance, 50.0)


def camera_clip(data: Path, name: str):
    with np.load(data / "gopro_luminance" / f"{name}.npz") as file:
        track = plain_stft(file["luminance"], float(file["frame_rate_hz"]))
        return track, file["mains_enf_combined_hz"], file["photodiode_enf_combined_hz"] / 2


@pytest.mark.parametrize("name", STATIC)
def test_real_camera_is_found_in_both_references(measured_data, name):
    track, mains_hz, photodiode_hz = camera_clip(measured_data, name)
    mains, photodiode = (
        match_ncc(track, grid_from(hz), MatchSettings()) for hz in (mains_hz, photodiode_hz)
    )
    for found in (mains, photodiode):
        assert found.decision == "match"
        assert found.correlation >= 0.98
    assert mains.lag_s == pytest.approx(photodiode.lag_s, abs=1)
    assert photodiode.residual_std_hz < 0.35e-3
    assert 67 < photodiode.clock_ppm < 76  # the camera's clock is fast by about 70 ppm
    assert abs(mains.clock_ppm - photodiode.clock_ppm) < 4 * mains.clock_std_ppm


def test_moving_clip_is_matched_or_left_open(measured_data):
    track, mains_hz, photodiode_hz = camera_clip(measured_data, "experiment_a")
    findings = [
        match_ncc(track, grid_from(hz), MatchSettings()) for hz in (mains_hz, photodiode_hz)
    ]
    assert {f.decision for f in findings} <= {"match", "no_decision"}
    if all(f.decision == "match" for f in findings):
        assert findings[0].lag_s == pytest.approx(findings[1].lag_s, abs=1)


def gappy(data: Path) -> Reference:
    return read_reference(data / "grid_ce_2024-08-13_to_21_gappy_1s.csv.gz")


def test_five_minutes_with_a_gap_inside_are_found_in_a_gappy_week(measured_data):
    reference = gappy(measured_data)
    freq = reference.freq_hz
    # The other recording of the same minutes has what this one's gap leaves out: none is on file,
    # so the gap is cut into a whole stretch after the clip is taken from it.
    start = 400_000
    while np.isnan(freq[start - 30 : start + 400]).any():
        start += 50
    clip = clip_of(freq[start - 30 : start + 400], 30.4, 300, seed=3, ppm=60, std_hz=0.5e-3)
    freq[start + 140 : start + 165] = np.nan
    stage = Match()
    results = []
    for message in [
        *reference_blocks(reference, source="reference/ce"),
        *estimates_from(clip),
    ]:
        results += stage.update(message)
    (result,) = results + stage.flush()
    assert result.decision == "match"
    assert result.lag_s == pytest.approx(start + 0.4, abs=0.5)
    assert result.start_utc_ns == reference.t0_ns + round(result.lag_s * 1e9)
    assert result.search_size > 300_000
    assert any("possible times fall into gaps" in w for w in result.warnings)
    assert any("no reference at the best time" in w for w in result.warnings)


def test_another_recording_of_the_same_minutes_is_found(measured_data):
    reference = gappy(measured_data)
    other = read_reference(measured_data / "grid_ce_2024-08-19_152602_1s.csv")
    clip = clip_of(other.freq_hz, 40.0, 400, seed=4, std_hz=0.3e-3)
    found = match_ncc(clip, grid_of_reference(reference), MatchSettings())
    assert found.decision == "match"
    start_ns = reference.t0_ns + found.lag_s * 1e9
    assert start_ns / 1e9 == pytest.approx(other.t0_ns / 1e9 + 40.0, abs=1)


@pytest.mark.parametrize(("seconds", "least_true"), [(120, 0.5), (300, 0.95)])
def test_decisions_are_true_or_not_made(measured_data, seconds, least_true):
    """Clips of the second half of a day; the thresholds were chosen on the first half."""
    day = read_reference(measured_data / "grid_ce_2022-09-17_1s.csv.gz").freq_hz[43_200:]
    present = Trials(day, day).run(seconds, 20, seed=71, present=True)
    assert present.false == 0
    assert present.true >= least_true * 20
    week = gappy(measured_data).freq_hz[:200_000]
    absent = Trials(day, week).run(seconds, 20, seed=72, present=False)
    assert absent.false == 0

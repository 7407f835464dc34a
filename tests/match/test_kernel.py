"""What a 20 s window does to a grid's frequency, against windows on a real tone."""

from __future__ import annotations

import numpy as np
import pytest

from rsenf.match.clip_phase import average, window_kernel
from tests.match.match_clips import wandering_grid


def strongest_frequency(signal, rate_hz, window_s, centre_s, around_hz):
    """Brute force: the maximum of the windowed periodogram, by golden section on a fine grid."""
    t_s = np.arange(signal.size) / rate_hz - centre_s
    near = np.abs(t_s) <= window_s / 2
    t, w = t_s[near], np.cos(np.pi * t_s[near] / window_s) ** 2
    low, high = around_hz - 0.04, around_hz + 0.04
    for _ in range(4):
        trial = np.linspace(low, high, 81)
        power = np.abs(np.exp(-2j * np.pi * trial[:, None] * t) @ (w * signal[near]))
        best = trial[int(np.argmax(power))]
        step = trial[1] - trial[0]
        low, high = best - step, best + step
    return best


@pytest.mark.parametrize("window_s", [10.0, 20.0])
def test_estimates_on_a_tone_are_the_kernel_average(window_s):
    rate_hz, seconds, around_hz = 20, 200, 0.05
    deviation = wandering_grid(seconds, seed=4) - 50.0
    # A piecewise constant frequency: each sample is exactly the mean over its second.
    phase = 2 * np.pi * np.cumsum(np.repeat(deviation, rate_hz) + around_hz) / rate_hz
    averaged = average(deviation + around_hz, window_kernel(window_s, 1.0))
    found, expected = [], []
    for second in range(20, 180, 7):
        found.append(
            strongest_frequency(
                np.exp(1j * phase), rate_hz, window_s, second + 0.5 - 1 / rate_hz, around_hz
            )
        )
        expected.append(averaged[second])
    error_hz = np.array(found) - np.array(expected)
    smear_hz = np.array(expected) - (deviation + around_hz)[20:180:7]
    assert np.abs(error_hz).max() < 5e-5
    assert np.sqrt(np.mean(error_hz**2)) < 0.03 * np.sqrt(np.mean(smear_hz**2))


@pytest.mark.parametrize(("window_s", "step_s"), [(20, 1), (20, 2), (20, 0.1), (7, 3), (1, 2)])
def test_weights_are_symmetric_and_sum_to_one(window_s, step_s):
    weights = window_kernel(window_s, step_s)
    assert weights.size % 2 == 1
    assert weights.sum() == pytest.approx(1)
    np.testing.assert_allclose(weights, weights[::-1], atol=1e-12)
    assert (weights >= -1e-12).all()


def test_nothing_is_made_up_beside_a_gap():
    freq = wandering_grid(200, seed=1)
    freq[90:93] = np.nan
    weights = window_kernel(20.0, 1.0)
    half = weights.size // 2
    smooth = average(freq, weights)
    for i in range(200):
        reach = freq[max(i - half, 0) : i + half + 1]
        if i < half or i >= 200 - half or np.isnan(reach).any():
            assert np.isnan(smooth[i])
        else:
            assert smooth[i] == pytest.approx(float(reach @ weights), abs=1e-12)


def test_a_series_shorter_than_the_window_has_no_average():
    assert np.isnan(average(np.full(5, 50.0), window_kernel(20.0, 1.0))).all()

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest

from rsenf.model import synthetic_grid

MEASURED = Path(__file__).parents[3] / "shared/data/grid_ce_2022-09-17_1s.csv.gz"
LAGS_S = np.array([1, 10, 60, 300])


def spread_mhz(freq_hz: np.ndarray) -> np.ndarray:
    return np.array([1e3 * np.std(freq_hz[lag:] - freq_hz[:-lag]) for lag in LAGS_S])


def test_same_seed_same_path_and_a_longer_one_begins_with_the_shorter() -> None:
    short, again, long = (synthetic_grid(7, d).freq_hz for d in (100, 100, 1000))
    assert np.array_equal(short, again)
    assert np.array_equal(short, long[: short.size])
    assert not np.array_equal(short, synthetic_grid(8, 100).freq_hz)


def test_mean_spread_and_smoothness_of_days() -> None:
    days = [synthetic_grid(seed, 86_400).freq_hz for seed in range(3)]
    assert np.mean(days) == pytest.approx(50.0, abs=2e-3)
    assert np.std(days) == pytest.approx(0.02, rel=0.1)
    # The figures that the module's text gives.
    assert np.mean([spread_mhz(d) for d in days], axis=0) == pytest.approx(
        [1.3, 7.6, 14, 23], rel=0.1
    )


def unrest_mhz(freq_hz: np.ndarray) -> tuple[float, float]:
    """Change over 40 s, rms: at the most restless minute of the quarter, and at a usual one."""
    change = (freq_hz[40:] - freq_hz[:-40]) ** 2
    folded = change[: change.size // 900 * 900].reshape(-1, 900).mean(axis=0)
    minutes = np.array([np.roll(folded, -k)[:60].mean() for k in range(900)])
    return 1e3 * float(np.sqrt(minutes.max())), 1e3 * float(np.sqrt(np.median(minutes)))


def test_schedules_change_each_quarter_of_an_hour() -> None:
    unrest = np.mean(
        [unrest_mhz(synthetic_grid(seed, 86_400).freq_hz) for seed in range(4)], axis=0
    )
    assert unrest == pytest.approx([16.3, 12.5], abs=0.7)


def test_spread_and_nominal_follow_the_parameters() -> None:
    quiet = synthetic_grid(1, 36_000, nominal_hz=60.0, std_hz=0.005)
    assert quiet.nominal_hz == 60.0
    assert np.mean(quiet.freq_hz) == pytest.approx(60.0, abs=2e-3)
    assert np.std(quiet.freq_hz) == pytest.approx(0.005, rel=0.2)


@pytest.mark.measured
@pytest.mark.skipif(not MEASURED.exists(), reason="the measured grid data isn't beside the repo")
def test_it_moves_like_a_measured_day() -> None:
    with gzip.open(MEASURED, "rt") as lines:
        measured = np.array([float(line.split(",")[1]) for line in list(lines)[1:]])
    drawn = np.mean([spread_mhz(synthetic_grid(s, 86_400).freq_hz) for s in range(3)], axis=0)
    assert drawn == pytest.approx(spread_mhz(measured), rel=0.15)
    restless = np.mean([unrest_mhz(synthetic_grid(s, 86_400).freq_hz) for s in range(3)], axis=0)
    assert restless == pytest.approx(unrest_mhz(measured), rel=0.1)

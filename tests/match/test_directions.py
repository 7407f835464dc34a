"""Where the direction of read-out can't be told, both signs of the ENF's deviation are compared."""

from __future__ import annotations

import numpy as np
import pytest

from rsenf.match.series import Grid
from rsenf.match.stage import Match
from rsenf.messages import EnfEstimate, Header, MatchResult
from rsenf.rows.stage import blocks_from_luminance
from rsenf.track import TrackSettings, make_tracker
from tests.discrepancy.foreign_camera import Case, film

LENGTH_S, LAG_S, SECONDS = 60, 400, 1200
BEYOND_S = 2  # of the grid's course that is known before the film and after it


@pytest.fixture(scope="module")
def upward() -> tuple[list[EnfEstimate], np.ndarray]:
    """A film at 25 frames/s on 50 Hz that is read from the last row to the first, and its grid."""
    case = Case(
        hidden=("reverse_readout",), seed=84, rate="25", nominal_hz=50.0, lamp="led",
        duration_s=LENGTH_S, rows=240, strips=2,
    )  # fmt: skip
    filmed = film(case)
    tracker = make_tracker(TrackSettings())
    blocks = blocks_from_luminance(filmed.level, filmed.stamp_s, Header())
    estimates = [e for block in blocks for e in tracker.update(block)] + tracker.flush()
    second = np.arange(-BEYOND_S, LENGTH_S + BEYOND_S, dtype=np.float64)
    return estimates, np.asarray(filmed.mean_hz(second, second + 1.0))


def decided(estimates: list[EnfEstimate], grid: Grid) -> MatchResult:
    match = Match(grids=[grid])
    out = [r for e in estimates for r in match.update(e)] + match.flush()
    assert isinstance(out[-1], MatchResult)
    return out[-1]


def reference(seed: int) -> np.ndarray:
    """Another grid's course: an Ornstein-Uhlenbeck process, smoothed over some seconds."""
    rng = np.random.default_rng(seed)
    away_hz = np.zeros(SECONDS + 8)
    for k in range(1, away_hz.size):
        away_hz[k] = 0.995 * away_hz[k - 1] + 0.002 * rng.standard_normal()
    return 50.0 + np.convolve(away_hz, np.ones(9) / 9, "valid")


def test_the_estimates_say_that_the_sign_is_assumed(
    upward: tuple[list[EnfEstimate], np.ndarray],
) -> None:
    estimates, true_hz = upward
    usable = [e for e in estimates if e.usable]
    assert len(usable) > LENGTH_S / 2
    for e in usable:
        assert e.mirror_hz == pytest.approx(50.0, abs=1e-4)
        mirrored_hz = 2.0 * e.mirror_hz - e.enf_hz
        off_hz = mirrored_hz - true_hz[BEYOND_S + int(e.t_s)]
        assert abs(off_hz) < 6.0 * np.sqrt(e.enf_var_hz2) + 1e-4


def test_an_upward_read_out_is_found_in_its_reference(
    upward: tuple[list[EnfEstimate], np.ndarray],
) -> None:
    estimates, true_hz = upward
    freq_hz = reference(1)
    freq_hz[LAG_S - BEYOND_S : LAG_S + LENGTH_S + BEYOND_S] = true_hz
    found = decided(estimates, Grid("grid", 50.0, 0, 1.0, freq_hz))
    assert found.decision == "match"
    assert found.lag_s == pytest.approx(LAG_S, abs=1.0)
    assert any("other direction fits better" in warning for warning in found.warnings)


def test_it_is_in_no_other_reference(upward: tuple[list[EnfEstimate], np.ndarray]) -> None:
    found = decided(upward[0], Grid("grid", 50.0, 0, 1.0, reference(2)))
    assert found.decision != "match"

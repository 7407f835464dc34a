"""Camera comparison: what the likelihood ratio says, and what it doesn't."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import integrate, stats

from rsenf.errors import UsageError
from rsenf.idle.coherent import idle_ratio_bound
from rsenf.idle.compare import (
    CROWDED_RATIO,
    FREEDOM,
    MOST_LOG10_LR,
    SHORTEST_S,
    compare_readout,
    is_same_rate,
    log10_ratio,
)
from rsenf.idle.refusals import SLACK_RATIO
from rsenf.messages import IdleEstimate


def estimate(
    read_out_s: float, std_s: float, frame_rate_hz: float = 30.0, **more: str
) -> IdleEstimate:
    return IdleEstimate(
        verdict="estimated",
        read_out_time_s=read_out_s,
        read_out_time_var_s2=std_s**2,
        frame_rate_hz=frame_rate_hz,
        idle_ratio=1 - read_out_s * frame_rate_hz,
        **more,  # type: ignore[arg-type]  # words only
    )


@pytest.mark.parametrize(
    ("one", "two"),
    [
        ((0.020, 3e-4), (0.0203, 3e-4)),
        ((0.020, 3e-4), (0.0215, 3e-4)),
        ((0.011, 1e-3), (0.014, 2e-3)),
        ((0.030, 4e-3), (0.012, 3e-3)),
    ],
)
def test_ratio_equals_slow_integrals(one: tuple[float, float], two: tuple[float, float]) -> None:
    longest_s = (1 + SLACK_RATIO) / 30.0

    def prior(t: float) -> float:
        crowded = 4 / longest_s if t > CROWDED_RATIO * longest_s else 0.0
        broad = 1 / (t * math.log(longest_s / SHORTEST_S))
        return 0.25 * broad + 0.25 * crowded + 0.5 / longest_s

    def density(t: float, of: tuple[float, float]) -> float:
        return float(stats.t.pdf(t, FREEDOM, loc=of[0], scale=of[1]))

    def over(function) -> float:  # type: ignore[no-untyped-def]  # of one time
        points = sorted({one[0], two[0], CROWDED_RATIO * longest_s})
        return float(integrate.quad(function, SHORTEST_S, longest_s, points=points, limit=500)[0])

    same = over(lambda t: prior(t) * density(t, one) * density(t, two))
    apart = over(lambda t: prior(t) * density(t, one)) * over(lambda t: prior(t) * density(t, two))
    found = compare_readout(estimate(*one), estimate(*two))
    assert found.log10_lr_same_readout == pytest.approx(math.log10(same / apart), abs=0.02)


def test_verdicts() -> None:
    sharp = estimate(0.02, 1e-6)
    assert compare_readout(sharp, estimate(0.02, 1e-6)).verdict == "compatible"
    assert compare_readout(sharp, estimate(0.0201, 1e-6)).verdict == "different"
    assert compare_readout(sharp, estimate(0.0201, 3e-4)).verdict == "compatible"
    blurred = estimate(0.02, 4e-3), estimate(0.026, 4e-3)
    assert compare_readout(*blurred).verdict == "undecidable"


def test_no_more_is_said_than_the_errors_bear() -> None:
    far = compare_readout(estimate(0.02, 1e-7), estimate(0.03, 1e-7))
    assert far.log10_lr_same_readout == -MOST_LOG10_LR
    near = compare_readout(estimate(0.02, 1e-7), estimate(0.02, 1e-7))
    assert near.log10_lr_same_readout <= MOST_LOG10_LR


@pytest.mark.parametrize("time_s", [4.5e-4, 0.0339, 0.0341])
def test_there_is_a_ratio_at_the_ends_of_the_prior(time_s: float) -> None:
    """From half a millisecond on a read-out time is told; one may be over a frame by its error."""
    found = log10_ratio(np.full(2, time_s), np.full(2, 1e-5), 1 / 30.0)
    assert 1.0 < found < MOST_LOG10_LR


def test_the_prior_ends_with_the_frame() -> None:
    """At 60 frames/s there is half the room for a difference as at 30."""
    near = np.array([0.008, 0.008]), np.array([1e-5, 1e-5])
    assert log10_ratio(*near, 1 / 30.0) - log10_ratio(*near, 1 / 60.0) > 0.15


def test_30_and_29_97_frames_a_second_are_one_mode() -> None:
    assert is_same_rate(30.0, 30000 / 1001)
    assert is_same_rate(30000 / 1001, 30.0)
    assert not is_same_rate(30.0, 29.9)


def test_order_does_not_matter() -> None:
    a, b = estimate(0.02, 1e-6), estimate(0.0203, 4e-4)
    assert compare_readout(a, b).log10_lr_same_readout == pytest.approx(
        compare_readout(b, a).log10_lr_same_readout
    )


def test_caveats_are_said() -> None:
    same = compare_readout(estimate(0.02, 1e-5), estimate(0.02, 1e-5))
    assert any("don't prove" in c for c in same.caveats)
    other = compare_readout(estimate(0.02, 1e-5), estimate(0.02, 1e-5, 25.0))
    assert any("frame rates differ" in c for c in other.caveats)
    turned = compare_readout(
        estimate(0.02, 1e-5, direction="forward"), estimate(0.02, 1e-5, direction="reverse")
    )
    assert any("bottom" in c for c in turned.caveats)


def test_without_an_estimate_nothing_is_decided() -> None:
    found = compare_readout(
        estimate(0.02, 1e-5), IdleEstimate(verdict="refused", reason="a global shutter")
    )
    assert found.verdict == "undecidable"
    assert math.isnan(found.log10_lr_same_readout)
    assert any("global shutter" in c for c in found.caveats)


def test_bound_falls_with_frames_and_rows() -> None:
    common = {"noise_level": 0.1, "frame_rate_hz": 30.0, "f0_hz": 100.0}
    few = idle_ratio_bound(amplitude_level=[5.0], frames=100, rows=100, **common)
    many = idle_ratio_bound(amplitude_level=[5.0], frames=400, rows=400, **common)
    assert few == pytest.approx(4 * many)
    two = idle_ratio_bound(amplitude_level=[5.0, 2.5], frames=100, rows=100, **common)
    assert two == pytest.approx(few / np.sqrt(2))
    assert idle_ratio_bound(amplitude_level=[0.0], frames=100, rows=100, **common) == np.inf
    with pytest.raises(UsageError):
        idle_ratio_bound(amplitude_level=[5.0], frames=1, rows=100, **common)

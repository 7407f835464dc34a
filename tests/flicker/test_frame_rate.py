"""Frames without times: which rates the light goes with, and nothing claimed in Hz or ms."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rsenf
from rsenf.api.shared import row_settings, track_settings
from rsenf.api.track import TrackResult, track_result
from rsenf.flicker.frame_rate import FrameRateFinder, hypotheses
from rsenf.idle import IdleSettings
from rsenf.messages import Header, IdleEstimate, RateBasis, RateHypothesis
from rsenf.rows.stage import blocks_from_luminance
from rsenf.run.inline import analyse
from rsenf.run.inputs import Luminance
from tests.discrepancy.foreign_camera import Case, film


def said(
    level: np.ndarray, rate_hz: float, basis: RateBasis, track: str = "projection"
) -> tuple[TrackResult, IdleEstimate]:
    """What both commands say of rows that are counted at a rate."""
    held: dict[str, Any] = {"rows": level, "frame_rate_hz": rate_hz}
    source = Luminance(held, Header(source="test/c", rate_basis=basis))
    settings = track_settings({"method": track})
    found = analyse(source, rows=row_settings(None), track=settings, idle=IdleSettings())
    return track_result("test", found), found.idle


def nearest(found: tuple[RateHypothesis, ...], rate_hz: float, nominal_hz: float) -> RateHypothesis:
    """The hypothesis of a grid that is nearest to a rate, which must be within 0.2 %."""
    own = [h for h in found if h.nominal_hz == nominal_hz]
    best = min(own, key=lambda h: abs(h.frame_rate_hz - rate_hz))
    assert best.frame_rate_hz == pytest.approx(rate_hz, rel=2e-3)
    return best


def test_what_rows_tell_without_times() -> None:
    """100 Hz at 30 frames/s advances by 3 1/3 cycles: a third, or its mirror image."""
    found = hypotheses(1 / 3, 2.323, 25.0, (50.0, 60.0))
    assert found[0].is_common
    assert found[0].frame_rate_hz == pytest.approx(30.0)
    assert found[0].idle_ratio == pytest.approx(1 - 2.323 * 30 / 100)
    assert found[0].read_out_s == pytest.approx(23.23e-3)
    assert found[0].direction == "forward"
    for one in found:
        cycles = 2 * one.nominal_hz / one.frame_rate_hz
        forward = cycles % 1.0 == pytest.approx(1 / 3)
        assert forward or -cycles % 1.0 == pytest.approx(1 / 3)
        assert one.direction == ("forward" if forward else "reverse")
        assert one.read_out_s * one.frame_rate_hz < 1.03
    assert {h.direction for h in hypotheses(0.2, -1.0, 25.0, (50.0,))} == {"forward", "reverse"}


@pytest.mark.parametrize(
    ("seed", "rate", "nominal_hz", "hidden"),
    [(1, "24", 50.0, ()), (4, "30", 50.0, ("reverse_readout",)), (9, "25", 60.0, ())],
)
def test_the_foreign_camera_at_a_wrong_rate(
    seed: int, rate: str, nominal_hz: float, hidden: tuple[str, ...]
) -> None:
    case = Case(
        seed=seed, hidden=hidden, duration_s=15.0, rows=240, strips=4, rate=rate,
        nominal_hz=nominal_hz,
    )  # fmt: skip
    filmed = film(case)
    track, idle = said(filmed.level, 27.3, RateBasis.ASSUMED)
    assert not track.usable.any()
    assert not np.isfinite(track.enf_hz).any()
    assert idle.verdict == "ambiguous"
    assert not np.isfinite([idle.read_out_time_s, idle.idle_ratio, idle.nominal_hz]).any()
    true = nearest(idle.rate_hypotheses, float(rate), nominal_hz)
    assert true in idle.rate_hypotheses[:2]
    assert true.direction == ("reverse" if hidden else "forward")
    assert true.idle_ratio == pytest.approx(filmed.truth["idle_ratios"][0], abs=3e-3)


def test_a_rate_that_is_known_is_believed() -> None:
    filmed = film(Case(seed=1, duration_s=12.0, rows=240, strips=4, rate="24", nominal_hz=50.0))
    track, idle = said(filmed.level, 24.0, RateBasis.DECLARED)
    assert track.usable.any()
    assert idle.verdict == "estimated"
    assert track.to_dict()["rate_hypotheses"] == []
    assert idle.rate_hypotheses == ()


def test_every_method_keeps_silent_in_hz() -> None:
    filmed = film(Case(seed=1, duration_s=24.0, rows=240, strips=4, rate="24", nominal_hz=50.0))
    for method in ("stft", "row_concat"):
        for basis, is_read in ((RateBasis.GIVEN, True), (RateBasis.ASSUMED, False)):
            track, _ = said(filmed.level, 24.0, basis, method)
            assert track.usable.size
            assert track.usable.any() == is_read
        assert track.rate_hypotheses[0].frame_rate_hz == pytest.approx(24.0, rel=2e-3)


@pytest.mark.measured
@pytest.mark.parametrize(
    ("name", "rate_hz", "turns", "within"),
    [("pi_scanny_30", 30.0, 2.323, 0.01), ("pi_touch-flux_23.333", 70 / 3, 2.237, 0.03)],
)
@pytest.mark.parametrize("basis", [RateBasis.ASSUMED, RateBasis.DECLARED])
def test_real_rows_at_a_wrong_rate(
    measured_data: Path, name: str, rate_hz: float, turns: float, within: float, basis: RateBasis
) -> None:
    level = np.load(measured_data / "real_rows" / f"{name}.npz")["rows"]
    track, idle = said(level, 25.0, basis)
    assert not track.usable.any()
    assert idle.verdict == ("ambiguous" if basis == RateBasis.ASSUMED else "no_signal")
    true = nearest(idle.rate_hypotheses, rate_hz, 50.0)
    assert true.direction == "forward"
    assert true.read_out_s * 100.0 == pytest.approx(turns, abs=within)
    assert true in idle.rate_hypotheses[:2]
    assert true in track.rate_hypotheses
    assert "rate" in idle.reason + "".join(idle.warnings)
    assert any("frame rate" in words for words in track.warnings)


@pytest.mark.measured
def test_a_real_stream_without_times(measured_data: Path) -> None:
    """Its rate is 23.33 or 30.43 frames/s; FFmpeg assumes 25."""
    path = measured_data / "real_rows" / "pi_touch-flux.h264"
    found = rsenf.idle(path)
    assert found.verdict == "ambiguous"
    assert found.read_out_time_s is None
    assert "--frame-rate" in (found.reason or "")
    for rate_hz in (23.33, 30.43):
        assert any(
            h["frame_rate_hz"] == pytest.approx(rate_hz, rel=2e-3)
            and h["read_out_s"] == pytest.approx(22.4e-3, abs=3e-4)
            for h in found.rate_hypotheses
        )
    assert not rsenf.track(path).usable.any()


@pytest.mark.measured
def test_patterns_go_with_no_rate(measured_data: Path) -> None:
    for name in ("none_dashes_1", "none_dashes_2"):
        level = np.load(measured_data / "real_rows" / f"{name}.npz")["rows"]
        finder = FrameRateFinder(None)
        for block in blocks_from_luminance(level, np.arange(len(level)) / 25.0, Header(source="t")):
            finder.add(block)
        assert finder.found() is None

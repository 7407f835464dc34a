"""The paper's estimators and the vertical phase: right where they can be, silent where not."""

from __future__ import annotations

import numpy as np
import pytest

from rsenf.idle.row_methods import BIN, TwoLines, _slopes
from rsenf.model import Scene
from tests.idle.idle_clips import camera, error_points, estimates, film, last, std_points

FLAT = Scene(texture_ratio=0.0, vignetting_ratio=0.0)


@pytest.mark.parametrize("idle", [0.07, 0.38, 0.71])
def test_vertical_phase_finds_a_clean_ramp(idle: float) -> None:
    data = film(camera(idle=idle, rows=120), 21, seconds=30)
    found = last(data, method="vertical_phase")
    assert found.verdict == "estimated", found.reason
    assert found.method == "vertical_phase"
    assert abs(error_points(found, data)) < max(0.02, 5 * std_points(found))


def test_slopes_are_those_of_numpy() -> None:
    rng = np.random.default_rng(4)
    phase, weight = rng.standard_normal(50), rng.uniform(0.1, 1, (3, 50))
    slow = [np.polyfit(np.arange(50), phase, 1, w=np.sqrt(w))[0] for w in weight]
    assert _slopes(phase, weight) == pytest.approx(slow)


@pytest.mark.parametrize("idle", [0.04, 0.22, 0.38, 0.55, 0.83])
def test_line_ratio_is_exact_without_texture(idle: float) -> None:
    data = film(camera(idle=idle, rows=120, scene=FLAT), 22, seconds=30)
    found = last(data, method="line_ratio")
    assert found.verdict == "estimated", found.reason
    assert abs(error_points(found, data)) < 0.2


@pytest.mark.parametrize("idle", [0.05, 0.2, 0.4, 0.65])
def test_bins_are_rows_of_the_papers_table(idle: float) -> None:
    data = film(camera(idle=idle + 0.004, rows=120, scene=FLAT), 23, seconds=30)
    found = last(data, method="line_ratio_bins")
    assert found.verdict == "estimated", found.reason
    # A ratio is nearest to its own row of the table.
    assert found.idle_ratio == pytest.approx(idle, abs=1e-3)
    assert std_points(found) >= 100 * BIN / np.sqrt(12) * 0.99


def test_read_out_from_the_last_row_has_lines_below_zero() -> None:
    data = film(
        camera(idle=0.3, rows=120, scene=FLAT).with_effect("reverse_readout"), 24, seconds=30
    )
    found = last(data, method="line_ratio")
    assert found.direction == "reverse"
    assert abs(error_points(found, data)) < 0.2


def test_place_and_error_between_lines() -> None:
    # c = 1.25: amplitudes go as 1/|c − m|.
    lines = TwoLines(m=1, side=1, ratio=3.0, third_ratio=5.0)
    assert lines.place() == pytest.approx(1.25)
    assert lines.error() == pytest.approx(0.0)
    off = TwoLines(m=1, side=1, ratio=3.0, third_ratio=5.0, aligned=0.9)
    assert off.error() == pytest.approx(0.1)
    assert TwoLines(m=1, side=-1, ratio=3.0, third_ratio=4.0).place() == pytest.approx(0.75)
    assert TwoLines(m=1, side=1, ratio=3.0, third_ratio=4.0).error() > 0.02


@pytest.mark.parametrize("method", ["vertical_phase", "line_ratio", "line_ratio_bins"])
@pytest.mark.parametrize("rate_hz", [25.0, 30.0])
def test_an_alias_at_0_hz_is_no_reason_where_no_flicker_is(method: str, rate_hz: float) -> None:
    """At 30 frames/s light on 60 Hz would stand still; what was filmed may be on 50 Hz, or dark."""
    level = np.random.default_rng(4).normal(100.0, 0.5, (int(12 * rate_hz), 64, 1))
    found = estimates(level, np.arange(len(level)) / rate_hz, method=method)[-1]
    assert (found.verdict, found.reason) == ("no_signal", "no mains flicker stands out")


@pytest.mark.parametrize("method", ["vertical_phase", "line_ratio", "line_ratio_bins"])
def test_flicker_that_stands_still_is_refused(method: str) -> None:
    found = last(film(camera("25", rows=120), 25, seconds=40), method=method)
    assert found.verdict == "refused"
    assert found.reason

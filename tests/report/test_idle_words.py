"""An idle estimate in JSON and in words: unknown is null, and digits are those that count."""

from __future__ import annotations

import json

import pytest

from rsenf.idle.compare import Comparison
from rsenf.messages import IdleEstimate
from rsenf.report.camera import (
    comparison_json,
    comparison_words,
    idle_json,
    idle_words,
)
from rsenf.report.values import decimals

KNOWN = IdleEstimate(
    method="coherent",
    verdict="estimated",
    idle_ratio=0.381234,
    idle_ratio_var=0.00021**2,
    idle_ratio_low=0.3808,
    idle_ratio_high=0.3817,
    read_out_time_s=0.0206456,
    read_out_time_var_s2=7e-6**2,
    direction="reverse",
    frame_rate_hz=29.97003,
    nominal_hz=50.0,
)


def test_what_is_unknown_is_null() -> None:
    found = idle_json(IdleEstimate(verdict="no_signal", reason="dark"), ["beware"])
    assert json.loads(json.dumps(found, allow_nan=False)) == {
        "verdict": "no_signal", "method": "", "idle_ratio": None, "idle_ratio_std": None,
        "idle_ratio_low": None, "idle_ratio_high": None, "read_out_time_s": None,
        "read_out_time_std_s": None, "direction": None, "frame_rate_hz": None, "nominal_hz": None,
        "converted": False, "slips": 0, "reason": "dark", "rate_hypotheses": [],
        "warnings": ["beware"],
    }  # fmt: skip


def test_what_is_known() -> None:
    found = idle_json(KNOWN, [])
    assert found["idle_ratio_std"] == pytest.approx(0.00021)
    assert found["read_out_time_std_s"] == pytest.approx(7e-6)
    assert (found["direction"], found["reason"]) == ("reverse", None)


def test_an_estimate_in_words() -> None:
    assert idle_words(KNOWN).splitlines() == [
        "estimated: 38.123 ± 0.021 % of each frame is idle",
        "  95 % interval   38.080 to 38.170 %",
        "  read-out time   20.6456 ± 0.0070 ms",
        "  direction       reverse: bottom to top, or right to left",
        "  grid            50 Hz",
        "  frame rate      29.970 frames/s",
        "  what it means   the camera reads no row during this share of each frame",
    ]
    assert KNOWN.in_short == "idle 38.123 ± 0.021 %"


def test_no_estimate_in_words() -> None:
    found = IdleEstimate(verdict="refused", reason="the codec has gone too far")
    assert idle_words(found).splitlines() == [
        "refused: the codec has gone too far",
        "  what it means   there is flicker, but this recording can't bear an answer",
    ]
    assert found.in_short == "refused: the codec has gone too far"


@pytest.mark.parametrize(
    ("error", "shown"),
    [(3.0, 1), (0.3, 2), (0.02, 3), (0.0021, 4), (1e-9, 5), (0.0, 2), (float("nan"), 2)],
)
def test_decimals_show_two_digits_of_the_error(error: float, shown: int) -> None:
    assert decimals(error) == shown


def test_a_comparison() -> None:
    found = Comparison(
        verdict="compatible", log10_lr_same_readout=2.34, caveats=("equal ones prove nothing",)
    )
    assert comparison_json(found) == {
        "log10_lr_same_readout": 2.34,
        "verdict": "compatible",
        "caveats": ["equal ones prove nothing"],
    }
    assert comparison_words(found).splitlines() == [
        "compatible: the read-out times agree, which proves nothing",
        "  likelihood      10^+2.3, for one read-out time against two cameras'",
        "  mind that       equal ones prove nothing",
    ]


def test_a_comparison_that_is_none() -> None:
    found = Comparison(verdict="undecidable", log10_lr_same_readout=float("nan"), caveats=())
    assert comparison_json(found)["log10_lr_same_readout"] is None
    assert len(comparison_words(found).splitlines()) == 1

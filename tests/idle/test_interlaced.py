"""Fields woven into one picture, by a camera that isn't the model's: refused, and told which."""

from __future__ import annotations

import pytest

from rsenf.idle import IdleSettings, make_idle
from rsenf.idle.refusals import INTERLACED
from rsenf.messages import Header, IdleEstimate
from rsenf.rows.stage import blocks_from_luminance
from tests.discrepancy.foreign_camera import film, trial


def concluded(kind: str, seed: int, rate: str, method: str) -> tuple[IdleEstimate, dict[str, bool]]:
    taken = film(trial(kind, seed, rate=rate, nominal_hz=50.0, grid="rough", duration_s=12.0))
    stage = make_idle(IdleSettings(method=method))
    for block in blocks_from_luminance(taken.level, taken.stamp_s, Header()):
        stage.update(block)
    (said,) = (m for m in stage.flush() if isinstance(m, IdleEstimate))
    return said, taken.hidden.get("interlace", {})


@pytest.mark.parametrize("method", ["coherent", "vertical_phase", "line_ratio"])
@pytest.mark.parametrize("rate", ["24", "30000/1001", "60000/1001"])
def test_which_field_is_first(rate: str, method: str) -> None:
    firsts = set()
    for seed in range(38001, 38005):
        said, hidden = concluded("interlaced", seed, rate, method)
        if INTERLACED in said.reason:
            first = "top" if hidden["top_field_first"] else "bottom"
            assert f"{first} field first" in said.reason
            firsts.add(first)
        else:  # weak, or read out so slowly that it isn't one light's ramp
            assert said.verdict != "estimated"
    assert firsts


@pytest.mark.parametrize("rate", ["24", "30000/1001", "60000/1001"])
def test_what_is_read_in_turn_is_not_interlaced(rate: str) -> None:
    for kind in ("led", "half-wave part", "several sources", "stripes beside"):
        said, _ = concluded(kind, 38010, rate, "coherent")
        assert INTERLACED not in said.reason

"""Discovery that begins with a model of the user's own, and with data that has holes."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from rsenf.discrepancy.forward_model import plan
from rsenf.discrepancy.measured import frame_rate_of, measured_of
from rsenf.discrepancy.series import with_series
from rsenf.discrepancy.start import PLAIN, first_fit
from rsenf.discrepancy.window import thinned
from rsenf.errors import InputError, UsageError
from rsenf.messages import Header
from rsenf.model import CaptureModel, Light, Shutter, make_effect, simulate_rows, synthetic_grid
from rsenf.rows.stage import blocks_from_luminance
from tests.discrepancy.hidden_effects import Hidden, hidden


@pytest.fixture(scope="module")
def plain() -> Hidden:
    return hidden(seed=31)


@pytest.mark.parametrize(
    "model",
    [
        PLAIN.with_effect("auto_exposure"),
        PLAIN.with_effect("row_banding"),
        PLAIN.with_effect("row_banding", offset_ratios=[0.001] * 100),  # of another picture
        PLAIN.with_effect("harmonics", higher_ratios=[0.01, 0.01]),  # phases that lack are 0
        CaptureModel(shutter=Shutter(read_out="columns"), light=Light(lamp="tone")),
        CaptureModel(shutter=Shutter(read_out="global"), light=Light(lamp="tone")),
    ],
)
def test_a_model_whose_effects_have_no_values_yet_fits(plain: Hidden, model: CaptureModel) -> None:
    found = first_fit(model, plain.data)
    assert abs(found.gap.value) < 1e-4


def test_two_effects_of_one_name_are_refused(plain: Hidden) -> None:
    tones = [make_effect("pwm_tone", {"tone_hz": hz}) for hz in (500.0, 733.0)]
    with pytest.raises(UsageError, match="two effects of one name"):
        first_fit(PLAIN.plus(*tones), plain.data)


def test_a_model_that_loses_every_frame_is_refused(plain: Hidden) -> None:
    model = CaptureModel(shutter=Shutter(frame_rate=Fraction(10)))
    with pytest.raises(InputError, match="loses nearly all frames"):
        plan(model.with_effect("frame_drop", drops_per_min=600.0), plain.data)


def test_black_bars_are_no_texture(plain: Hidden) -> None:
    level = plain.made.level.copy()
    level[:, :8] = level[:, -8:] = 0.0
    blocks = blocks_from_luminance(level, plain.made.frame_time_s, Header())
    data = measured_of(list(blocks))
    assert np.isfinite(data.texture).all()
    assert np.isfinite(data.level).all()


def test_frames_lost_after_a_hole_are_found_at_their_place() -> None:
    case = hidden("frame_drop", seed=32, at_frames=[600])
    seen = np.ones(len(case.made.level), bool)
    seen[300:303] = False
    made = case.made.level[seen], case.made.frame_time_s[seen]
    told = Hidden(case.made, measured_of(list(blocks_from_luminance(*made, Header())))).discover()
    assert told.verdict == "explained"
    (drop,) = told.last.forward.model.effects[-1:]
    assert getattr(drop, "at_frames", None) == (600,)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(
    ("rate", "jitter_s"), [(Fraction(30000, 1001), 5e-3), (Fraction(60), 2e-3), (Fraction(25), 0.0)]
)
def test_jitter_does_not_change_the_frame_rate(rate: Fraction, jitter_s: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    frames = np.delete(np.arange(900), [0, 300, 301, 302])
    assert frame_rate_of(frames / float(rate) + jitter_s * rng.standard_normal(896)) == rate


def test_a_series_keeps_its_effects_place(plain: Hidden) -> None:
    """Of effects in another order the derivative would be that of another model."""
    model = PLAIN.with_effect("auto_exposure", gains=[0.0] * 900).with_effect("gamma")
    forward = first_fit(PLAIN, plain.data).forward.with_model(model)
    moved = with_series(forward, model.effects[0], "gains", np.full(900, 0.01))
    assert [e.name for e in moved.model.effects] == [e.name for e in model.effects]


@pytest.mark.parametrize("name", ["frame_drop", "frame_duplicate"])
@pytest.mark.parametrize("retimed", [True, False])
def test_blended_frames_are_lost_and_repeated_with_their_shares(name: str, retimed: bool) -> None:
    model = CaptureModel(shutter=Shutter(rows=32, columns=16))
    model = model.with_effect("rate_conversion", way="blend")
    model = model.with_effect(name, at_frames=[50], retimed=retimed)
    made = simulate_rows(model, synthetic_grid(1, 12.0), 4.0, 1, noise=False)
    assert len(made.level) == len(made.frame_time_s)
    assert np.isfinite(made.level).all()


def test_a_window_keeps_the_fewest_lines_that_can_be_fitted() -> None:
    level = np.full((2, 1080, 1), 100.0)
    (block,) = blocks_from_luminance(level, np.array([0.0, 0.04]), Header())
    assert thinned(block, 16).rows >= 16

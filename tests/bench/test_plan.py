"""The plan: what is filmed, and what each seed draws."""

from __future__ import annotations

import numpy as np
import pytest

from rsenf.bench.scenes import LAMPS, NOTHING, Plan, codec_of, setting_of
from rsenf.errors import UsageError
from rsenf.model import Codec

PLAN = Plan(clips=5, nominals_hz=(50.0, 60.0))


def test_every_clip_has_a_name_of_its_own() -> None:
    clips = [*PLAN.lit(), *PLAN.nothing()]
    assert len(clips) == 5 * (2 * 4 * 2) + 5 * len(NOTHING)
    assert len({clip.key for clip in clips}) == len(clips)


def test_a_stopped_run_has_even_cells() -> None:
    cells = [(clip.size, clip.frame_rate, clip.nominal_hz) for clip in PLAN.lit()[:16]]
    assert len(set(cells)) == 16


def test_more_seeds_add_clips_and_change_none() -> None:
    more = {clip.key for clip in Plan(clips=7, nominals_hz=(50.0, 60.0)).lit()}
    assert {clip.key for clip in PLAN.lit()} < more


def test_a_seed_draws_the_same_again_and_something_else_in_another_cell() -> None:
    here, there = PLAN.lit()[:2]
    assert setting_of(here) == setting_of(here)
    assert setting_of(here).seed != setting_of(there).seed
    assert setting_of(here).model.shutter.idle_ratio != setting_of(there).model.shutter.idle_ratio


def test_each_cell_meets_every_lamp() -> None:
    cell = [c for c in PLAN.lit() if (c.size, c.frame_rate, c.nominal_hz) == ("480p", "25", 50.0)]
    assert {setting_of(clip).model.light.lamp for clip in cell} == set(LAMPS)


def test_every_setting_is_plausible() -> None:
    for clip in [*PLAN.lit(), *PLAN.nothing()]:
        setting_of(clip).model.validate()


def test_of_the_scenes_with_nothing_to_claim_only_one_has_mains_light() -> None:
    for clip in PLAN.nothing():
        levels = np.array(setting_of(clip).flicker_levels(clip.nominal_hz))
        # An exposure of one period of the flicker leaves none of it, to rounding.
        assert np.all(levels < 1e-12), clip.key
        series = setting_of(clip).model.light.series(2 * clip.nominal_hz)
        assert np.any(series) == (clip.scene == "anti_flicker")


def test_some_of_them_are_coded_too() -> None:
    coded = [clip for clip in PLAN.nothing() if len(clip.codings) > 1]
    assert {clip.scene for clip in coded} == set(NOTHING)
    assert len(coded) < len(PLAN.nothing()) / 2


@pytest.mark.parametrize(
    "wrong", [{"sizes": ("722p",)}, {"frame_rates": ("x",)}, {"codings": ("150",)}]
)
def test_a_plan_that_cannot_be_meant_so(wrong: dict[str, tuple[str, ...]]) -> None:
    with pytest.raises(UsageError):
        Plan(**wrong)  # type: ignore[arg-type]  # any one of them


def test_codings_are_codecs_at_bit_rates() -> None:
    assert codec_of("150k") == Codec(name="h264", bitrate_bps=150_000)
    assert codec_of("vp9-300k") == Codec(name="vp9", bitrate_bps=300_000)
    assert codec_of("lossless") is None


@pytest.mark.parametrize("wrong", ["150", "k", "divx-150k", "-", "", "vp9"])
def test_what_is_no_coding(wrong: str) -> None:
    with pytest.raises(UsageError, match="not a coding"):
        codec_of(wrong)

"""What no effect explains is at least guessed: its kind, and what would tell."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from rsenf.discrepancy.fit import Fit, fit
from rsenf.discrepancy.measured import STRIPS
from rsenf.discrepancy.residual_breakdown import where
from rsenf.discrepancy.residual_classifier import TELLS, hint_json, hint_of, signs_of
from rsenf.discrepancy.result import discovery_json
from rsenf.discrepancy.settings import FEWEST_BLOCKS
from rsenf.discrepancy.start import first_theory
from rsenf.report.discovery import KINDS, discovery_words, kind_words, tone_words
from tests.discrepancy.hidden_effects import PLAIN, Hidden, hidden

RATE_HZ = 30000 / 1001


def fitted(case: Hidden) -> Fit:
    """Fit the plain model, as one whose catalogue had no effect at all would stay."""
    return fit(first_theory(PLAIN, case.data), case.data)


def guessed(case: Hidden) -> dict[str, Any]:
    last = fitted(case)
    told = hint_json(hint_of(last, where(last)))
    assert told["would_tell"]
    assert kind_words(told)
    return told


def wave(case: Hidden, freq_hz: float) -> np.ndarray:
    return np.cos(2 * np.pi * freq_hz * case.data.time_s)[:, None, None].astype(np.float32)


def shaken(case: Hidden) -> None:
    """A mechanical shake with a gain."""
    level, swing = case.data.level, wave(case, 3.7)
    level += 0.2 / case.data.group * swing * (np.roll(level, 1, axis=1) - level)
    level *= 1 + 0.001 * swing


def brightened(case: Hidden) -> None:
    case.data.level[case.data.time_s > 14.0] *= 1.004


def vignetted(case: Hidden) -> None:
    """The lower third pulsates."""
    lines = case.data.lines
    dark = np.clip((np.arange(lines) - 2 * lines / 3) / (lines / 3), 0, None)[None, :, None]
    case.data.level[...] *= 1 + 0.004 * dark.astype(np.float32) * wave(case, 0.9)


def clipped(case: Hidden) -> None:
    level = case.data.level
    np.minimum(level, np.quantile(level, 0.93), out=level)


def jumping(case: Hidden) -> None:
    gain = 1 + 0.003 * np.random.default_rng(1).standard_normal(case.data.frames)
    case.data.level[...] *= gain[:, None, None].astype(np.float32)


def one_side(case: Hidden) -> None:
    case.data.level[:, :, 3:] *= 1 + 0.002 * wave(case, 8.67)


def shuffled(case: Hidden) -> None:
    """Odd lines first, from the bottom up, then the even ones."""
    lines = case.data.lines
    order = [*reversed(range(1, lines, 2)), *range(0, lines, 2)]
    case.data.level[...] = case.data.level[:, order]


# Seeds as they came.
@pytest.mark.parametrize(
    ("hide", "strips", "kind", "also"),
    [
        (shaken, 1, "tone", []),
        (brightened, 1, "event", []),
        (vignetted, 1, "tone", ["rows"]),
        (clipped, 1, "level", ["rows"]),
        (jumping, 1, "gain", []),
        (one_side, 4, "tone", ["strips"]),
        (shuffled, 1, "other_readout", []),
    ],
)
def test_the_kind_of_what_is_in_no_catalogue(
    hide: Callable[[Hidden], None], strips: int, kind: str, also: list[str]
) -> None:
    case = hidden(seed=31, strips=strips)
    hide(case)
    told = guessed(case)
    assert (told["kind"], told["also"]) == (kind, also)
    assert told["would_tell"] == [text for name in (kind, *also) for text in TELLS[name]]


@pytest.mark.parametrize(
    ("effect", "values", "kind"),
    [
        ("harmonics", {}, "waveform"),
        ("capture_jitter", {"jitter_s": 6e-5}, "timing"),
        ("auto_exposure", {"gain_ratio": 0.006}, "gain"),
        ("gop_attenuation", {"loss_ratio": 0.03}, "flicker_size"),
        ("row_banding", {"banding_ratio": 0.009}, "single_lines"),
        ("frame_drop", {"at_frames": (200, 600)}, "event"),
    ],
)
def test_the_kind_of_an_effect_that_a_catalogue_had_not(
    effect: str, values: dict[str, Any], kind: str
) -> None:
    told = guessed(hidden(effect, seed=32, **values))
    assert told["kind"] == kind
    if effect == "frame_drop":
        assert told["at_s"] == pytest.approx([200 / RATE_HZ, 600 / RATE_HZ], abs=1.0)
    if effect == "gop_attenuation":
        assert told["period_frames"] == 30
    if kind == "gain":
        assert told["slow"]


def test_a_second_lamp_differs_from_side_to_side() -> None:
    told = guessed(hidden("second_lamp", seed=33, strips=3, weight=0.06))
    assert (told["kind"], told["also"]) == ("flicker", ["strips"])


@pytest.mark.parametrize("most", [0.4, 0.0])
def test_the_shares_of_a_wall_of_few_levels_add_up(most: float) -> None:
    case = hidden(seed=34)
    brightened(case)
    last = fitted(case)
    wall = last.forward.wall
    flat = dataclasses.replace(last.forward, wall=np.minimum(wall, np.quantile(wall, most)))
    shares = [s.share for s in where(dataclasses.replace(last, forward=flat)) if s.axis == "level"]
    assert sum(shares) == pytest.approx(1.0)


@pytest.mark.parametrize("strips", [2, 3, 4])
def test_the_share_of_a_gain_is_of_all_strips_after_a_codec(strips: int) -> None:
    case = hidden(seed=35, strips=strips)
    brightened(case)
    last = fitted(dataclasses.replace(case, data=dataclasses.replace(case.data, apart=STRIPS)))
    assert signs_of(last).gain.share == pytest.approx(1.0, abs=0.1)


def test_blocks_are_no_longer_for_a_hole_after_the_first_frame() -> None:
    data = hidden(seed=34).data
    slot = np.concatenate([[0], data.slot[1:] + 200])
    assert dataclasses.replace(data, slot=slot).until(10.0).block[-1] == FEWEST_BLOCKS - 1


def test_a_change_is_dated() -> None:
    case = hidden(seed=34)
    brightened(case)
    assert guessed(case)["at_s"] == pytest.approx([14.0], abs=0.1)


def test_a_tone_is_told_by_its_aliases_and_the_likeliest_by_the_rows() -> None:
    told = guessed(hidden("pwm_tone", seed=35, tone_hz=737.3, depth_ratio=0.0015))
    assert told["kind"] == "fast_tone"
    assert told["alias_hz"] == pytest.approx(abs(737.3 - 25 * RATE_HZ), abs=0.02)
    assert told["likely_hz"][0] == pytest.approx(737.3, abs=0.02)
    assert set(told["likely_hz"]) <= set(told["may_be_hz"])
    aways = np.array(told["may_be_hz"]) % RATE_HZ
    aways = np.minimum(aways, RATE_HZ - aways)
    assert aways == pytest.approx(told["alias_hz"], abs=0.01)
    assert "737.3" in tone_words(told)


def test_a_slow_tone_is_given_its_own_frequency() -> None:
    case = hidden(seed=36)
    vignetted(case)
    told = guessed(case)
    assert told["alias_hz"] == pytest.approx(0.9, abs=0.03)
    assert 100 <= told["rows"][0] < told["rows"][1] == 160
    assert "(" in kind_words(told)


def test_the_guess_is_in_the_result_and_its_words() -> None:
    case = hidden(seed=31)
    shaken(case)
    told = discovery_json(case.discover(), "")
    left = told["unexplained"]
    assert left["kind"] in ("tone", "fast_tone")  # its gain is named; what moved has any ramp
    rate_hz = float(case.data.frame_rate)
    lines_hz = (3.7, 103.7 - 3 * rate_hz, 96.3 - 3 * rate_hz)  # the motion's, the flicker's beside
    assert min(abs(left["alias_hz"] - hz) for hz in lines_hz) < 0.1
    words = discovery_words(told)
    assert KINDS[left["kind"]] in words
    assert left["would_tell"][0] in words
    assert f"{left['alias_hz']:.2f} Hz" in words


def test_every_kind_has_words_and_a_measurement_that_would_tell() -> None:
    assert set(KINDS) == set(TELLS)
    assert all(TELLS.values())

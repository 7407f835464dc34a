"""The watch over a stream: what a camera is like, what changes, and when nothing can be said."""

from __future__ import annotations

import dataclasses
import json
import math
import subprocess
from collections.abc import Callable, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rsenf.discrepancy.settings import WatchSettings
from rsenf.discrepancy.watch import WatchStage, lasting
from rsenf.discrepancy.window import WindowBuffer, thinned
from rsenf.errors import UsageError
from rsenf.messages import DiscoveryVerdict, Header, RowBlock, canonical
from rsenf.model import CaptureModel, Light, Shutter, simulate_rows, synthetic_grid
from rsenf.rows.stage import blocks_from_luminance

RATE = Fraction(30000, 1001)
WINDOW_S = 28.0
SETTINGS = WatchSettings(nominal_hz=50.0, window_s=WINDOW_S, every_s=WINDOW_S, lines=48)


def film(
    seconds: float, effect: str = "", *, seed: int, lines: int = 48, **values: Any
) -> tuple[np.ndarray, np.ndarray]:
    """Rows of a wall under a pure tone, (frames, lines, 1), and the frames' times."""
    shutter = Shutter(frame_rate=RATE, rows=lines, idle_ratio=0.38)
    model = CaptureModel(light=Light(lamp="tone"), shutter=shutter)
    model = model.with_effect("exposure", exposure_s=0.002)
    if effect:
        model = model.with_effect(effect, **values)
    made = simulate_rows(model, synthetic_grid(seed, seconds + 10.0, start_s=4.0), seconds, seed)
    return made.level, made.frame_time_s


def changing(seconds: float, since_s: float, *, seed: int, **how: Any) -> list[RowBlock]:
    """The same film with an effect from some moment on."""
    before, time_s = film(seconds, seed=seed)
    after, _ = film(seconds, seed=seed, **how)
    first = math.ceil(since_s * RATE)
    level = np.concatenate([before[:first], after[first:]])
    return cut(level, time_s[: len(level)])


def cut(level: np.ndarray, time_s: np.ndarray, **how: Any) -> list[RowBlock]:
    return list(blocks_from_luminance(level, time_s, Header(source="lab/cam"), **how))


def watched(blocks: Sequence[RowBlock], stage: WatchStage | None = None) -> list[DiscoveryVerdict]:
    stage = stage or WatchStage(SETTINGS)
    return [told for block in blocks for told in stage.update(block)] + stage.flush()


def names(told: DiscoveryVerdict) -> list[str]:
    return [effect.name or " or ".join(sorted(effect.members)) for effect in told.effects]


@pytest.mark.parametrize(
    ("effect", "values", "named"),
    [
        ("frame_drop", {"at_frames": (1900, 2200)}, "frame_drop"),
        ("pwm_tone", {"tone_hz": 400.3, "depth_ratio": 0.003}, "interharmonic or pwm_tone"),
        ("readout_drift", {"drift_per_min": 0.02}, "readout_drift"),
    ],
)
def test_a_camera_that_changes_is_noticed_and_the_change_is_named(
    effect: str, values: dict[str, Any], named: str
) -> None:
    told = watched(changing(3 * WINDOW_S, 2 * WINDOW_S, seed=41, effect=effect, **values))
    assert [t.verdict for t in told] == ["no_discrepancy", "no_discrepancy", "explained"]
    assert [names(t) for t in told] == [[], [], [named]]
    assert [t.changed for t in told[:2]] == [(), ()]
    assert " is new" in told[2].changed[0]
    assert all(name in told[2].changed[0] for name in named.split(" or "))
    assert told[2].gap_before > told[2].gap_limit > abs(told[2].gap_after)
    assert told[2].header.pts_ns == pytest.approx(2 * WINDOW_S * 1e9, abs=3e8)


def test_what_begins_within_a_window_is_unexplained_at_first_and_named_in_the_next() -> None:
    """What came before the change is forgotten, so that it doesn't mix with what came after."""
    blocks = changing(82.0, 42.0, seed=42, effect="harmonics", second_ratio=0.03)
    told = watched(blocks, WatchStage(dataclasses.replace(SETTINGS, every_s=14.0)))
    assert [t.verdict for t in told] == ["no_discrepancy"] * 2 + ["unexplained", "explained"]
    assert told[2].changed[-1] == "something is new that no effect explains"
    assert "time_s" in told[2].unexplained_text
    assert names(told[3]) in (["harmonics"], ["gamma or harmonics"])


def test_what_is_known_stays_explained_and_what_ends_is_said_to_be_gone() -> None:
    shaken, time_s = film(3 * WINDOW_S, "interharmonic", seed=43, depth_ratio=0.002)
    still, _ = film(3 * WINDOW_S, seed=43)
    first = math.ceil(2 * WINDOW_S * RATE)
    told = watched(cut(np.concatenate([shaken[:first], still[first:]]), time_s))
    assert [len(names(t)) for t in told] == [1, 1, 0]
    (named,) = names(told[0])  # alone, or with what a short window can't tell from it
    assert "interharmonic" in named.split(" or ")
    assert names(told[1]) == [named]
    assert [t.verdict for t in told] == ["explained", "no_discrepancy", "no_discrepancy"]
    assert told[0].changed == told[1].changed == ()
    (gone,) = told[2].changed
    assert set(gone.removesuffix(" is gone").split(" or ")) == set(named.split(" or "))
    assert "interharmonic" not in told[2].model_yaml.split("provenance")[0]
    # Its frequency as in the window before, its phase anew.
    values = dict(
        zip(told[1].effects[0].parameter_names, told[1].effects[0].parameters, strict=True)
    )
    (tone_hz,) = (value for name, value in values.items() if name.endswith("_hz"))
    assert tone_hz == pytest.approx(8.8, abs=1e-3)


def test_a_window_may_begin_anywhere_among_the_key_frames() -> None:
    level, time_s = film(2 * WINDOW_S + 2.0, "gop_attenuation", seed=51, loss_ratio=0.04)
    first, second = watched(cut(level[47:], time_s[47:] - time_s[47]))
    assert [t.verdict for t in (first, second)] == ["explained", "explained"]
    for told in (first, second):
        (effect,) = told.effects
        values = dict(zip(effect.parameter_names, effect.parameters, strict=True))
        begun = int(told.header.frame_first) + 47
        assert values["first_age"] == begun % 30
        assert values["loss_ratio"] == pytest.approx(0.04, rel=0.05)
    assert second.changed == ()


def test_how_rows_were_batched_changes_nothing() -> None:
    level, time_s = film(40.0, seed=44)
    small, large = (watched(cut(level, time_s, block_frames=n)) for n in (5, 1000))
    assert [canonical(t) for t in small] == [canonical(t) for t in large]
    # One window when it is full, and one at the end.
    assert [t.header.frame_first for t in small] == [0, 359]
    assert [t.header.seq for t in small] == [0, 1]


def test_a_file_of_one_window_and_the_command_agree(
    rsenf: Callable[..., subprocess.CompletedProcess[str]], tmp_path: Path
) -> None:
    level, time_s = film(WINDOW_S, "gop_attenuation", seed=50, loss_ratio=0.04)
    np.savez(tmp_path / "film.npz", rows=level, frame_time_s=time_s)
    done = rsenf(
        "discover", tmp_path / "film.npz", "--out", tmp_path / "out", "--nominal-hz", 50, "--json"
    )
    batch = json.loads(done.stdout)
    (told,) = watched(cut(level, time_s))
    assert told.verdict == batch["verdict"] == "explained"
    assert names(told) == [e["name"] for e in batch["effects"]] == ["gop_attenuation"]
    assert told.gap_before == pytest.approx(batch["gap"]["before"], rel=1e-6)
    assert told.gap_after == pytest.approx(batch["gap"]["after"], rel=1e-3)
    assert told.gap_limit == pytest.approx(batch["gap"]["limit"], rel=1e-3)


def test_rows_averaged_down_have_no_discrepancy_of_their_own() -> None:
    level, time_s = film(WINDOW_S, seed=45, lines=240)
    (told,) = watched(cut(level, time_s))
    assert (told.verdict, told.effects) == ("no_discrepancy", ())
    assert "rows: 48\n" in told.model_yaml
    model = CaptureModel.from_dict(_yaml(told.model_yaml))
    assert model.shutter.idle_ratio == pytest.approx(0.38, abs=1e-4)
    # Five rows together are as one with a longer exposure, which only lowers the flicker.
    swallowed = float(np.sinc(100.0 * 0.002) * np.sinc(100.0 * 0.62 / float(RATE) / 48))
    assert model.light.flicker_ratio == pytest.approx(0.1 * swallowed, rel=1e-3)


def test_rows_are_averaged_in_groups_of_one_size() -> None:
    for rows, lines in ((720, 240), (1080, 216), (240, 240), (487, 162)):
        level = np.arange(rows, dtype=np.float32)[None, :, None]
        (block,) = cut(level, np.zeros(1))
        thin = thinned(block, 240)
        assert thin.rows == thin.level.shape[1] == lines
        np.testing.assert_allclose(np.diff(thin.level[0, :, 0]), rows // lines)


def test_frames_that_are_missing_are_counted_and_not_smoothed_over() -> None:
    level, time_s = film(WINDOW_S, seed=46)
    there = np.ones(len(level), bool)
    there[300:360] = there[500] = False
    blocks = cut(level[there], time_s[there])
    blocks[5] = dataclasses.replace(blocks[5], usable=False, reason="it moves")
    (told,) = watched(blocks)
    assert (told.verdict, told.effects) == ("no_discrepancy", ())
    assert told.frames_missing == 61 + 8


@pytest.mark.parametrize("what", ["noise", "constant", "means", "short", "moving", "holes", "nan"])
def test_where_nothing_can_be_said_the_reason_is(what: str) -> None:
    level, time_s = film(WINDOW_S, seed=47)
    blocks = cut(level, time_s)
    if what == "noise":
        blocks = cut(np.random.default_rng(1).normal(100.0, 1.0, level.shape), time_s)
    if what == "constant":
        blocks = cut(np.full_like(level, 100.0), time_s)
    if what == "means":
        blocks = cut(level.mean(axis=1, keepdims=True), time_s, read_out_axis="frame")
    if what == "short":
        blocks = blocks[:20]
    if what == "moving":
        blocks = [dataclasses.replace(b, usable=False, reason="it moves") for b in blocks]
    if what == "holes":
        blocks = blocks[::2]
    if what == "nan":
        blocks[3].level[0, 0, 0] = np.nan
    (told,) = watched(blocks)
    words = {
        "noise": "no flicker", "constant": "every frame is the same", "means": "one mean",
        "short": "too short", "moving": "it moves", "holes": "never came", "nan": "finite",
    }  # fmt: skip
    assert told.verdict == "no_signal"
    assert words[what] in told.reason
    assert told.in_short == f"no_signal: {told.reason}"
    assert told.effects == ()


def test_a_stream_without_a_frame_has_no_verdict() -> None:
    assert WatchStage(SETTINGS).flush() == []


def test_a_window_for_which_there_is_no_time_is_skipped_and_counted() -> None:
    level, time_s = film(3 * WINDOW_S, seed=48)
    late = iter([True, False])
    stage = WatchStage(SETTINGS, is_behind=lambda: next(late))
    first, last = watched(cut(level, time_s), stage)
    assert (first.windows_skipped, last.windows_skipped) == (1, 0)
    assert first.header.frame_first == math.ceil(WINDOW_S * RATE)
    given_up = WatchStage(SETTINGS, run=lambda work: None)
    assert watched(cut(level, time_s), given_up) == []


def test_what_happened_in_one_window_is_not_carried_into_the_next() -> None:
    model = CaptureModel().with_effect("frame_drop", at_frames=(3,))
    model = model.with_effect("auto_exposure").with_effect("capture_jitter")
    model = model.with_effect("pwm_tone", tone_hz=400.0, phase_rad=1.0)
    (tone,) = lasting(model).effects
    assert (tone.name, tone.tone_hz, tone.depth_ratio) == ("pwm_tone", 400.0, 0.0)  # type: ignore[attr-defined]


def test_rows_of_another_shape_begin_anew() -> None:
    level, time_s = film(1.0, seed=49)
    rolling = WindowBuffer(48)
    for rows in (48, 24):
        for block in cut(level[:, :rows], time_s):
            rolling.add(block)
    assert {block.rows for block in rolling.blocks()} == {24}
    assert rolling.header is not None
    assert rolling.header.frame_first == 0


@pytest.mark.parametrize(
    "wrong", [{"window_s": 24.0}, {"every_s": 1.0}, {"lines": 8}, {"nominal_hz": 55.0}]
)
def test_settings_that_can_not_be_meant_so(wrong: dict[str, float]) -> None:
    with pytest.raises(UsageError):
        WatchSettings(**wrong)  # type: ignore[arg-type]


def _yaml(text: str) -> Any:
    import yaml

    return yaml.safe_load(text)

"""Clips converted to another frame rate: answered for the original, or refused with the reason."""

from __future__ import annotations

import numpy as np
import pytest

from rsenf.flicker.conversions import find_by_drift
from rsenf.flicker.lines import ProfileBasis
from rsenf.flicker.picture_news import PictureChange, find_remade
from rsenf.flicker.rate_conversion import BLENDED, Conversion, find_conversion
from rsenf.messages import Header
from rsenf.rows.stage import blocks_from_luminance
from tests.discrepancy.foreign_camera import Case, shoot, trial
from tests.flicker.foreign_rows import follow

EITHER = (50.0, 60.0)  # the grids whose light is sought

RATES = {"24": 24.0, "25": 25.0, "30": 30.0, "30000/1001": 30e3 / 1001, "60": 60.0}


def made_from(source_hz: float, shown_hz: float, place: float, *, blended: bool) -> np.ndarray:
    """Even pictures with noise, 20 s of them, that a converter has made of a camera's frames."""
    rng = np.random.default_rng([round(1e3 * source_hz), round(1e3 * shown_hz)])
    shown = np.arange(round(20 * shown_hz)) * source_hz / shown_hz + place
    frames = rng.standard_normal((int(shown[-1]) + 2, 120, 2))
    whole, share = shown.astype(int), (shown % 1.0)[:, None, None] * blended
    return np.asarray(100.0 + (1.0 - share) * frames[whole] + share * frames[whole + 1])


@pytest.mark.parametrize(("source", "shown"), [("24", "30"), ("25", "30000/1001")])
@pytest.mark.parametrize("place", [0.13, 0.71])
def test_doubled_pictures_tell_which_are(source: str, shown: str, place: float) -> None:
    source_hz, shown_hz = RATES[source], RATES[shown]
    news = PictureChange()
    told = news.of(made_from(source_hz, shown_hz, place, blended=False))
    stamp_s = np.arange(len(told)) / shown_hz
    found = find_remade(stamp_s, told, shown_hz, news.chance)
    assert found is not None
    assert not found.blended
    true = Conversion(source_hz, shown_hz, place)
    wrong = found.taken_s(stamp_s) != true.taken_s(stamp_s)
    assert np.mean(wrong) < 0.01


@pytest.mark.parametrize(
    ("source", "shown"),
    [("25", "30"), ("30", "25"), ("30", "24"), ("30", "30000/1001"), ("24", "25")],
)
def test_blended_pictures_are_told(source: str, shown: str) -> None:
    news, shown_hz = PictureChange(), RATES[shown]
    told = news.of(made_from(RATES[source], shown_hz, 0.3, blended=True))
    found = find_remade(np.arange(len(told)) / shown_hz, told, shown_hz, news.chance)
    assert found is not None
    assert found.blended


@pytest.mark.parametrize("shown", RATES)
def test_whole_pictures_are_not(shown: str) -> None:
    news, shown_hz = PictureChange(), RATES[shown]
    told = news.of(made_from(shown_hz, shown_hz, 0.0, blended=False))
    assert find_remade(np.arange(len(told)) / shown_hz, told, shown_hz, news.chance) is None


def test_how_pictures_come_in_blocks_changes_nothing() -> None:
    level = made_from(24.0, 30.0, 0.2, blended=True)
    one, other = PictureChange(), PictureChange()
    parts = [other.of(part) for part in np.array_split(level, 41)]
    assert np.array_equal(one.of(level), np.concatenate(parts))


@pytest.mark.parametrize(
    ("seed", "rate", "nominal_hz"),
    [(2, "24", 50.0), (5, "24", 50.0), (4, "25", 60.0), (6, "25", 60.0), (5, "24000/1001", 50.0)],
)
def test_doubling_is_undone(seed: int, rate: str, nominal_hz: float) -> None:
    case = Case(
        hidden=("converted",), seed=seed, rate=rate, nominal_hz=nominal_hz, rows=240, strips=1,
        duration_s=40.0, lamp="led",
    )  # fmt: skip
    clip = follow(case)
    assert clip.hidden["converted"]["doubled"] > 100
    assert clip.converted
    assert clip.z.size >= 35
    assert clip.rms_z < 2.0
    assert np.abs(clip.off_hz).max() < 1e-3


@pytest.mark.parametrize("seed", range(500, 506))
def test_blended_is_refused_with_the_reason(seed: int) -> None:
    """From 30 to 24 and 25 frames/s, where light of one grid looks like the other's."""
    case = Case(
        hidden=("blended",), seed=seed, rate="30", nominal_hz=60.0, rows=240, strips=1,
        duration_s=30.0, lamp="led",
    )  # fmt: skip
    clip = follow(case)
    assert clip.z.size == 0
    assert clip.seconds[-1].reason == BLENDED


@pytest.mark.parametrize("kind", ["led", "magnetic", "several sources", "moving object"])
def test_nothing_is_said_to_be_converted_that_is_not(kind: str) -> None:
    for seed in range(600, 604):
        clip = follow(trial(kind, seed, duration_s=25.0))
        assert not clip.converted, seed
        assert clip.seconds[-1].reason != BLENDED, seed


@pytest.mark.parametrize("seed", [9007, 9019, 9031])
def test_flicker_on_a_texture_is_no_blending(seed: int) -> None:
    """It repeats every three frames, as 30 frames/s that were blended of 50 would."""
    clip = follow(trial("magnetic", seed, rate="30", nominal_hz=50.0, duration_s=15.0))
    assert clip.z.size >= 14


@pytest.mark.parametrize("kind", ["gain steps", "key dimming"])
def test_gains_that_change_are_no_blending(kind: str) -> None:
    for seed in (9058, 9064):
        clip = follow(trial(kind, seed, rate="30", nominal_hz=50.0, duration_s=15.0))
        assert clip.seconds[-1].reason != BLENDED


@pytest.mark.parametrize(("seed", "rate"), [(2, "30"), (5, "30000/1001"), (4, "60"), (7, "30.01")])
def test_light_tells_a_blend_where_no_noise_is_left(seed: int, rate: str) -> None:
    case = Case(
        hidden=("blended",), seed=seed, rate=rate, nominal_hz=50.0, rows=240, strips=1,
        duration_s=20.0, lamp="led",
    )  # fmt: skip
    filmed = shoot(case, noisy=False)
    shown_hz, source_hz = filmed.truth["file_rate"], filmed.truth["frame_rate"]
    basis = ProfileBasis(240, 360.0 / shown_hz)
    (block,) = blocks_from_luminance(filmed.level, filmed.stamp_s, Header(), block_frames=2000)
    found = find_conversion((50.0, 60.0), filmed.stamp_s, basis.reduce(block), shown_hz)
    assert found is not None
    assert found.blended
    assert found.source_hz == pytest.approx(source_hz, rel=5e-4)


def test_a_beat_of_a_few_frames_is_no_overtones_of_the_other_grid() -> None:
    """Of 60 frames/s every 2.4th is shown: at 25 the light at 50 Hz looks much like 60 Hz."""
    clip = follow(trial("converted", 20101, rate="60", nominal_hz=50.0, grid="rough"))
    assert clip.converted
    assert clip.off_hz.size > 50
    assert clip.rms_z < 2.0


@pytest.mark.parametrize(("seed", "rate"), [(33220, "30.01"), (33195, "60.02")])
def test_a_beat_that_is_off_is_found_wherever_it_steps(seed: int, rate: str) -> None:
    """A rate a little off nominal moves its beat by a step in the window that is looked at."""
    grid = "rough" if rate == "30.01" else "continental"
    clip = follow(trial("converted", seed, rate=rate, nominal_hz=50.0, grid=grid))
    assert not clip.off_hz.size or (clip.converted and clip.rms_z < 2.0)


def test_a_monitor_beside_a_lamp_is_no_conversion() -> None:
    """At 30.01 frames/s a 60 Hz monitor and light at 50 Hz look like 50 frames/s brought to 30."""
    clip = follow(trial("monitor beside", 38061, rate="30.01", nominal_hz=50.0, grid="rough"))
    assert not clip.converted
    assert clip.off_hz.size > 50
    assert clip.rms_z < 2.0


@pytest.mark.parametrize(
    ("rate", "nominal_hz", "grid", "seed", "source_hz"),
    [("30", 60.0, "continental", 40145, 30.0), ("25", 50.0, "continental", 40245, 25.0),
     ("60000/1001", 60.0, "rough", 44170, 60e3 / 1001)],
)  # fmt: skip
def test_light_that_stands_still_before_and_after_tells_by_its_drift(
    rate: str, nominal_hz: float, grid: str, seed: int, source_hz: float
) -> None:
    """30 to 25 at 60 Hz looks like 25 frames/s at 50 Hz, but for steps of the grid's drift."""
    plan = trial("converted", seed, rate=rate, nominal_hz=nominal_hz, grid=grid, duration_s=60.0)
    made = follow(plan)
    assert made.converted
    assert made.off_hz.size > 50
    assert made.rms_z < 2.0
    assert {round(s.frame_rate_hz, 6) for s in made.seconds if s.usable} == {round(source_hz, 6)}


def test_still_light_at_its_own_rate_shows_no_conversion() -> None:
    rng = np.random.default_rng(3)
    t_s = np.arange(600) / 25.0
    drift = np.cos(0.3 * t_s + rng.uniform(0.0, 6.0, 40)[:, None]).T
    columns = drift + 1e-3 * rng.standard_normal(drift.shape)
    assert find_by_drift(EITHER, t_s, columns, 25.0) is None
    late_s = np.floor(t_s * 30.0 + 0.3) / 30.0
    moved = np.cos(0.3 * late_s + rng.uniform(0.0, 6.0, 40)[:, None]).T
    found = find_by_drift(EITHER, t_s, moved + 1e-3 * rng.standard_normal(moved.shape), 25.0)
    assert found is not None
    assert found.source_hz == 30.0


def test_what_a_codec_holds_back_is_no_conversion() -> None:
    """Blocks of a picture that are skipped show an earlier frame's light, for a while each."""
    for seed in range(6):
        rng = np.random.default_rng(seed)
        t_s = np.arange(500) / 25.0
        columns = np.cos(0.3 * t_s + rng.uniform(0.0, 6.0, 40)[:, None]).T
        held = columns.copy()
        for column in range(columns.shape[1]):
            kept = np.maximum.accumulate(np.where(rng.random(500) < 0.3, np.arange(500), 0))
            held[:, column] = columns[kept, column]
        noisy = held + 1e-3 * rng.standard_normal(held.shape)
        assert find_by_drift(EITHER, t_s, noisy, 25.0) is None


def test_an_encoder_s_beat_is_doubtful() -> None:
    """Each fifth picture shows light of a frame before, each fifth of one after: B frames."""
    rng = np.random.default_rng(8)
    t_s = np.arange(600) / 25.0
    late_s = np.tile([0.025, 0.0, -0.033, 0.0, 0.008], 120)
    columns = np.cos(0.3 * (t_s + late_s) + rng.uniform(0.0, 6.0, 40)[:, None]).T
    noisy = columns + 2e-3 * rng.standard_normal(columns.shape)
    found = find_by_drift(EITHER, t_s, noisy, 25.0)
    assert found is not None
    assert found.why_not_undone.startswith("strong overtones, an encoder's beat")
    assert find_by_drift((50.0,), t_s, noisy, 25.0) is None  # 100 Hz doesn't drift at 30 frames/s


@pytest.mark.parametrize("frames", [2, 5, 11])
def test_a_few_frames_show_no_conversion(frames: int) -> None:
    columns = np.random.default_rng(4).normal(0.0, 1.0, (frames, 6))
    assert find_conversion((50.0, 60.0), np.arange(frames) / 30.0, columns, 30.0) is None


@pytest.mark.parametrize("rate_hz", [0.6, 0.95, 1.5, 2.0])
def test_a_few_frames_a_second_show_no_conversion(rate_hz: float) -> None:
    columns = np.random.default_rng(4).normal(0.0, 1.0, (100, 6))
    assert find_by_drift(EITHER, np.arange(100) / rate_hz, columns, rate_hz) is None


def slow_drift(rate_hz: float, nominal_hz: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Times and rows of 20 s of light whose alias is near 0 Hz: it drifts with the grid."""
    rng = np.random.default_rng(seed)
    t_s = np.arange(int(20 * rate_hz)) / rate_hz
    off_hz = rng.uniform(-0.05, 0.05)
    walk_hz = np.cumsum(rng.standard_normal(t_s.size)) * 0.002 / np.sqrt(rate_hz)
    phase = rng.uniform(0, 6.28) + 2 * np.pi * (off_hz * t_s + np.cumsum(walk_hz) / rate_hz)
    ramp = 2 * np.pi * 2 * nominal_hz / rate_hz * 0.7 * np.linspace(0, 1, 12, endpoint=False)
    phi = phase[:, None] + ramp
    light = np.cos(phi) + rng.uniform(0, 0.6) * np.cos(2 * phi + 1)
    light += rng.uniform(0, 0.2) * np.cos(3 * phi + 2) + rng.uniform(0, 0.2) * np.cos(4 * phi)
    return t_s, 100 * (1 + 0.3 * light) + 0.001 * rng.standard_normal(phi.shape)


@pytest.mark.parametrize(
    ("rate_hz", "nominal_hz", "seed"),
    [(25.0, 50.0, 68), (30.0, 60.0, 200), (24.0, 60.0, 267), (50.0, 50.0, 60)],
)
def test_a_slow_drift_by_the_stamps_is_no_conversion(
    rate_hz: float, nominal_hz: float, seed: int
) -> None:
    t_s, rows = slow_drift(rate_hz, nominal_hz, seed)
    assert find_conversion((50.0, 60.0), t_s, rows, rate_hz) is None


def _moved(light_hz: float, taken_s: np.ndarray, stamp_s: np.ndarray, seed: int) -> np.ndarray:
    """Columns under light, in a picture that moves slowly and half as strongly."""
    rng = np.random.default_rng(seed)
    rad = 2.0 * np.pi * light_hz * taken_s
    waves = (np.cos(rad), np.sin(rad), 0.1 * np.cos(2.0 * rad), 0.1 * np.sin(2.0 * rad))
    shapes = rng.standard_normal((4, 12))
    motion = np.sin(0.7 * stamp_s + seed) + np.sin(0.3 * stamp_s + 1.0 + seed)
    columns = np.column_stack(waves) @ shapes + 0.5 * np.outer(motion, shapes[0])
    return np.asarray(columns + 0.02 * rng.standard_normal(columns.shape))


@pytest.mark.parametrize("seed", range(20, 30))
def test_a_film_that_moves_is_not_taken_for_converted(seed: int) -> None:
    """60 Hz light at 50 frames/s has the period of the beat of 60 made 50, but for 0 Hz."""
    stamp_s = np.arange(1000) / 50.0
    columns = _moved(120.02, stamp_s, stamp_s, seed)
    assert find_conversion(EITHER, stamp_s, columns, 50.0) is None


def test_most_films_that_move_and_were_converted_are_found() -> None:
    stamp_s = np.arange(1000) / 50.0
    taken_s = np.floor(stamp_s * 60.0 + 0.3) / 60.0
    films = [_moved(100.02, taken_s, stamp_s, seed) for seed in range(20, 30)]
    found = [find_conversion(EITHER, stamp_s, columns, 50.0) for columns in films]
    assert sum(one is not None for one in found) >= 7
    assert all(one is None or one.source_hz == 60.0 for one in found)

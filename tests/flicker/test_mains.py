"""Mains light or not: patterns are refused, strong as they are, and weak lamps are not."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rsenf.flicker import cell_light, grid_prior, mains, near_dc
from rsenf.flicker.follower import FlickerFollower
from rsenf.flicker.grid_prior import phase_prior
from rsenf.flicker.mains import is_faint
from rsenf.idle import IdleSettings, make_idle
from rsenf.messages import Header, RowBlock
from rsenf.rows.stage import blocks_from_luminance
from rsenf.track import TrackSettings, make_tracker
from tests.discrepancy.foreign_camera.trials import trial
from tests.flicker import no_mains, weak_lamps
from tests.flicker.claims import Claims, claims
from tests.flicker.foreign_rows import follow


@pytest.mark.parametrize(
    ("kind", "seed"),
    [
        ("stripes", 3),  # ENF and idle were claimed of each of these, or one of them
        ("stripes", 11),
        ("slow_stripes", 0),
        ("slow_stripes", 7),
        ("near_grid_stripes", 10),
        ("dimmer", 0),
        ("dimmer", 11),
        ("vibration", 11),
        ("scrolling", 4),
        ("blinking", 2),
        ("key_frames", 10),
        ("turning", 10),
    ],
)
def test_what_is_no_mains_light_is_claimed_by_nobody(kind: str, seed: int) -> None:
    found = claims(*no_mains.film(kind, seed))
    assert not found.usable
    assert found.idle.verdict != "estimated"
    assert all(e.reason for e in found.track)


@pytest.mark.parametrize(
    ("kind", "seed"), [("dimmer", 7004), ("blinking", 7003), ("blinking", 7005)]
)
@pytest.mark.parametrize("strips", [2, 0])
def test_short_pieces_of_it_are_claimed_by_nobody(kind: str, seed: int, strips: int) -> None:
    level, t_s = no_mains.film(kind, seed)
    for seconds in (3.1, 7.1):
        part = level[t_s < t_s[0] + seconds]
        part = part.reshape(*part.shape[:2], strips or part.shape[2], -1).mean(axis=3)
        found = claims(part, t_s[: len(part)] - t_s[0])
        assert not found.usable
        assert found.idle.verdict != "estimated"


@pytest.mark.parametrize("name", ["none_dashes_1", "none_dashes_2"])
@pytest.mark.parametrize("strips", [2, 8])
def test_short_pieces_of_dashes_are_claimed_by_nobody(
    measured_data: Path, name: str, strips: int
) -> None:
    for start_s in (0.0, 2.5):
        for found in (real_piece(measured_data, name, start_s, s, strips) for s in (3.1, 7.1)):
            assert not found.usable
            assert found.idle.verdict != "estimated"
            assert found.idle.reason


@pytest.mark.parametrize(("start_s", "seconds"), [(1.0, 3.1), (3.0, 4.1), (4.0, 5.1), (1.0, 7.1)])
def test_short_pieces_of_a_real_camera_agree_with_an_independent_reading(
    measured_data: Path, start_s: float, seconds: float
) -> None:
    found = real_piece(measured_data, "pi_scanny_30", start_s, seconds, 8)
    assert len(found.usable) == int(seconds)
    off_s = found.idle.read_out_time_s - 23.23e-3
    assert found.idle.verdict == "estimated"
    assert abs(off_s) < 3.0 * found.idle.read_out_time_var_s2**0.5 < 0.3e-3


def real_piece(data: Path, name: str, start_s: float, seconds: float, strips: int) -> Claims:
    """Let both look at a piece of real rows."""
    rows = np.load(data / "real_rows" / f"{name}.npz")
    t_s, level = rows["frame_time_s"], rows["rows"]
    part = (t_s >= start_s) & (t_s < start_s + seconds)
    level = level[part].reshape(part.sum(), level.shape[1], strips, -1).mean(axis=3)
    return claims(level, t_s[part] - start_s)


@pytest.mark.parametrize(("method", "kind", "seed"), [
    ("stft", "stripes", 11),
    ("phase", "vibration", 11),
    ("row_concat", "dimmer", 11),
    ("superpixel", "stripes", 11),
])  # fmt: skip
def test_the_other_methods_ask_the_same(method: str, kind: str, seed: int) -> None:
    assert not claims(*no_mains.film(kind, seed), track=method).usable


@pytest.mark.parametrize("seed", [2, 44, 49])
def test_weak_lamps_are_read(seed: int) -> None:
    """Flicker of 0.025 %, which a limit on strength refused."""
    level, t_s, truth = weak_lamps.film(seed, flicker_ratio=2.5e-4, lamps=1, pace=(50.0, "24"))
    found = claims(level, t_s)
    assert len(found.usable) > 0.7 * len(found.track)
    at = [int(e.t_s) for e in found.usable if e.t_s < truth["enf_hz"].size]
    off_hz = np.array([e.enf_hz for e in found.usable[: len(at)]]) - truth["enf_hz"][at]
    assert np.abs(off_hz).max() < 6e-3
    if found.idle.verdict == "estimated":
        std = np.sqrt(found.idle.idle_ratio_var)
        assert abs(found.idle.idle_ratio - truth["idle_ratio"]) < 4.0 * std


@pytest.mark.parametrize("seed", [21, 39, 53])
def test_lamps_of_several_phases_widen_the_idle_period(seed: int) -> None:
    """Their mixture turns down the rows as a read-out does; it was stated ten times too sure."""
    level, t_s, truth = weak_lamps.film(
        seed, flicker_ratio=0.01, lamps=2, pace=(50.0, "30000/1001")
    )
    idle = claims(level, t_s).idle
    if idle.verdict == "estimated":
        std = np.sqrt(idle.idle_ratio_var)
        assert abs(idle.idle_ratio - truth["idle_ratio"]) < 4.0 * std


def test_real_dashes_on_a_road_are_no_light(measured_data: Path) -> None:
    for name in ("none_dashes_1", "none_dashes_2"):
        held = np.load(measured_data / "real_rows" / f"{name}.npz")
        found = claims(held["rows"], held["frame_time_s"])
        assert not found.usable
        assert found.idle.verdict != "estimated"


def light(level: np.ndarray, tone: np.ndarray, noise: float = 0.02) -> cell_light.CellLight:
    """What cells of 20 s at 30 frames/s show that turn at 10 Hz, with a little noise."""
    rng = np.random.default_rng(1)
    t_s = np.arange(600) / 30.0
    phase = 2.0 * np.pi * 10.0 * t_s
    seen = level + (tone * np.exp(1j * phase)[:, None, None]).real
    seen = seen + noise * rng.standard_normal(seen.shape)
    return cell_light.light_of(seen.reshape(600, -1), t_s, phase, level.shape[0], 3.3)


def test_light_multiplies_and_runs_down_the_rows() -> None:
    rng = np.random.default_rng(0)
    level = 80.0 * np.exp(rng.uniform(-0.7, 0.7, (24, 4)))
    ramp = np.exp(2j * np.pi * 2.3 * (np.arange(24) + 0.5) / 24)[:, None]
    lamp = light(level, 0.01 * level * ramp)
    assert lamp.turns == pytest.approx(2.3, abs=0.03)
    assert lamp.explained > 0.99
    assert lamp.is_multiplied
    assert not mains.why_not_light(lamp, 3.3, grid_prior.Wander())
    added = light(level, 0.8 * np.ones_like(level) * ramp)
    assert added.is_added
    assert mains.why_not_light(added, 3.3, grid_prior.Wander()) == mains.PATTERN
    slanted = np.exp(2j * np.pi * np.arange(4) * 0.4)
    assert mains.why_not_light(
        light(level, 0.01 * level * ramp * slanted), 3.3, grid_prior.Wander()
    )
    assert (
        mains.why_not_light(light(level, 0.01 * level * ramp**2), 3.3, grid_prior.Wander())
        == mains.TOO_LONG
    )


@pytest.mark.parametrize("seed", range(3))
def test_what_alternates_from_frame_to_frame_is_claimed_by_nobody(seed: int) -> None:
    """An encoder's doing: at 48 frames/s light at 60 Hz alternates as well."""
    rng = np.random.default_rng(seed)
    frames = np.arange(1100)
    level = 80.0 + 30.0 * rng.uniform(size=(96, 8)) + 0.02 * rng.standard_normal((1100, 96, 8))
    level += 0.2 * (-1.0) ** frames[:, None, None] * rng.standard_normal((96, 8))
    assert not claims(level, frames / 48.0, track="stft").usable


@pytest.mark.parametrize(("light_hz", "usable"), [(100.0, False), (99.94, False), (119.97, True)])
def test_light_that_stands_still_under_frame_types_is_no_other_grids(
    light_hz: float, usable: bool
) -> None:
    """At 50 frames/s types that repeat every five frames turn at 20 Hz, as light at 120 Hz does."""
    rng, frames, place = np.random.default_rng(2), np.arange(750), (np.arange(96) + 0.5) / 96
    types = np.array([1.0, 0.7, 0.85, 0.6, 0.9])[frames % 5, None]
    wave = types * np.cos(2.0 * np.pi * light_hz * (frames[:, None] / 50.0 + 0.013 * place))
    level = 80.0 * np.exp(rng.uniform(-0.5, 0.5, (96, 8))) * (1.0 + 0.05 * wave[:, :, None])
    level += 0.1 * rng.standard_normal(level.shape)
    found = claims(level, frames / 50.0)
    assert bool(found.usable) is usable


@pytest.mark.parametrize(("still_ratio", "nominal_hz"), [(0.05, 50.0), (0.0, 60.0)])
def test_stronger_light_that_stands_still_goes_before_a_tone(
    still_ratio: float, nominal_hz: float
) -> None:
    """At 50 frames/s one is of a 50 Hz grid, the other of a 60 Hz one."""
    rng, t_s, place = np.random.default_rng(3), np.arange(1300) / 50.0, (np.arange(96) + 0.5) / 96
    when = t_s[:, None] + 0.013 * place
    wave = 0.005 * np.cos(2.0 * np.pi * 119.97 * when)
    wave += still_ratio * np.cos(2.0 * np.pi * 99.94 * when)
    texture = np.exp(np.repeat(rng.uniform(-0.7, 0.7, (24, 8)), 4, axis=0))
    level = 80.0 * texture * (1.0 + wave[:, :, None])
    found = claims(level + 0.1 * rng.standard_normal(level.shape), t_s).usable
    assert len(found) > 20
    assert {estimate.nominal_hz for estimate in found} == {nominal_hz}


def test_key_frames_are_told_within_the_error_of_a_frequency() -> None:
    rng = np.random.default_rng(0)
    level = 80.0 * np.exp(rng.uniform(-0.7, 0.7, (24, 4)))
    nearly, rate_hz = light(level, 0.01 * level), 30000 / 1001
    nearly = dataclasses.replace(nearly, turns=0.1)
    off_hz = 0.01  # every third frame is at 99.9 Hz
    told = [
        mains.why_not(
            99.9 + times * off_hz, 50.0, rate_hz, grid_prior.Wander(), known, unfiltered=False
        )
        for times, known in (
            (0.5, nearly),
            (1.5, nearly),
            (1.5, dataclasses.replace(nearly, hz_std=0.006)),
            (4.5, dataclasses.replace(nearly, turns=0.0)),
        )
    ]
    assert told == [mains.KEYED, "", mains.KEYED, mains.KEYED]


def test_a_grid_is_seldom_steady_and_never_restless() -> None:
    prior = phase_prior(125)
    precision = 1e4 * prior.basis.T @ prior.basis + np.eye(prior.basis.shape[1])
    rng = np.random.default_rng(2)
    drawn = rng.standard_normal((4000, prior.basis.shape[1]))
    told = [grid_prior.wander_of(one, precision, 125) for one in drawn]
    assert told[0].known == grid_prior.DIRECTIONS
    assert sum(w.is_steady for w in told) <= 6  # 3e-4 of 4000, and luck
    assert not any(w.is_restless for w in told)
    rest = grid_prior.wander_of(np.zeros(prior.basis.shape[1]), precision, 125)
    assert rest.is_steady


def test_what_an_exposure_leaves_goes_as_the_grids_deviation() -> None:
    assert is_faint(2e-4, 100.1, 50.0)  # a strong lamp's rest, 0.1 % off
    assert not is_faint(2e-4, 100.01, 50.0)  # no exposure leaves so much of any
    assert is_faint(5e-5, 100.0, 50.0)


def test_light_that_hardly_moves_has_to_be_clearer() -> None:
    rng = np.random.default_rng(1)
    level = 80.0 * np.exp(rng.uniform(-0.7, 0.7, (24, 4)))
    lamp = light(level, 0.01 * level, noise=0.5)
    unclear = dataclasses.replace(lamp, explained=0.82, explained_std=0.001, added=0.82)
    moves, rests = (grid_prior.Wander(known=4, squares=squares) for squares in (6.0, 1.0))
    assert not mains.why_not_light(unclear, 3.3, moves)
    assert mains.why_not_light(unclear, 3.3, rests) == mains.PATCHY
    assert not mains.why_not_light(dataclasses.replace(unclear, explained=0.9), 3.3, rests)


def test_light_of_which_a_codec_keeps_blocks_back_has_to_move_as_a_grids() -> None:
    rng = np.random.default_rng(1)
    level = 80.0 * np.exp(rng.uniform(-0.7, 0.7, (24, 4)))
    ramp = np.exp(2j * np.pi * 2.3 * (np.arange(24) + 0.5) / 24)[:, None]
    kept = rng.uniform(size=level.shape) < 0.3
    patchy = light(level, 0.02 * level * ramp * kept, noise=0.5)
    assert patchy.explained < 0.6
    assert patchy.in_phase > 0.95
    moves = grid_prior.Wander(known=3, squares=3.0, squared_z=100.0)
    unsure, rests = (
        dataclasses.replace(moves, squared_z=10.0),
        dataclasses.replace(moves, squares=0.01),
    )
    assert not mains.why_not_light(patchy, 3.3, moves)
    clear = light(level, 0.02 * level * ramp * kept)  # as no codec's
    assert mains.why_not_light(clear, 3.3, moves) == mains.PATTERN
    assert mains.why_not_light(patchy, 3.3, unsure) == mains.PATCHY
    assert mains.why_not_light(patchy, 3.3, rests) != ""
    textures = light(level, 0.02 * level * ramp * np.exp(2j * np.pi * rng.uniform(size=(24, 4))))
    assert mains.why_not_light(textures, 3.3, moves) == mains.PATTERN


@pytest.mark.parametrize(
    ("seed", "rate"),
    [
        (50236, "60"),  # at 49.9994 Hz: the lamp makes it sway
        (52036, "30000/1001"),  # at 49.95 Hz: 3 % of it looks like light, and it swayed once
        (52286, "60"),  # taken for 29.979 frames/s, each shown twice
    ],
)
def test_a_monitor_beside_a_lamp_is_no_grids_light(seed: int, rate: str) -> None:
    grid = "rough" if seed == 50236 else "continental"
    made = follow(trial("monitor beside", seed, rate=rate, nominal_hz=60.0, grid=grid))
    assert np.abs(made.off_hz).max(initial=0.0) < 0.05
    if grid == "continental":
        assert len(made.off_hz) > 50
        assert np.sqrt(np.mean(made.off_hz**2)) < 3e-3


def test_patchy_light_that_comes_to_rest_is_none() -> None:
    rng = np.random.default_rng(1)
    level = 80.0 * np.exp(rng.uniform(-0.7, 0.7, (24, 4)))
    kept = rng.uniform(size=level.shape) < 0.3
    patchy = light(level, 0.02 * level * kept, noise=0.5)
    calm, rests = (grid_prior.Wander(known=4, squares=squares) for squares in (0.3, 0.02))
    assert not mains.why_not_light(patchy, 3.3, calm, has_moved=True)
    assert mains.why_not_light(patchy, 3.3, rests, has_moved=True) == mains.PATCHY
    little = dataclasses.replace(patchy, explained=0.1)
    assert mains.why_not_light(little, 3.3, calm, has_moved=True) == mains.PATTERN


def test_light_has_one_ramp_whatever_else_it_looks_like() -> None:
    """Stripes at 25 frames/s, nearly multiplied, with a third in phase: 60.01 Hz once."""
    made = follow(trial("stripes", 52099, rate="25", nominal_hz=50.0, grid="rough"))
    assert not made.off_hz.size


def test_a_quartz_far_from_the_grids_frequency_has_to_wander() -> None:
    rng = np.random.default_rng(0)
    level = 80.0 * np.exp(rng.uniform(-0.7, 0.7, (24, 4)))
    ramp = np.exp(2j * np.pi * 1.2 * (np.arange(24) + 0.5) / 24)[:, None]
    lamp = light(level, 0.01 * level * ramp)
    unknown, rests, moves = (
        grid_prior.Wander(known=known, squares=squares)
        for known, squares in ((0, 0.0), (2, 0.01), (2, 0.5))
    )
    at = 60.02  # frames/s, where 200 Hz looks like 100.1 Hz
    told = [
        mains.why_not(100.09, 50.0, at, w, lamp, unfiltered=False) for w in (unknown, rests, moves)
    ]
    assert told == ["", mains.TOO_BRIEF, ""]
    assert not mains.why_not(100.01, 50.0, at, rests, lamp, unfiltered=False)


def test_light_without_the_loop_filter_is_clear_or_moves() -> None:
    """Coded as P and B frames in turn, light that stands still looks like one that turns."""
    rng = np.random.default_rng(1)
    level = 80.0 * np.exp(rng.uniform(-0.7, 0.7, (24, 4)))
    ramp = np.exp(2j * np.pi * 2.3 * (np.arange(24) + 0.5) / 24)[:, None]
    clear = light(level, 0.01 * level * ramp)
    unclear = dataclasses.replace(clear, explained=0.88, explained_std=0.001, added=0.88)
    unknown, moves = grid_prior.Wander(), grid_prior.Wander(known=4, squares=6.0, squared_z=100.0)
    for lamp, wander, why in (
        (clear, unknown, ""),
        (unclear, moves, ""),
        (unclear, unknown, mains.UNFILTERED),
    ):
        assert mains.why_not(100.01, 50.0, 29.97, wander, lamp, unfiltered=True) == why
        assert not mains.why_not(100.01, 50.0, 29.97, wander, lamp, unfiltered=False)


def unclear_light(fast: int, *, frame_s: float = 1.001 / 30.0) -> list[RowBlock]:
    """600 frames of light that hardly moves and shows unevenly, some blocks decoded fast."""
    rng, place = np.random.default_rng(1), (np.arange(96) + 0.5) / 96
    texture, share = np.repeat(rng.uniform(-1.0, 1.0, (2, 24, 8)), 4, axis=1)
    t_s = np.arange(600) * frame_s
    wave = np.cos(2.0 * np.pi * (100.01 * t_s[:, None] + 2.3 * place))[:, :, None]
    level = 80.0 * np.exp(0.7 * texture) * (1.0 + 0.01 * (1.0 + 0.5 * share) * wave)
    level += 3.0 * rng.standard_normal(level.shape)
    blocks = blocks_from_luminance(level.astype(np.float32), t_s, Header(source="t/c"))
    return [
        dataclasses.replace(block, effort="fast" if k < fast else "")
        for k, block in enumerate(blocks)
    ]


@pytest.mark.parametrize(("fast", "usable"), [(0, True), (73, False), (1, False)])
def test_one_block_without_the_loop_filter_makes_a_window_one(fast: int, usable: bool) -> None:
    for stage in (FlickerFollower(), make_tracker(TrackSettings(method="stft", nominal_hz=50.0))):
        found = [x for block in unclear_light(fast) for x in stage.update(block)] + stage.flush()
        assert any(x.usable for x in found) is usable


@pytest.mark.parametrize("fast", [0, 1])
def test_light_that_stands_still_is_judged_by_the_loop_filter_too(
    fast: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    told, why_not = [], near_dc.why_not

    def judged(*args: Any, unfiltered: bool) -> str:
        told.append(unfiltered)
        return why_not(*args, unfiltered=unfiltered)

    monkeypatch.setattr(near_dc, "why_not", judged)
    for stage in (FlickerFollower(50.0), make_idle(IdleSettings(nominal_hz=50.0))):
        for block in unclear_light(fast, frame_s=0.04):
            stage.update(block)
        before = len(told)
        stage.flush()
        assert len(told) > before
    assert set(told) == {bool(fast)}

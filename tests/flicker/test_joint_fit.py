"""Path, amplitudes and ramp fitted together, on a foreign camera and by the spread over noise."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from rsenf.flicker.grid_prior import NODES_PER_S
from rsenf.flicker.lines import ProfileBasis
from rsenf.flicker.phase_fit import fit_phase
from rsenf.flicker.phase_likelihood import WindowFrames
from rsenf.track import TrackSettings, make_tracker
from tests.contracts.clips import blocks_of
from tests.discrepancy.foreign_camera import Case, film
from tests.discrepancy.foreign_camera.camera import take
from tests.discrepancy.foreign_camera.cases import drawn_for, plan_of

SECONDS, ROWS, WINDOW_S = 36.0, 240, 24


def errors(case: Case) -> tuple[np.ndarray, np.ndarray]:
    """Errors of a film's seconds in mHz, and over what is stated."""
    filmed = film(case)
    tracker = make_tracker(TrackSettings(method="projection"))
    blocks = blocks_of(filmed.level, filmed.stamp_s)
    told = [e for block in blocks for e in tracker.update(block)] + tracker.flush()
    usable = [e for e in told if e.usable]
    assert len(usable) >= 0.9 * len(told)
    true_hz = np.array(filmed.truth["grid_hz"])[[int(e.t_s) for e in usable]]
    off_hz = np.array([e.enf_hz for e in usable]) - true_hz
    return 1e3 * off_hz, off_hz / np.sqrt([e.enf_var_hz2 for e in usable])


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


@pytest.mark.parametrize(
    ("rate", "lamp", "hidden", "seed"),
    [
        # The second harmonic's alias on the first one's mirror image.
        ("60", "led", (), 3),
        ("60", "led", ("harmonics",), 3),
        ("60000/1001", "led", ("harmonics",), 2),
        ("30", "led", ("harmonics",), 3),
        # Half waves that differ: light at the grid's own frequency.
        ("60", "half_wave", (), 2),
        ("30000/1001", "half_wave", (), 2),
        ("30000/1001", "half_wave", (), 3),
    ],
)
def test_harmonics_on_each_other_and_half_waves_are_within_their_errors(
    rate: str, lamp: str, hidden: tuple[str, ...], seed: int
) -> None:
    case = Case(
        hidden=hidden,
        seed=seed,
        times=30.0,
        duration_s=SECONDS,
        rows=ROWS,
        lamp=lamp,
        rate=rate,
        nominal_hz=50.0,
    )
    off_mhz, z = errors(case)
    assert rms(off_mhz) < 0.1
    assert rms(z) < 1.7


@pytest.mark.parametrize(("rate", "seed"), [("30", 4), ("30000/1001", 5)])
def test_light_at_the_grids_own_frequency_is_not_taken_for_a_reversed_read_out(
    rate: str, seed: int
) -> None:
    case = Case(seed=seed, duration_s=30.0, rows=ROWS, lamp="led", rate=rate, nominal_hz=50.0)
    plan, _ = plan_of(case)
    lamp = plan.lamps[0].lamp
    order, size = np.append(lamp.order, 1), np.append(lamp.size, 2.0 * lamp.first)
    half = dataclasses.replace(lamp, order=order, size=size)
    plan.lamps[0] = dataclasses.replace(plan.lamps[0], lamp=half)
    level = take(plan, drawn_for(case, "noise"))
    tracker = make_tracker(TrackSettings(method="projection"))
    blocks = blocks_of(level, plan.stamp_s)
    told = [e for block in blocks for e in tracker.update(block)] + tracker.flush()
    assert not any(e.usable for e in told)
    assert all(e.reason for e in told)  # whichever check sees it first


def mirrored(rng: np.random.Generator, basis: ProfileBasis) -> tuple[WindowFrames, np.ndarray]:
    """Frames at 30 a second under a 50 Hz grid that hardly moves, and the phase at the nodes."""
    t_s = np.arange(30 * WINDOW_S) / 30.0
    node_t = np.arange(WINDOW_S * NODES_PER_S + 1) / NODES_PER_S
    psi = 0.3 * np.sin(2 * np.pi * node_t / 60.0)
    carrier = 200.0 * np.pi * t_s
    place = (np.arange(basis.rows) + 0.5) / basis.rows
    texture = 100.0 * (1.0 + 0.1 * np.sin(7.0 * place))
    phase = (carrier + np.interp(t_s, node_t, psi))[:, None] + 2 * np.pi * 1.9 * place
    light = 1.0 + 0.05 * np.cos(phase) + 0.03 * np.cos(2 * phase + 1.0)
    rows = texture * light + 0.5 * rng.standard_normal(light.shape)
    return WindowFrames(
        t_s, carrier, basis.reduce(blocks_of(rows[:, :, None], t_s, t_s.size)[0])
    ), psi


def test_errors_spread_as_stated_where_amplitudes_are_hard_to_tell() -> None:
    basis = ProfileBasis(80, 10.0)
    z = []
    for seed in range(25):
        frames, psi = mirrored(np.random.default_rng(seed), basis)
        fit = fit_phase(frames, psi, basis, 1.8)
        off = fit.psi_rad - psi
        off_hz = (off[NODES_PER_S:] - off[:-NODES_PER_S]) / (2.0 * np.pi)
        z.append(off_hz[::NODES_PER_S] / np.sqrt(fit.second_var_hz2[::NODES_PER_S]))
    assert 0.75 < rms(np.concatenate(z)) < 1.25

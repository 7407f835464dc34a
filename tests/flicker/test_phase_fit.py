"""The fit by sums around nodes against the one that goes through the frames."""

from __future__ import annotations

import numpy as np
import pytest

from rsenf.flicker.grid_prior import NODES_PER_S
from rsenf.flicker.phase_fit import fit_phase
from rsenf.flicker.phase_likelihood import WindowFrames
from rsenf.flicker.tone import ToneFinder
from tests.oracle.phase_by_frames import fit_by_frames

WINDOW_S, COLUMNS = 31, 9


def window(rate_hz: float, seed: int) -> tuple[WindowFrames, np.ndarray]:
    """Frames of a light that wanders, some of them lost, and its true phase at the nodes."""
    rng = np.random.default_rng(seed)
    t_s = np.arange(int(WINDOW_S * rate_hz)) / rate_hz
    t_s = t_s[rng.random(t_s.size) > 0.02]
    node_t = np.arange(WINDOW_S * NODES_PER_S + 1) / NODES_PER_S
    psi = 0.8 * np.sin(2 * np.pi * node_t / 40.0 + seed)
    carrier = 4.0 * np.pi * 50.0 * t_s
    phase = carrier + np.interp(t_s, node_t, psi)
    columns = rng.uniform(90, 110, COLUMNS) + 0.3 * rng.standard_normal((t_s.size, COLUMNS))
    for k, size in enumerate((4.0, 0.6, 0.2, 0.2), 1):
        amplitude = size * rng.standard_normal((2, COLUMNS)) / 2.0
        columns += np.outer(np.cos(k * phase), amplitude[0])
        columns += np.outer(np.sin(k * phase), amplitude[1])
    return WindowFrames(t_s, carrier, columns), psi


@pytest.mark.parametrize(("rate_hz", "seed"), [(29.97, 1), (23.976, 2), (59.94, 3)])
def test_sums_around_nodes_are_those_over_the_frames(rate_hz: float, seed: int) -> None:
    frames, psi = window(rate_hz, seed)
    fit, slow = fit_phase(frames, 0.5 * psi), fit_by_frames(frames, 0.5 * psi)
    away = fit.psi_rad - psi
    assert np.std(away) < 0.02
    np.testing.assert_allclose(fit.psi_rad, slow.psi_rad, atol=1e-7)
    for name in ("second_var_hz2", "weights", "information", "gain"):
        np.testing.assert_allclose(getattr(fit, name), getattr(slow, name), rtol=1e-4)
    np.testing.assert_allclose(fit.template, slow.template, atol=1e-6)
    np.testing.assert_allclose(fit.deviation, slow.deviation, atol=1e-5)


def test_times_may_go_back_where_a_frame_was_shown_again() -> None:
    frames, psi = window(29.97, 5)
    node = np.rint(frames.t_s * NODES_PER_S)
    (borders,) = np.nonzero(np.diff(node) > 0)
    order = np.arange(node.size)
    for at in borders[3::4]:
        order[[at, at + 1]] = order[[at + 1, at]]
    swapped = WindowFrames(frames.t_s[order], frames.carrier_rad[order], frames.columns[order])
    fit, same = fit_phase(swapped, 0.5 * psi), fit_phase(frames, 0.5 * psi)
    np.testing.assert_allclose(fit.psi_rad, same.psi_rad, atol=1e-6)
    np.testing.assert_allclose(fit.second_var_hz2, same.second_var_hz2, rtol=1e-4)


def test_every_offset_is_what_its_own_sum_is() -> None:
    rng = np.random.default_rng(4)
    t_s = np.sort(rng.uniform(-10.0, 10.0, 300))
    series = rng.standard_normal((300, 2)) + 1j * rng.standard_normal((300, 2))
    finder = ToneFinder(20.0, 1.0)
    amplitude, _ = finder.periodograms(series, np.zeros(300, complex), t_s)
    turns = np.exp(-2j * np.pi * np.outer(finder.offsets_hz, t_s))
    np.testing.assert_allclose(amplitude, (turns * finder.window(t_s)) @ series, atol=1e-12)

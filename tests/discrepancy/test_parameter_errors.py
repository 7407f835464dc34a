"""Stated errors of what was fitted, beside what they claim."""

from __future__ import annotations

import numpy as np
import pytest

from rsenf.discrepancy.jacobian import NormalEquations, System
from tests.discrepancy.foreign_camera import Case, film
from tests.discrepancy.hidden_effects import hidden
from tests.discrepancy.test_on_foreign_lamps import discovered


def test_what_is_not_taken_adds_to_the_error_as_if_it_were_drawn() -> None:
    """Drawn ten thousand times: noise, and directions that the fit leaves out."""
    rng = np.random.default_rng(8)
    design, std, draws = rng.normal(size=(50, 5)), 0.3, 10_000
    normal = NormalEquations(design.T @ design, np.zeros(5), 1)
    untaken = std * rng.normal(size=(draws, 2))
    data = untaken @ design[:, 3:].T + rng.normal(size=(draws, 50))
    found = data @ design[:, :3] @ np.linalg.inv(design[:, :3].T @ design[:, :3])
    stated = normal.considering(2, std)
    assert np.allclose(stated, np.cov(found.T), rtol=0.1, atol=0.05 * np.diag(stated).max())
    assert np.all(np.diag(stated) > np.diag(np.linalg.inv(design[:, :3].T @ design[:, :3])))


def test_clusters_that_disagree_add_to_the_error_as_they_do() -> None:
    """Drawn four hundred times: an effect that has another size in each of twenty clusters."""
    rng = np.random.default_rng(9)
    clusters, draws = 20, 400
    design = rng.normal(size=(clusters, 30, 3))
    flat = design.reshape(-1, 3)
    normal = NormalEquations(flat.T @ flat, np.zeros(3), 1)
    found, stated = [], []
    for _ in range(draws):
        sizes = np.array([0.0, 0.0, 0.2]) * rng.normal(size=(clusters, 1, 3))
        data = (design * sizes).sum(axis=2) + rng.normal(size=(clusters, 30))
        step = np.linalg.solve(normal.matrix, flat.T @ data.ravel())
        left = data - design @ step
        found.append(step)
        stated.append(np.diag(normal.sandwich((design * left[:, :, None]).sum(axis=1))))
    assert np.mean(stated, axis=0) == pytest.approx(np.var(found, axis=0), rel=0.2)
    white = np.diag(np.linalg.inv(normal.matrix))
    assert np.mean(stated, axis=0)[2] > 1.5 * white[2]


def test_scores_add_up_to_the_normal_equations() -> None:
    rng = np.random.default_rng(10)
    frames, lines, strips = 40, 12, 2
    lit, turn, other, left = rng.normal(size=(4, frames, lines, strips)).astype(np.float32)
    basis = rng.normal(size=(frames, 5))
    system = System(lit, turn, basis, lambda a: a).plus([other])
    by_frame, by_value = system.scores(left)
    assert by_frame.sum(axis=0) == pytest.approx(system.normal(left).vector, rel=1e-4, abs=1e-3)
    assert by_value.sum(axis=0) == pytest.approx(system.normal(left).vector, rel=1e-4, abs=1e-3)


def test_what_remains_unexplained_widens_the_errors_of_what_was_found() -> None:
    """A swing under a lamp with a rest: its frequency would be told fifty errors off."""
    made = film(Case(hidden=("interharmonic",), seed=61001))
    (found,) = (e for e in discovered(made)["effects"] if e["name"] == "interharmonic")
    off_hz = found["parameters"]["flicker_hz"] - made.hidden["interharmonic"]["flicker_hz"]
    assert abs(off_hz) < 4.0 * found["stderr"]["flicker_hz"]


def test_a_lamp_beside_the_camera_is_as_heavy_as_its_error_says() -> None:
    """Darker ends of the picture make it seem weaker, which rows can't tell."""
    for seed in (21, 22, 23):
        last = hidden("second_lamp", seed=seed, strips=2, weight=0.06).discover().last
        (lamp,) = last.forward.model.effects
        errors = {(k.name, k.across): e for k, e in zip(last.parameters, last.stderr, strict=True)}
        stderr = errors["weight", False]
        assert abs(lamp.weight - 0.06) < 2.0 * stderr  # type: ignore[attr-defined]
        assert stderr < 0.05 * 0.06
        assert np.allclose(last.forward.lean.mean(axis=0), 0.0, atol=1e-9)


def test_a_weak_swing_is_as_fast_as_its_error_says() -> None:
    """An iris that hunts by 0.2 %: its rate would be that of the spectrum's peak, without error."""
    made = film(Case(hidden=("iris_hunting",), seed=78022, times=6.0, duration_s=16.0, rows=64))
    (found,) = (e for e in discovered(made)["effects"] if "interharmonic" in e["class"])
    off_hz = found["parameters"]["flicker_hz"] - made.hidden["iris_hunting"]["hz"]
    assert abs(off_hz) < 3.0 * found["stderr"]["flicker_hz"] < 0.005

"""Stated errors of what was fitted, beside what they claim."""

from __future__ import annotations

import numpy as np

from rsenf.discrepancy.linear import Normal
from tests.discrepancy.hidden_effects import hidden


def test_what_is_not_taken_adds_to_the_error_as_if_it_were_drawn() -> None:
    """Drawn ten thousand times: noise, and directions that the fit leaves out."""
    rng = np.random.default_rng(8)
    design, std, draws = rng.normal(size=(50, 5)), 0.3, 10_000
    normal = Normal(design.T @ design, np.zeros(5), 1)
    untaken = std * rng.normal(size=(draws, 2))
    data = untaken @ design[:, 3:].T + rng.normal(size=(draws, 50))
    found = data @ design[:, :3] @ np.linalg.inv(design[:, :3].T @ design[:, :3])
    stated = normal.considering(2, std)
    assert np.allclose(stated, np.cov(found.T), rtol=0.1, atol=0.05 * np.diag(stated).max())
    assert np.all(np.diag(stated) > np.diag(np.linalg.inv(design[:, :3].T @ design[:, :3])))


def test_a_lamp_beside_the_camera_is_as_heavy_as_its_error_says() -> None:
    """Darker ends of the picture make it seem weaker, which rows can't tell."""
    for seed in (21, 22, 23):
        last = hidden("second_lamp", seed=seed, strips=2, weight=0.06).discover().last
        (lamp,) = last.theory.model.effects
        errors = {(k.name, k.across): e for k, e in zip(last.knobs, last.stderr, strict=True)}
        stderr = errors["weight", False]
        assert abs(lamp.weight - 0.06) < 2.0 * stderr  # type: ignore[attr-defined]
        assert stderr < 0.05 * 0.06
        assert np.allclose(last.theory.lean.mean(axis=0), 0.0, atol=1e-9)

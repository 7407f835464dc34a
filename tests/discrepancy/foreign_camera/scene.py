"""What stands before the camera: walls, in strips of columns, partly smooth, partly rough."""

from __future__ import annotations

import numpy as np

from .light import Array

BRIGHTEST = 205.0


def draw_wall(rng: np.random.Generator, rows: int, strips: int) -> Array:
    """Level that each row of each strip has in steady light, (rows, strips).

    Strips are different walls; the lens darkens rows away from its axis. The brightest row stays
    well under what the sensor holds.
    """
    place = np.linspace(-1.0, 1.0, rows)[:, None]
    wall = rng.uniform(55.0, 140.0) * np.exp(rng.uniform(-0.25, 0.25, strips)) * np.ones((rows, 1))
    for _ in range(6):
        waves, size = rng.uniform(0.3, 6.0, strips), rng.uniform(0.0, 0.12, strips)
        wall *= 1 + size * np.sin(np.pi * waves * place + rng.uniform(0, 2 * np.pi, strips))
    for _ in range(5):  # edges of furniture, some sharp
        at, sharp = rng.uniform(-1.0, 1.0, strips), np.exp(rng.uniform(np.log(5), np.log(300)))
        wall *= 1 + rng.uniform(-0.12, 0.12, strips) * np.tanh(sharp * (place - at))
    rough = rng.standard_normal((rows, strips)) * rng.uniform(0.005, 0.04, strips)
    wall *= 1 + rough * (np.sin(np.pi * rng.uniform(1, 3) * place + rng.uniform(0, 6)) > -0.2)
    wall *= np.cos(np.arctan(rng.uniform(0.1, 0.5) * (place - rng.uniform(-0.2, 0.2)))) ** 4
    return np.asarray(wall * min(1.0, 0.75 * BRIGHTEST / float(wall.max())))

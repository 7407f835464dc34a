"""The model that was written, given back to the simulator: what it makes must lack nothing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import yaml

from rsenf.config.model_file import load_model
from rsenf.discrepancy.measured import measured_of
from rsenf.discrepancy.result import model_of
from rsenf.discrepancy.verdict import Discovery, discover
from rsenf.messages import Header
from rsenf.model import GridPath, simulate_rows
from rsenf.rows.luminance import blocks_from_luminance

OTHER = 10**6  # between the seed of a case and that of what its model makes


def given_back(found: Discovery, grid: GridPath, duration_s: float, seed: int, folder: Path) -> str:
    """Write a model, read it, simulate with it, and return the verdict on what comes out.

    Parameters
    ----------
    found : Discovery
    grid : GridPath
        That the simulation films.
    duration_s : float
    seed : int
        Of the case.
    folder : path
        For the file.
    """
    path = folder / "model.yaml"
    path.write_text(yaml.safe_dump(model_of(found, "a case").to_dict(), sort_keys=False))
    model = load_model(path)
    rows = simulate_rows(model, grid, duration_s, seed + OTHER, strips=found.last.data.strips)
    blocks = blocks_from_luminance(np.asarray(rows.level), rows.frame_time_s, Header())
    return discover(model, measured_of(list(blocks))).verdict

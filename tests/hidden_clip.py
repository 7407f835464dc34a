"""A clip hidden in a grid reference, small enough to be made for every test session."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np


@dataclass(frozen=True)
class HiddenClip:
    """Rows of a simulated clip, and the grid reference that it is hidden in."""

    clip: Path
    reference: Path
    lag_s: float
    start_utc: str


def hide_clip(folder: Path) -> HiddenClip:
    """Two minutes of rows, at 2345.4 s of a two-hour grid that wanders as real ones do."""
    rng, freq_hz, away_hz = np.random.default_rng(5), [], 0.0
    for shock_hz in rng.normal(0.0, 0.002, 7200):
        away_hz = 0.995 * away_hz + shock_hz
        freq_hz.append(50.0 + away_hz)
    begin = np.datetime64("2024-03-01T10:00:00")
    lines = [f"{begin + k}Z,{f:.6f}" for k, f in enumerate(freq_hz)]
    reference = folder / "grid.csv"
    reference.write_text("time,frequency\n" + "\n".join(lines) + "\n")
    clip = folder / "clip.npz"
    words = ["simulate", "--out", clip, "--reference", reference, "--start-s", "2345.4",
             "--duration-s", "120", "--size", "64x120", "--seed", "3"]  # fmt: skip
    subprocess.run([sys.executable, "-m", "rsenf.cli", *map(str, words)], check=True)
    return HiddenClip(clip, reference, 2345.4, "2024-03-01T10:39:05.400Z")

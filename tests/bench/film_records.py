"""A film kept without filming: its rows are simulated, without pixels."""

from __future__ import annotations

from pathlib import Path

from rsenf.bench.recording_time import NOMINAL_HZ, Film
from rsenf.bench.recording_time.films import VERSION, keep_film, lit_day, setting_of
from rsenf.messages import Header
from rsenf.model import GridPath, simulate_rows
from rsenf.rows.stage import blocks_from_luminance

START_S = 1234.5


def keep_simulated(wanted: Film, folder: Path) -> None:
    """Keep a film with simulated rows, the same for every coding; it begins at START_S."""
    setting, day = setting_of(wanted), lit_day(None)
    grid = GridPath(day.freq_hz, day.step_s, START_S, NOMINAL_HZ)
    rows = simulate_rows(setting.model, grid, wanted.duration_s, setting.seed, strips=2)
    blocks = list(blocks_from_luminance(rows.level, rows.frame_time_s, Header()))
    told = {
        "version": VERSION,
        "grid": day.grid,
        "flicker_level": 10.0,
        "truth": rows.truth,
        "versions": {"source": "test"},
    }
    keep_film(wanted, folder, told, dict.fromkeys(wanted.codings, blocks))

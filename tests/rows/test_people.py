"""Who crosses the view is left out where and while they move, and the picture isn't given up."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rsenf.api.recordings import read_recording
from rsenf.messages import Frame, Header
from rsenf.rows.settings import AUTO, RowsSettings
from rsenf.rows.stage import Rows
from tests.flicker.claims import claims
from tests.rows.people import film, told


def test_flicker_is_found_behind_somebody_who_fills_most_of_the_picture(tmp_path: Path) -> None:
    plan = film(2, "leans", path := tmp_path / "film.mp4")
    usable, enf_mhz, z, idle_percent, idle_z = told(
        plan, claims(read_recording(path, rows=RowsSettings(read_out_axis=AUTO)))
    )
    assert usable > 0.9
    assert enf_mhz < 1.0
    assert idle_percent < 0.2
    assert max(z, idle_z) < 2.5


@pytest.mark.parametrize("comes", [True, False])
def test_what_comes_and_stays_leaves_no_step(*, comes: bool) -> None:
    """A bright box that stands there from some frame on, or up to it; flicker goes on behind."""
    rng = np.random.default_rng(3)
    wall = rng.uniform(60, 140, (128, 256))
    box = wall.copy()
    box[20:90, 60:150] = 200.0
    stage, row = Rows(RowsSettings()), np.arange(128)[:, None] / 128
    level, kept = [], []
    for n in range(160):
        turns = 100 / 29.97 * n + 2.1 * row
        seen = (box if (n >= 68) == comes else wall) * (1.0 + 0.05 * np.cos(2 * np.pi * turns))
        luma = np.rint(seen + rng.normal(0, 1.0, seen.shape)).astype(np.uint8)
        header = Header(frame_first=n, frame_last=n, pts_ns=round(n * 1e9 / 29.97))
        for block in stage.update(Frame(header=header, luma=luma)):
            level.append(block.level)
            kept.append(block.steady_ratio)
    rows = np.concatenate(level).mean(axis=2)
    assert min(kept[8:10]) < 0.8  # it is seen
    assert kept[:8] + kept[12:] == [1.0] * 16  # and all is of use before and after
    # The flicker turns by 1.0 in three frames, nearly: none of it is in the mean of 33.
    before, after = rows[30:63].mean(axis=0), rows[72:105].mean(axis=0)
    without = (box - wall).mean(axis=1) * (1 if comes else -1)
    assert np.abs(without).max() > 25.0
    assert np.abs(after - before).max() < 0.3 * np.abs(without).max()
    across = np.diff(rows[56:96], axis=0)
    assert np.abs(across).max() < 1.5 * np.abs(np.diff(rows[:56], axis=0)).max()

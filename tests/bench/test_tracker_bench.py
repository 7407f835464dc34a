"""What an hour costs: the light is flicker, and costs are told as they were."""

from __future__ import annotations

import itertools
import json
from pathlib import Path

import numpy as np
import pytest

from rsenf.bench.tracker import Planes, _measured, _planes, _tabulated, _text, _trials
from rsenf.bench.tracker.beside import BLOCK_FRAMES, Hour, LampRows, _cycles, _reference
from rsenf.track import METHODS, TrackSettings, make_tracker


def test_the_light_is_followed_at_the_grids_frequency() -> None:
    light, tracker = LampRows(90, 29.97, 3), make_tracker(TrackSettings())
    # Blocks go on from call to call as if there had been one.
    blocks = [*light.blocks(0.0, 20.0), *light.blocks(20.0, 20.0)]
    numbers = np.concatenate([b.frame_number for b in blocks])
    assert numbers.tolist() == list(range(len(blocks) * BLOCK_FRAMES))
    found = [e for b in blocks for e in tracker.update(b)]
    true_hz = _reference(60).freq_hz
    assert len(found) > 15
    assert max(abs(e.enf_hz - true_hz[e.header.seq]) for e in found) < 1e-3
    assert _cycles(np.array([0.0, 1.0])).tolist() == [0.0, pytest.approx(true_hz[0])]


def test_an_hours_cost_is_that_of_its_parts(tmp_path: Path) -> None:
    record = _measured(Hour("frame_mean", 32, 25.0, 2, 2.0), 0, tmp_path)
    assert record["hours"] == pytest.approx(4 / 3600)
    assert len(record["cpu_s_per_hour"]) == 2
    row = _tabulated([record | {"cpu_s_per_hour": [30.0, 90.0, 36.0]}])["rows"][0]
    assert row["cpu_s_per_hour"] == 36.0
    assert row["ms_per_frame"] == pytest.approx(0.4)


def test_planes_have_padded_lines_and_a_box_crosses_some() -> None:
    still, moving = (_planes(480, 854, 0, box=box) for box in (False, True))
    assert still[0].shape == (480, 854)
    assert still[0].strides == (896, 1)
    assert not any((a == 210).any() for a in still[:4])
    assert all((a == 210).any() for a in moving)
    record = _measured(Planes("480p", 1, 1), 0, Path())
    assert set(record["us"][0]) == {"copy", "read", "means", "still", "moving"}
    assert all(us > 0 for us in record["us"][0].values())


def test_ratios_are_those_of_each_round() -> None:
    rounds = [
        {"copy": c, "read": 1.0, "means": m, "still": 2.0, "moving": 3.0}
        for c, m in ((1, 1), (4, 2), (9, 3))
    ]
    part = {"decode": 100.0, "rows": 3.0, "track": 1.0, "idle": 0.5, "match": 0.25, "live": 0.25}
    common = {"load": 1.0, "rsenf": "x"}
    document = _tabulated(
        [
            common | {"kind": "planes", "size": "480p", "us": rounds},
            common | {"kind": "beside", "ms_per_s": [part, part | {"decode": 50.0}, part]},
        ]
    )
    assert document["planes"][0]["means_over_copy"] == 0.5
    assert document["planes"][0]["means_us"] == 2
    after = next(row for row in document["beside"] if row["stage"] == "after")
    assert (after["ms_per_s"], after["over_decode"]) == (2.0, 0.02)
    assert "2.00%" in _text(document)
    assert "| 480p |" in _text(document, on_page=True)


def test_every_method_is_measured_and_no_two_trials_are_one() -> None:
    every = _trials(5, 30.0, quick=False)
    assert len({t.key for t in every}) == len(every)
    assert {t.method for t in every if isinstance(t, Hour)} == set(METHODS)
    rates = {t.frame_rate_hz for t in every if isinstance(t, Hour)}
    assert all(b > a for a, b in itertools.pairwise(sorted(rates)))
    assert json.dumps([t.key for t in _trials(1, 1.0, quick=True)])

"""Films on the disk: the same rows again, bit for bit; whole or not at all."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from rsenf.bench.measure import film
from rsenf.bench.recording_time import Film, films
from rsenf.bench.recording_time.films import (
    has_film,
    lit_day,
    make_film,
    make_missing,
    read_rows,
    read_truth,
    setting_of,
)
from rsenf.bench.recording_time.trials import Cuts, run_trials
from rsenf.errors import InputError, RecordingError
from rsenf.messages.codec import digest
from rsenf.model import GridPath

MOVING = Film("moving", 3, "led", 5, "240p", 1.5, 3600.0, ("lossless", "50k"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("films")
    make_film(MOVING, made, None)
    return made


def test_rows_come_back_bit_for_bit(folder: Path) -> None:
    truth = read_truth(folder, MOVING)["truth"]
    grid = GridPath(lit_day(None).freq_hz, 1.0, truth["reference_start_s"], 50.0)
    again = film(setting_of(MOVING), grid, MOVING.duration_s, MOVING.codings)
    assert again.truth == truth
    for coding, blocks in again.blocks.items():
        assert digest(read_rows(folder, MOVING, coding)) == digest(blocks)
    first, second = (digest(read_rows(folder, MOVING, coding)) for coding in MOVING.codings)
    assert first != second


def test_the_truth_says_where_and_by_what(folder: Path) -> None:
    told = read_truth(folder, MOVING)
    assert told["film"]["seed"] == MOVING.seed
    assert 0 <= told["truth"]["reference_start_s"] < MOVING.reference_s - MOVING.duration_s
    assert told["versions"]["source"]


def test_a_film_that_is_there_is_not_made_again(folder: Path) -> None:
    before = (folder / MOVING.key / "truth.json").stat().st_mtime_ns
    said = []
    make_missing([MOVING], folder, None, 1, lambda done, missing: said.append((done, missing)))
    assert said == [(0, 0)]
    assert (folder / MOVING.key / "truth.json").stat().st_mtime_ns == before


def test_nothing_half_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "no space left")

    monkeypatch.setattr(films, "_write", full)
    with pytest.raises(RecordingError, match="no space left"):
        make_film(MOVING, tmp_path, None)
    assert not has_film(tmp_path, MOVING)
    assert list(tmp_path.iterdir()) == []


def test_a_truth_of_another_version_is_refused(tmp_path: Path) -> None:
    (tmp_path / MOVING.key).mkdir()
    path = tmp_path / MOVING.key / "truth.json"
    for text in ("", "[", json.dumps({"version": 0})):
        path.write_text(text)
        with pytest.raises(InputError, match=r"truth\.json"):
            read_truth(tmp_path, MOVING)


def test_a_film_of_another_grid_is_not_searched(folder: Path, measured_data: Path) -> None:
    """Nothing would find it."""
    cuts = Cuts(MOVING, "lossless", 1.0, ("phase",), 0.0)
    with pytest.raises(InputError, match="filmed on the grid synthetic"):
        run_trials(cuts, folder, measured_data)

"""Effects that no catalogue has: described by the grammar, written as a file, and run from it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rsenf.bench.discover.judge import judged_description
from rsenf.discrepancy.grammar import PLACES, Term, effect_of, source_of, term_of, words_of
from rsenf.discrepancy.measured import Measured, measured_of
from rsenf.discrepancy.result import discovery_json, files_of, model_of, sha256_of
from rsenf.discrepancy.start import PLAIN
from rsenf.discrepancy.verdict import Discovery, discover
from rsenf.messages import Header
from rsenf.model import CATALOGUE, CaptureModel, GridPath, load_effects, simulate_rows
from rsenf.rows.stage import blocks_from_luminance
from tests.discrepancy.foreign_camera import Case, Filmed, film

DURATION_S = 20.0
TONE = {"tone_hz": 2.0, "phases_rad": (0.0,)}


def measured(level: np.ndarray, stamp_s: np.ndarray) -> Measured:
    return measured_of(list(blocks_from_luminance(level, stamp_s, Header())))


@pytest.fixture(scope="module")
def hunting() -> tuple[Filmed, Discovery]:
    """A driver's ripple hunts, before a foreign camera."""
    case = Case(
        hidden=("dimmer_hunting",), seed=1, duration_s=DURATION_S, rows=64, lamp="tone",
        rate="30000/1001", nominal_hz=50.0,
    )  # fmt: skip
    filmed = film(case)
    data = measured(filmed.level, filmed.stamp_s)
    return filmed, discover(PLAIN, data, beyond_catalogue=True)


def test_what_nobody_wrote_down_is_described(hunting: tuple[Filmed, Discovery]) -> None:
    filmed, found = hunting
    told, truth = discovery_json(found, ""), filmed.hidden["dimmer_hunting"]
    assert found.verdict == "explained"
    assert judged_description(truth, told, ())["outcome"] == "right"
    (effect,) = told["effects"]
    assert effect["parameters"]["tone_hz"] == pytest.approx(truth["hz"], rel=1e-3)
    assert effect["size"] == pytest.approx(truth["size_ratio"], rel=0.05)
    assert f"periodic at {truth['hz']:.2f}" in effect["words"]


@pytest.fixture
def own_catalogue(monkeypatch: pytest.MonkeyPatch) -> None:
    """Effects that a test registers are gone after it."""
    monkeypatch.setattr(CATALOGUE, "_items", dict(CATALOGUE._items))


@pytest.mark.usefixtures("own_catalogue")
def test_the_file_it_writes_films_it_again(
    hunting: tuple[Filmed, Discovery], tmp_path: Path
) -> None:
    _, found = hunting
    files = files_of(found, 'a "clip"""\nimport os')
    ((name, text),) = files.items()
    assert discovery_json(found, "", files)["files"] == {name: sha256_of(text)}
    (tmp_path / name).write_text(text, encoding="utf-8")
    (effect,) = load_effects(tmp_path / name)
    assert "\nimport os" not in text
    assert term_of(effect()) is None  # an effect like any other
    model = CaptureModel.from_dict(model_of(found, "a clip").to_dict())
    assert model.effects == (effect(),)  # its defaults are what was found
    grid = found.last.theory.course.grid()
    again = simulate_rows(model, grid, DURATION_S - 1.0, seed=9, strips=2)
    rest = discover(model, measured(again.level, again.frame_time_s))
    assert rest.verdict == "no_discrepancy"


def test_what_the_grammar_has_no_words_for_stays_unexplained() -> None:
    case = Case(
        hidden=("missing_cycle",), seed=15, duration_s=DURATION_S, rows=64, lamp="tone",
        rate="30000/1001", nominal_hz=50.0,
    )  # fmt: skip
    filmed = film(case)
    found = discover(PLAIN, measured(filmed.level, filmed.stamp_s), beyond_catalogue=True)
    assert found.verdict == "unexplained"
    assert not [e for e in found.last.theory.model.effects if term_of(e)]
    assert files_of(found, "a clip") == {}


def drawn(term: Term) -> dict[str, Any]:
    """Some parameters of a term that do something."""
    place = PLACES[term.place]
    if term.rows == "own":
        return {"tone_hz": 2.0, "row_ratios": tuple(np.linspace(0.01, 0.02, 16).tolist())}
    if term.course == "tone":
        size = place.size.replace("depth_ratio", "depth_ratios").replace("delay_s", "delays_s")
        return {**TONE, size: (10 * place.step,)}
    return {place.size: 10 * place.step} | ({"at_s": 0.5} if term.course == "step" else {})


TERMS = [
    *(Term(place, "tone") for place in PLACES),
    *(Term(place, "tone", rows) for place in ("gain", "light") for rows in ("ramp", "band")),
    Term("gain", "tone", "own"),
    *(Term("flicker", course) for course in ("step", "drift", "settling")),
    Term("gain", "passing"),
]


@pytest.mark.usefixtures("own_catalogue")
@pytest.mark.parametrize("term", TERMS, ids=lambda term: term.name)
def test_every_term_is_a_file_that_does_what_its_class_does(term: Term, tmp_path: Path) -> None:
    effect = effect_of(term, **drawn(term))
    path = tmp_path / "effect.py"
    path.write_text(source_of(effect, {}, "a clip", (), 25.0), encoding="utf-8")
    (written,) = load_effects(path)
    words = words_of(effect, 25.0)
    assert words[0].upper() + words[1:] in path.read_text(encoding="utf-8")
    plain = PLAIN.changed(size=(32, 16), frame_rate=25)
    grid = GridPath([50.0, 50.1, 50.0, 50.0])
    rows = [
        simulate_rows(model, grid, 2.0, seed=1, noise=False).level
        for model in (plain, plain.plus(effect), plain.plus(written()))
    ]
    assert np.abs(rows[1] - rows[0]).max() > 1e-3
    np.testing.assert_array_equal(rows[1], rows[2])

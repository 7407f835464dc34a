"""Effects that no catalogue has: described by the grammar, written as a file, and run from it."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rsenf.bench.discover.judge import judged_description
from rsenf.discrepancy import grammar_search, verdict
from rsenf.discrepancy.candidates import NOTHING
from rsenf.discrepancy.effect_file import effect_of, source_of
from rsenf.discrepancy.fit import NoiseFloor
from rsenf.discrepancy.fit_parameters import any_course
from rsenf.discrepancy.forward_selection import FALSE_ALARMS
from rsenf.discrepancy.grammar import PLACES, Term, sizes_name, term_of, words_of
from rsenf.discrepancy.grammar_search import (
    BY_CHANCE,
    SKIRT_BINS,
    ShortestStep,
    _guesses,
    _is_at_limit,
    _length,
    _tones,
)
from rsenf.discrepancy.measured import Measured, measured_of
from rsenf.discrepancy.result import discovery_json, files_of, model_of, sha256_of
from rsenf.discrepancy.start import PLAIN, first_fit
from rsenf.discrepancy.trial import Trial
from rsenf.discrepancy.verdict import Discovery, discover, is_doubtful, shares_a_rate
from rsenf.messages import Header
from rsenf.model import (
    CATALOGUE,
    CaptureModel,
    Effect,
    GridPath,
    Shutter,
    load_effects,
    simulate_rows,
    synthetic_grid,
)
from rsenf.model.effects.sensor import AutoExposure
from rsenf.model.shutter import ReadOut
from rsenf.rows.stage import blocks_from_luminance
from tests.discrepancy.foreign_camera import Case, Filmed, film

DURATION_S = 20.0


def hiding(effect: str, seed: int) -> Case:
    """A clip of the foreign camera that hides one of its effects."""
    return Case(
        hidden=(effect,), seed=seed, duration_s=DURATION_S, rows=64, lamp="tone",
        rate="30000/1001", nominal_hz=50.0,
    )  # fmt: skip


TONE = {"tone_hz": 2.0, "phases_rad": (0.0,)}


def measured(level: np.ndarray, stamp_s: np.ndarray) -> Measured:
    return measured_of(list(blocks_from_luminance(level, stamp_s, Header())))


@pytest.fixture(scope="module")
def hunting() -> tuple[Filmed, Discovery]:
    """A driver's ripple hunts, before a foreign camera."""
    case = hiding("dimmer_hunting", 1)
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


def test_the_limit_counts_every_guess(hunting: tuple[Filmed, Discovery]) -> None:
    (step,) = hunting[1].steps
    guesses = list(_guesses(step.before.restored()))
    assert step.scored > len(guesses) > len(step.trials)
    assert step.limit == pytest.approx(np.log(step.scored / FALSE_ALARMS))


def test_a_value_for_each_row_is_dear_before_it_is_fitted(
    hunting: tuple[Filmed, Discovery],
) -> None:
    first = hunting[1].first
    own, lines = Term("gain", "tone", "own"), first.data.lines
    fitted = _length(effect_of(own, tone_hz=2.0, row_ratios=(0.1,) * lines), first)
    assert _length(effect_of(own, tone_hz=2.0), first) == pytest.approx(fitted)
    assert fitted > lines / 5 * _length(effect_of(Term("gain", "tone"), **TONE), first)


def test_a_tone_found_in_two_ways_is_guessed_once() -> None:
    case = hiding("fan_shadow", 3)
    filmed = film(case)
    fit = first_fit(PLAIN, measured(filmed.level, filmed.stamp_s))
    tones_hz = [e.tone_hz for e in _guesses(fit) if e.name == "light_tone"]  # type: ignore[attr-defined]
    assert min(tones_hz) == pytest.approx(filmed.hidden["fan_shadow"]["hz"], rel=0.01)
    assert np.diff(sorted(tones_hz)).min() > SKIRT_BINS / DURATION_S


def test_noise_alone_has_no_tone(hunting: tuple[Filmed, Discovery]) -> None:
    first, rng = hunting[1].first, np.random.default_rng(1)
    found = [
        _tones(dataclasses.replace(first, residual=noise), first.flicker)
        for noise in rng.standard_normal((200, *first.residual.shape), np.float32)
    ]
    assert sum(map(bool, found)) <= 200 * 2 * BY_CHANCE


FAST = CATALOGUE["interharmonic"](flicker_hz=300.0, depth_ratio=0.01)  # type: ignore[call-arg]
GAIN, LIGHT, RAMP = (effect_of(term, **TONE) for term in (
    Term("gain", "tone"), Term("light", "tone"), Term("gain", "tone", "ramp")
))  # fmt: skip


@pytest.mark.parametrize(
    ("effects", "kin"),
    [
        ((FAST,), ("interharmonic", "pwm_tone")),  # the same in all data
        ((GAIN, LIGHT), ("gain_tone", "light_tone")),
        ((RAMP, GAIN), ("gain_tone",)),  # a ramp only has more freedom
        ((RAMP, LIGHT), ("light_tone", "gain_tone_ramp")),
    ],
)
def test_what_does_as_well_is_a_class(
    effects: tuple[Effect, ...], kin: tuple[str, ...], hunting: tuple[Filmed, Discovery]
) -> None:
    first = hunting[1].first
    trials = tuple(Trial(effect, first, gain=1.0, nats=1e4, worst=1.0) for effect in effects)
    assert ShortestStep(first, trials, 1, 1.0, NoiseFloor(0.0, 0.0, 0.0)).equivalents == kin


def test_what_a_codec_alone_may_do_is_no_new_effect() -> None:
    """Its beats are 1.85 times those that it makes of the model's rows; encoders differ as much."""
    clip = PLAIN.changed(size=(64, 64), frame_rate=29.97, lamp="tone")
    made = simulate_rows(clip, synthetic_grid(5, 40.0), DURATION_S, seed=5, strips=2)

    def coded(level: np.ndarray, depth: float = 0.02) -> np.ndarray:
        beat = depth * np.cos(2 * np.pi * 1.7 * np.arange(len(level)) / 29.97)[:, None, None]
        return np.asarray(level + beat * (level - level.mean(axis=0)), np.float32)

    data = measured(coded(made.level, 1.85 * 0.02), made.frame_time_s)
    found = discover(clip, data, recoded=coded, beyond_catalogue=True)
    assert found.verdict == "unexplained"
    assert found.steps == ()


@pytest.mark.parametrize(
    ("other", "shared"),
    [
        (CATALOGUE["gop_attenuation"](period_frames=15), True),  # type: ignore[call-arg]
        (CATALOGUE["gop_attenuation"](period_frames=14), False),  # type: ignore[call-arg]
        (CATALOGUE["interharmonic"](flicker_hz=30000 / 1001 - 2.0), True),  # type: ignore[call-arg]
        (CATALOGUE["gamma"](), False),
        (LIGHT, True),
    ],
)
def test_one_rate_at_two_places_is_no_explanation(
    other: Effect, shared: bool, hunting: tuple[Filmed, Discovery]
) -> None:
    first = hunting[1].first
    theory = first.forward.with_model(first.forward.model.plus(GAIN).plus(other))
    assert shares_a_rate(dataclasses.replace(first, forward=theory)) is shared
    assert not shares_a_rate(hunting[1].last)


def test_no_overtone_is_beyond_what_frames_show() -> None:
    grid, clip = GridPath([50.0, 50.1, 50.0, 50.0]), PLAIN.changed(size=(32, 16), frame_rate=25)
    one, more = (
        effect_of(Term("gain", "tone"), tone_hz=7.0, depth_ratios=sizes, phases_rad=sizes)
        for sizes in ((0.1,), (0.1, 0.2, 0.3, 0.4))
    )
    rows = [simulate_rows(clip.plus(e), grid, 2.0, seed=1, noise=False).level for e in (one, more)]
    np.testing.assert_array_equal(*rows)


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
    assert effect.confused_with == tuple(n for n in found.steps[0].equivalents if n != effect.name)
    model = CaptureModel.from_dict(model_of(found, "a clip").to_dict())
    assert model.effects == (effect(),)  # its defaults are what was found
    grid = found.last.forward.course.grid()
    again = simulate_rows(model, grid, DURATION_S - 1.0, seed=9, strips=2)
    rest = discover(model, measured(again.level, again.frame_time_s))
    assert rest.verdict == "no_discrepancy"


def test_what_the_grammar_has_no_words_for_stays_unexplained() -> None:
    case = hiding("shadow_edge", 15)
    filmed = film(case)
    found = discover(PLAIN, measured(filmed.level, filmed.stamp_s), beyond_catalogue=True)
    assert found.verdict == "unexplained"
    assert not [e for e in found.last.forward.model.effects if term_of(e)]
    assert files_of(found, "a clip") == {}


@pytest.mark.parametrize("program", ["missing_cycle", "phone_vibrating"])
def test_short_events_and_a_shaken_picture_are_described(program: str) -> None:
    filmed = film(hiding(program, 15))
    found = discover(PLAIN, measured(filmed.level, filmed.stamp_s), beyond_catalogue=True)
    told = discovery_json(found, "")
    assert found.verdict == "explained"
    assert judged_description(filmed.hidden[program], told, ())["outcome"] == "right"


def test_the_rows_of_a_fast_light_are_found_where_it_turns_within_a_frame() -> None:
    """A wall of LEDs at 139 Hz in rows 0.2 to 0.7; by whole frames it changes its sign there."""
    held = {"top_ratio": 0.2, "bottom_ratio": 0.7, "tone_hz": 139.0, "phases_rad": (0.0,)}
    wall = effect_of(Term("added_light", "tone", "band"), depth_ratios=(0.01,), **held)
    shutter = Shutter(rows=64, columns=64)
    model = CaptureModel(shutter=shutter, effects=(wall,))
    clip = simulate_rows(model, synthetic_grid(5, DURATION_S + 2.0), DURATION_S, seed=5)
    fit = first_fit(PLAIN, measured(clip.level, clip.frame_time_s))
    bands = [e for e in _guesses(fit) if e.name == "added_light_tone_band"]
    ends = [(e.top_ratio, e.bottom_ratio) for e in bands]  # type: ignore[attr-defined]
    assert any(pair == pytest.approx((0.2, 0.7), abs=0.1) for pair in ends)


def test_the_rate_of_a_screen_in_view_is_known_up_to_whole_frame_rates() -> None:
    def words(rows: str) -> str:
        return words_of(effect_of(Term("added_light", "tone", rows), tone_hz=2.0), 25.0)

    assert "or whole frame rates from it" in words("band")
    assert "or whole frame rates from it" in words("own")
    assert "or whole frame rates from it" not in words("all")


def test_a_number_at_its_limit_stands_for_something_else() -> None:
    """A band that is wider than the picture is any slow course, such as a black level's drift."""
    term = Term("gain", "passing")
    assert _is_at_limit(effect_of(term, width_ratio=0.6))
    assert not _is_at_limit(effect_of(term, width_ratio=0.3))


def test_a_shift_is_over_the_height() -> None:
    """A model of averaged lines shifts as one of all rows does."""
    shaken = effect_of(Term("picture", "tone"), shift_ratios=(0.01,), **TONE)
    run: Any = None  # which this term doesn't need
    for lines in (64, 720):
        taken = ReadOut.of(Shutter(rows=lines, columns=64), np.arange(30), np.arange(30) / 30)
        shaken.apply(taken, run)  # type: ignore[attr-defined]
        assert np.abs(taken.shift_px).max() == pytest.approx(0.01 * lines, rel=0.01)


def drawn(term: Term) -> dict[str, Any]:
    """Some parameters of a term that do something."""
    place = PLACES[term.place]
    if term.rows == "own":
        return {"tone_hz": 2.0, "row_ratios": tuple(np.linspace(0.01, 0.02, 16).tolist())}
    if term.course == "tone":
        return {**TONE, sizes_name(term): (10 * place.step,)}
    if term.course == "events":
        return {"at_s": (0.5,), place.size: 0.1}
    return {place.size: 10 * place.step} | ({"at_s": 0.5} if term.course == "step" else {})


TERMS = [
    *(Term(place, "tone") for place in PLACES),
    *(Term(place, "tone", rows) for place in ("gain", "light") for rows in ("ramp", "band")),
    Term("gain", "tone", "own"),
    *(Term("flicker", course) for course in ("step", "drift", "settling")),
    Term("gain", "passing"),
    Term("light", "events"),
]


def test_a_user_s_free_course_may_stand_for_a_term() -> None:
    class OwnCourse(AutoExposure):
        """A gain of one's own."""

        name = "own_course"

    assert any_course(OwnCourse)
    assert not any_course(CATALOGUE["gamma"])
    assert not any_course(CATALOGUE["readout_drift"]())  # an even drift
    assert any_course(CATALOGUE["readout_drift"](course="any"))  # type: ignore[call-arg]


def _added(name: str, *others: str, before: Any, **values: Any) -> Any:
    """A step that added an effect; others do equally well."""
    chosen = SimpleNamespace(effect=CATALOGUE[name](**values))
    return SimpleNamespace(chosen=chosen, equivalents=(name, *others), before=before)


@pytest.mark.parametrize(
    ("steps", "doubtful"),
    [
        ((("interharmonic",), ("auto_exposure",)), True),
        ((("interharmonic",), ("gamma",)), False),
        ((("interharmonic", "pwm_tone"),), False),  # each a tone
        ((("auto_exposure", "interharmonic"),), True),
        ((("auto_exposure",),), False),
    ],
)
def test_an_effect_of_nearly_any_course_may_stand_for_a_tone_or_its_overtones(
    steps: tuple[tuple[str, ...], ...], doubtful: bool, hunting: tuple[Filmed, Discovery]
) -> None:
    found = dataclasses.replace(hunting[1], steps=())
    quiet = hunting[1].last  # explained, so that it has no short events
    added = tuple(
        _added(*names, before=quiet, **({"gains": (0.0,)} if names[0] == "auto_exposure" else {}))
        for names in steps
    )
    assert found.verdict != "unexplained"
    assert is_doubtful(dataclasses.replace(found, steps=added)) is doubtful


@pytest.mark.parametrize(("effects", "taken"), [(1, True), (2, False)])
def test_terms_explain_anew_only_with_as_few_effects(
    effects: int,
    taken: bool,
    hunting: tuple[Filmed, Discovery],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    steps = (_added("gamma", before=hunting[1].last),)
    found = dataclasses.replace(hunting[1], steps=steps)  # explained, as if without a term
    more = {"last": hunting[1].last, "steps": steps * effects}
    monkeypatch.setattr(verdict, "_searched", lambda *_: more)
    monkeypatch.setattr(verdict, "baseline_of", lambda *_: NOTHING)
    answer = verdict._by_terms(found, lambda doing, share: None, None)
    assert (answer is not found) is taken


def test_at_half_the_frame_rate_no_row_has_its_own_share(
    hunting: tuple[Filmed, Discovery], monkeypatch: pytest.MonkeyPatch
) -> None:
    """What travels down the rows looks there as if it stood."""
    fit = hunting[1].last.restored()
    half_hz = 0.5 * float(fit.data.frame_rate)
    for hz, tried in ((half_hz, False), (half_hz - 1.0, True)):
        monkeypatch.setattr(grammar_search, "_tones", lambda *_, hz=hz: [hz])
        names = {effect.name for effect in grammar_search._guesses(fit)}
        assert "gain_tone" in names or "gain_tone_2" in names
        assert any(name.startswith("gain_tone_own") for name in names) is tried


def test_where_nothing_was_added_nothing_is_doubtful(hunting: tuple[Filmed, Discovery]) -> None:
    last = hunting[1].last
    given = last.forward.model.plus(CATALOGUE["moving_stripes"](stripes=2.0))  # type: ignore[call-arg]
    last = dataclasses.replace(last, forward=last.forward.with_model(given))
    assert not is_doubtful(dataclasses.replace(hunting[1], last=last, steps=()))


@pytest.mark.usefixtures("own_catalogue")
def test_a_value_for_each_line_is_written_for_each_row(
    hunting: tuple[Filmed, Discovery], tmp_path: Path
) -> None:
    clip = PLAIN.changed(size=(64, 240), frame_rate=29.97, lamp="tone")
    made = simulate_rows(clip, synthetic_grid(5, 40.0), DURATION_S, seed=5, strips=2)
    first = first_fit(clip, measured(made.level, made.frame_time_s))
    assert first.data.lines < first.data.rows == 240
    own = effect_of(
        Term("gain", "tone", "own"), tone_hz=2.0,
        row_ratios=tuple(np.linspace(0.01, 0.02, first.data.lines).tolist()),
    )  # fmt: skip
    theory = first.forward.with_model(first.forward.model.plus(own))
    last = dataclasses.replace(first, forward=theory)
    step = dataclasses.replace(hunting[1].steps[0], trials=(Trial(own, last, 1.0, 1e4, 1.0),))
    found = dataclasses.replace(hunting[1], last=last, steps=(step,))
    (told,) = discovery_json(found, "")["effects"]
    assert "every 15 frames" in told["words"]
    assert "course" not in told
    ((name, text),) = files_of(found, "a clip").items()
    (tmp_path / name).write_text(text, encoding="utf-8")
    (effect,) = load_effects(tmp_path / name)
    assert len(effect().row_ratios) == 240  # type: ignore[attr-defined]
    taller, grid = PLAIN.changed(size=(32, 720)), GridPath([50.0, 50.1, 50.0, 50.0])
    plain, swung = (
        simulate_rows(model, grid, 2.0, seed=1, noise=False).level
        for model in (taller, taller.plus(effect()))
    )
    assert np.abs(swung / plain - 1.0).max() == pytest.approx(0.02, rel=0.01)


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


@pytest.mark.parametrize("place", ["flicker", "coding"])
def test_the_flicker_swings_all_along_a_line(place: str) -> None:
    """A second lamp's light leans from left to right, and what an encoder leaves of it does."""
    grid, clip = GridPath([50.0, 50.1, 50.0, 50.0]), PLAIN.changed(size=(32, 16), frame_rate=25)
    leaning = clip.with_effect("second_lamp", weight=0.3)
    lost = effect_of(Term(place, "step"), depth_ratio=-1.0)
    swings = [
        np.ptp(simulate_rows(model, grid, 2.0, seed=1, strips=2, noise=False).level, axis=0).max()
        for model in (leaning, leaning.plus(lost))
    ]
    assert swings[0] > 1.0
    assert swings[1] < 1e-3

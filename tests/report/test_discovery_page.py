"""The page on what a model lacks: whole, by itself, and true to what was found."""

from __future__ import annotations

import dataclasses
import re
from typing import Any

import numpy as np
import pytest

from rsenf.discrepancy.effect_file import effect_of
from rsenf.discrepancy.fit import NoiseFloor
from rsenf.discrepancy.grammar import Term
from rsenf.discrepancy.grammar_search import ShortestStep
from rsenf.discrepancy.result import discovery_json, model_of
from rsenf.discrepancy.trial import Trial
from rsenf.discrepancy.verdict import Discovery
from rsenf.report.discovery_page import discovery_page
from rsenf.report.discovery_page.pictures import SHOWN_S, most_left
from tests.discrepancy.hidden_effects import hidden
from tests.report.html_page import Page

SECTIONS = ["shrinks", "rows", "where", "steps", "left", "numbers", "model"]
Case = tuple[Discovery, dict[str, Any], str]


def case_of(found: Discovery) -> Case:
    told = discovery_json(found, "out/model.yaml")
    return found, told, discovery_page(found, told, "a <clip>.npz", model_of(found, "a clip"))


@pytest.fixture(scope="module")
def explained() -> Case:
    return case_of(hidden("gop_attenuation", seed=41, loss_ratio=0.03).discover())


@pytest.fixture(scope="module")
def unexplained() -> Case:
    """A shake with a gain, which is in no catalogue."""
    case = hidden(seed=42)
    swing = np.cos(2 * np.pi * 3.7 * case.data.time_s)[:, None, None].astype(np.float32)
    level = case.data.level
    level += 0.2 * swing * (np.roll(level, 1, axis=1) - level)
    level *= 1 + 0.001 * swing
    return case_of(case.discover())


@pytest.fixture(scope="module")
def nothing() -> Case:
    return case_of(hidden(seed=43).discover())


@pytest.mark.parametrize("name", ["explained", "unexplained", "nothing"])
def test_a_page_is_whole_and_needs_nothing_else(name: str, request: Any) -> None:
    _, told, text = request.getfixturevalue(name)
    page = Page(text)
    assert page.ids == SECTIONS
    assert not page.all("script")
    assert not page.all("link")
    assert not re.search(r"https?://|url\(", text)
    assert {str(a["href"])[1:] for a in page.all("a")} == set(SECTIONS)
    images = page.all("img")
    assert len(images) == 4
    assert all(str(i["src"]).startswith("data:image/png;base64,") for i in images)
    assert all(i["alt"] for i in images)
    assert "<clip>" not in text
    assert "a <clip>.npz" in page.words
    assert told["verdict"].replace("_", " ") in page.words


def test_what_was_added_is_told_with_its_evidence(explained: Case) -> None:
    found, told, text = explained
    words = Page(text).words
    (step,), (effect,) = found.steps, told["effects"]
    assert effect["name"] == "gop_attenuation"
    loss, error = effect["parameters"]["loss_ratio"], effect["stderr"]["loss_ratio"]
    assert f"{loss:.6g} ± {error:.2g}" in words
    assert f"{effect['gap_before']:.2e}" in words
    assert f"{effect['gap_after']:.2e}" in words
    assert f"{effect['evidence']:.4g} nats" in words
    assert f"{step.scored} candidates" in words
    for trial in step.trials:
        assert f"<td>{trial.effect.name}</td>" in text
        assert f">{trial.gain:.1e}</td>" in text
    assert "This is nothing to explain." in words
    assert found.refused is not None
    assert "nothing added" in words


def test_what_is_left_has_its_kind_and_what_would_tell(unexplained: Case) -> None:
    found, told, text = unexplained
    words = Page(text).words
    assert found.verdict == "unexplained"
    assert f"the frames show {told['unexplained']['alias_hz']:.2f} Hz" in words
    assert all(measurement in words for measurement in told["unexplained"]["would_tell"])


def test_no_shares_are_given_of_a_gap_that_is_none(nothing: Case) -> None:
    found, _, text = nothing
    words = Page(text).words
    assert found.verdict == "no_discrepancy"
    assert "There is no gap to take apart" in words
    assert "Shares of the gap" not in words


def test_the_model_is_there_with_long_lists_cut_short(explained: Case) -> None:
    found, _, text = explained
    model = text.split("<pre>")[1].split("</pre>")[0]
    assert "gop_attenuation" in model
    assert "160 in all" in model
    assert len(model.splitlines()) < 100
    assert found.last.data.rows == 160


def test_a_term_is_told_in_words_with_its_file_and_how_to_film_it(nothing: Case) -> None:
    found = nothing[0]
    tone = {"tone_hz": 1.7, "depth_ratios": (0.05,), "phases_rad": (0.0,)}
    term, longer = (effect_of(Term("gain", "tone", rows), **tone) for rows in ("all", "ramp"))
    theory = found.last.forward.with_model(found.last.forward.model.plus(term))
    last = dataclasses.replace(found.last, forward=theory)
    last.__dict__.update(gap=found.last.gap, noise_var=found.last.noise_var)
    trials = Trial(longer, last, 2.0, 12030.0, 1.0), Trial(term, last, 1.99999, 12010.0, 1.0)
    step = ShortestStep(found.first, trials, 9, 1.0, NoiseFloor(0.0, 0.1, 0.1))
    told = dataclasses.replace(found, last=last, steps=(step,))
    page = discovery_page(told, discovery_json(told, ""), "a clip", model_of(told, "a clip"))
    words = Page(page).words
    assert "periodic at 1.7000 Hz" in words
    assert "effect_gain_tone.py" in words
    assert "A term." not in words
    assert "rsenf simulate --effects effect_gain_tone.py --model model.yaml" in words
    assert f"{trials[1].nats:.4g} nats" in words
    assert "a longer description" in words


def test_the_same_discovery_gives_the_same_page(nothing: Case) -> None:
    found, told, text = nothing
    assert discovery_page(found, told, "a <clip>.npz", model_of(found, "a clip")) == text


def test_the_seconds_shown_are_held_out_and_the_worst(explained: Case) -> None:
    fit = explained[0].first
    begin = most_left(fit, 0)
    shown = slice(begin, begin + round(SHOWN_S * float(fit.data.frame_rate)))
    assert not fit.data.training[shown].any()

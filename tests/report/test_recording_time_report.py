"""The report: complete whatever came out, the same bytes for the same case, and safe to open."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from jsonschema import Draft202012Validator

from rsenf.report.recording_time import Basis, write_report
from tests.dashboard.browser import Browser, chromium
from tests.report.html_page import Page
from tests.report.report_cases import (
    BEGIN_S,
    bare_case,
    dark_case,
    found_case,
    reference_facts,
    with_result,
)

SCHEMA = Draft202012Validator(
    json.loads((Path(__file__).parents[2] / "configs/schema/report.schema.json").read_text())
)
Told = tuple[Page, dict[str, Any], Path]
MADE = "2026-01-02T03:04:05Z"
SECTIONS = ["case", "evidence", "claim", "conditions", "pictures", "candidates", "camera", "search",
            "warnings", "limits", "inputs", "command", "parameters", "terms"]  # fmt: skip


@pytest.fixture(scope="module")
def found() -> Basis:
    return found_case()


@pytest.fixture(scope="module")
def dark() -> Basis:
    return dark_case()


@pytest.fixture(scope="module")
def bare() -> Basis:
    return bare_case()


def written(folder: Path, case: Basis, made: str = MADE) -> tuple[Page, dict[str, Any]]:
    """Write a report; check what holds for every report; return the page and the numbers."""
    write_report(folder, case, made)
    text = (folder / "report.html").read_text(encoding="utf-8")
    page = Page(text)
    numbers = json.loads((folder / "report.json").read_text(), parse_constant=pytest.fail)
    assert numbers["schema"] == "rsenf.report.recording_time"
    assert numbers["version"] == 1
    SCHEMA.validate(numbers)
    assert numbers.keys() == SCHEMA.schema["properties"].keys()
    assert sorted(numbers["files"]) == sorted(p.name for p in folder.iterdir())
    # Nothing from elsewhere, nothing that runs.
    assert not page.all("script")
    assert not page.all("link")
    assert not re.search(r"https?://|url\(", text)
    assert all(str(a["href"]).startswith("#") for a in page.all("a"))
    assert {str(a["href"])[1:] for a in page.all("a")} <= set(page.ids)
    for image, told in zip(page.all("img"), numbers["pictures"], strict=True):
        assert image["alt"] == told["alt"]
        assert str(image["src"]).startswith("data:image/png;base64,")
    for told in numbers["pictures"]:
        png = (folder / told["file"]).read_bytes()
        assert hashlib.sha256(png).hexdigest() == told["sha256"]
        drawn = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
        assert drawn.shape[:2] == (told["height_px"], told["width_px"])
    # The date is in one place.
    assert text.count(made) == 1
    assert (folder / "report.json").read_text().count(made) == 1
    return page, numbers


@pytest.fixture(scope="module")
def told(found: Basis, tmp_path_factory: pytest.TempPathFactory) -> Told:
    """The report on the clip that is found: page, numbers and folder."""
    folder = tmp_path_factory.mktemp("report") / "r"
    return *written(folder, found), folder


def leaves(value: Any) -> Iterator[Any]:
    """Every value in a document."""
    if isinstance(value, dict):
        for inner in value.values():
            yield from leaves(inner)
    elif isinstance(value, list):
        for inner in value:
            yield from leaves(inner)
    else:
        yield value


def test_a_match_is_told_in_order(told: Told, found: Basis) -> None:
    page, numbers, _ = told
    assert page.ids == SECTIONS
    assert found.result.claim == "supported"
    assert numbers["answer"].startswith("Yes, the claim is supported: the recording fits")
    assert page.words.index(numbers["question"]) < page.words.index("Weight of the evidence")
    assert [p["file"] for p in numbers["pictures"]] == [
        "enf.png", "score.png", "score_near.png", "quality.png", "spectrogram.png"
    ]  # fmt: skip
    assert [(x["for"], x["against"]) for x in numbers["likelihood_ratios"]] == [
        ("H1", "H2"), ("H1", "H3")
    ]  # fmt: skip
    assert numbers["what_would_help"] == []
    assert len(page.all("tr")) > 50


def test_all_of_the_case_is_on_the_page(told: Told, found: Basis) -> None:
    page, numbers, _ = told
    for text in (
        numbers["answer"], *numbers["propositions"].values(), *numbers["limits"],
        *numbers["warnings"], *numbers["glossary"], *numbers["glossary"].values(),
        *(x["sentence"] for x in numbers["likelihood_ratios"]),
        *(x["verbal"] for x in numbers["likelihood_ratios"]),
        *numbers["likelihood_ratio_texts"]["meaning"],
        *(p["caption"] for p in numbers["pictures"]), numbers["claim"]["meaning"],
        "clip.mp4", "0" * 64, "f" * 64, numbers["inputs"]["verdict"]["sha256"],
        *numbers["conditions"], numbers["kind_meaning"], numbers["command"], "K 4711/26",
        "QuickTime / MOV", "hevc Main", "2026-01-15T08:00:00Z", "Acme", "Eye 3", "29.9700 Hz",
        "5 400 frames have one; from one to the next 33.000 to 100.000 ms, mostly 33.300 ms",
        "a warning of the test's", "gaps: 2, 3 s in all", "1.2.3", "not set",
        f"{found.result.clock_ppm:+.1f} ppm", f"{found.result.correlation:.4f}",
        *(f"{c.lag_s:.2f}" for c in found.result.candidates),
    ):  # fmt: skip
        assert " ".join(text.split()) in page.words, text


def test_the_numbers_are_the_verdict_s(told: Told, found: Basis) -> None:
    _, numbers, folder = told
    assert numbers["result"] == found.verdict
    verdict = (folder / "result.json").read_bytes()
    assert verdict == (json.dumps(found.verdict, indent=2) + "\n").encode()
    assert numbers["inputs"]["verdict"]["sha256"] == hashlib.sha256(verdict).hexdigest()
    ratios = [x["log10_lr"] for x in numbers["likelihood_ratios"]]
    assert ratios == [found.verdict["log10_lr"], found.verdict["log10_lr_absent"]]
    assert numbers["claim"]["after_best_time_s"] == pytest.approx(
        BEGIN_S + 0.2 - found.result.lag_s, abs=1e-6
    )


def test_the_same_case_gives_the_same_bytes_but_for_the_date(
    told: Told, tmp_path: Path, found: Basis
) -> None:
    later = "2031-12-31T23:59:59Z"
    written(tmp_path / "later", found, later)
    differing = set()
    for path in told[2].iterdir():
        first, second = path.read_bytes(), (tmp_path / "later" / path.name).read_bytes()
        assert second.replace(later.encode(), MADE.encode()) == first, path.name
        if first != second:
            differing.add(path.name)
    assert differing == {"report.html", "report.json"}


def test_without_a_signal_it_says_so_and_what_would_help(tmp_path: Path, dark: Basis) -> None:
    page, numbers = written(tmp_path / "r", dark)
    assert page.ids == [*SECTIONS[:4], "help", *SECTIONS[4:]]
    assert numbers["decision"] == "no_decision"
    assert "no usable signal" in numbers["answer"]
    assert numbers["pictures_left_out"] in page.words
    assert [p["file"] for p in numbers["pictures"]] == ["quality.png", "spectrogram.png"]
    assert any("--enf-method" in text for text in numbers["what_would_help"])
    assert "not computed" in page.words
    assert numbers["quality"]["usable_values"] == 0
    assert not re.search(r"\bnan\b|None", page.words)


def test_without_a_frame(tmp_path: Path, bare: Basis) -> None:
    _, numbers = written(tmp_path / "r", bare)
    assert numbers["pictures"] == []


@pytest.mark.parametrize("claim", ["", "supported", "refuted", "undecidable"])
@pytest.mark.parametrize("decision", ["match", "no_match", "no_decision"])
def test_every_outcome_has_its_page(tmp_path: Path, bare: Basis, decision: str, claim: str) -> None:
    """Whatever the combination; the pictures are another test's."""
    case = with_result(
        bare, decision=decision, claim=claim, reason="for a reason",
        lag_s=12.5 if decision == "match" else float("nan"),
        claimed_utc_ns=bare.result.claimed_utc_ns if claim else 0,
    )  # fmt: skip
    page, numbers = written(tmp_path / "r", case)
    assert ("claim" in page.ids) is bool(claim)
    assert ("help" in page.ids) is (decision != "match")
    assert numbers["answer"].endswith(".")
    assert not re.search(r"\bnan\b|None", numbers["answer"])
    assert numbers["answer"] in page.words


def test_a_weighed_claim_is_evaluative_and_a_search_is_not(tmp_path: Path, bare: Basis) -> None:
    """A claim that no ratio belongs to was not weighed, whatever became of it."""
    claimed_ns = bare.result.claimed_utc_ns
    for claim, log10_lr, kind in (
        ("supported", 2.0, "evaluative"), ("refuted", -2.0, "evaluative"),
        ("supported", float("nan"), "investigative"), ("", float("nan"), "investigative"),
    ):  # fmt: skip
        case = with_result(bare, claim=claim, claimed_utc_ns=claimed_ns if claim else 0,
                           claim_log10_lr=log10_lr, claim_log10_lr_other=log10_lr)  # fmt: skip
        page, numbers = written(tmp_path / "r", case)
        assert numbers["kind"] == kind
        assert f"{kind.capitalize()} report" in page.words
        assert ("C is the claimed start" in page.words) is (kind == "evaluative")
        assert ("not weighed" in numbers["kind_meaning"]) is (
            kind == "investigative" and claim != ""
        )


def test_conditions_are_those_of_the_case(tmp_path: Path, bare: Basis) -> None:
    """Nothing is said of ratios where a method has none, nor of times that aren't known."""
    clockless = dataclasses.replace(reference_facts(), t0_ns=0)
    case = dataclasses.replace(with_result(bare, method="metric4"), references=[clockless])
    _, numbers = written(tmp_path / "a", case)
    told = " ".join(numbers["conditions"])
    assert "without times of day" in told
    assert "Errors:" not in told
    assert "Calibration:" not in told
    _, numbers = written(tmp_path / "b", with_result(bare, method="phase"))
    told = " ".join(numbers["conditions"])
    assert "from 2023-11-14 22:13:20.00 UTC to" in told
    assert "Calibration:" in told


def test_without_a_case_or_a_container(tmp_path: Path, bare: Basis) -> None:
    recording = dataclasses.replace(bare.recording, container=None)
    case = dataclasses.replace(bare, recording=recording, command="")
    case.verdict["case"] = None
    page, numbers = written(tmp_path / "r", case)
    assert not {"case", "command"} & set(page.ids)
    assert "says of itself" not in page.words
    assert numbers["case"] is None


@pytest.mark.external
def test_nothing_is_cut_off_in_print(told: Told) -> None:
    """On A4 within the margins; every picture and table row fits a page."""
    if not chromium():
        pytest.skip("no Chromium here")
    mm = 96 / 25.4
    with Browser() as browser:
        browser.call("Emulation.setEmulatedMedia", media="print")
        browser.size(round(180 * mm), round(265 * mm))
        browser.open((told[2] / "report.html").as_uri())
        browser.until("document.querySelectorAll('img').length > 3")
        boxes = "[...document.querySelectorAll('body *')].map(e => e.getBoundingClientRect())"
        assert browser.value(f"Math.max(...{boxes}.map(b => b.right))") <= 180 * mm + 1
        kept = "[...document.querySelectorAll('figure, tr, .answer, li')]"
        heights = f"{kept}.map(e => e.getBoundingClientRect().height)"
        assert browser.value(f"Math.max(...{heights})") < 0.6 * 265 * mm


def test_a_threshold_is_not_made_more_of_than_it_is(tmp_path: Path, bare: Basis) -> None:
    case = with_result(bare, method="metric4", decision="match", claim="", claimed_utc_ns=0,
                       lag_s=12.5)  # fmt: skip
    _, numbers = written(tmp_path / "r", case)
    assert "passes the threshold of metric4" in numbers["answer"]
    assert "no other time" not in numbers["answer"]
    for ratio in numbers["likelihood_ratios"]:
        assert ratio["sentence"].endswith("metric4 gives none.")


def test_text_from_outside_is_shown_and_never_run(tmp_path: Path, dark: Basis) -> None:
    evil = '<script>alert(1)</script><img src=x onerror="alert(2)">&amp;\'"{{ 7*7 }}'
    case = dataclasses.replace(
        with_result(dark, reason=evil, grid=evil),
        recording=dataclasses.replace(dark.recording, name=evil),
        references=[dataclasses.replace(reference_facts(evil), notes=[evil])],
        parameters={evil: {evil: evil}},
        versions={"rsenf": evil},
    )
    case.verdict["warnings"] = [evil]
    page, _ = written(tmp_path / "r", case)
    assert page.words.count(evil) > 8
    assert {name for name, _ in page.tags}.isdisjoint({"script"})
    assert not [a for _, a in page.tags if "onerror" in a]
    assert len(page.all("img")) == 2


def test_a_name_that_is_no_text(tmp_path: Path, bare: Basis) -> None:
    name = b"caf\xe9.mp4".decode("utf-8", "surrogateescape")
    case = dataclasses.replace(bare, recording=dataclasses.replace(bare.recording, name=name))
    page, _ = written(tmp_path / "r", case)
    assert r"caf\udce9.mp4" in page.words


def test_several_references(tmp_path: Path, found: Basis) -> None:
    case = dataclasses.replace(found, references=[reference_facts("other"), reference_facts()])
    page, numbers = written(tmp_path / "r", case)
    assert "on the grid test" in numbers["answer"]
    assert "these references" in numbers["answer"]
    assert "Reference “other”" in page.words
    assert {c["grid"] for c in numbers["result"]["candidates"]} == {"test"}


def test_no_value_is_lost_in_rounding_to_text(told: Told, found: Basis) -> None:
    """Numbers are numbers in the JSON, not texts; the texts are for the page."""
    _, numbers, _ = told
    kept = [v for v in leaves(numbers) if isinstance(v, float)]
    assert found.result.lag_s in kept
    assert found.result.lag_std_s in kept
    assert found.result.residual_std_hz in kept

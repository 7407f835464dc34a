"""A verdict as JSON and in words, whatever is unknown of it."""

from __future__ import annotations

import dataclasses
import json
import re

import pytest

from rsenf.messages import Candidate, Header, MatchResult
from rsenf.report.values import number, ppm_text
from rsenf.report.verdict import verdict_json, verdict_words
from rsenf.timebase import utc_text

BEGIN_NS = 1_663_412_800_312_000_000  # 2022-09-17T11:06:40.312Z
MATCH = MatchResult(
    header=Header(source="test/cam1"), method="ncc", grid="day", decision="match", reason="fits",
    lag_s=40000.312, lag_std_s=0.0078, start_utc_ns=BEGIN_NS, correlation=0.99986, log10_lr=12.8,
    log10_lr_absent=4.3, clock_ppm=0.7, clock_std_ppm=0.1, search_size=86380, seconds_used=101.0,
    verbal="strong support for this time",
    candidates=(Candidate(lag_s=40000.312, start_utc_ns=BEGIN_NS, correlation=0.99986),),
)  # fmt: skip


def test_numbers_that_json_doesn_t_know() -> None:
    assert number(1.5) == 1.5
    assert number(float("nan")) is None
    assert number(float("inf")) is None


def test_times() -> None:
    assert utc_text(0) is None
    assert utc_text(BEGIN_NS) == "2022-09-17T11:06:40.312Z"
    assert utc_text(1_000_000_000_999_999_999) == "2001-09-09T01:46:40.999Z"


def test_a_clock_that_is_right_has_no_minus() -> None:
    assert [ppm_text(x) for x in (-0.04, 0.04, -0.06, 71.25)] == ["+0.0", "+0.0", "-0.1", "+71.2"]


@pytest.mark.parametrize("result", [MATCH, MatchResult(header=Header())])
def test_json_has_no_nan(result: MatchResult) -> None:
    text = json.dumps(verdict_json(result, ["mind the gap"]), allow_nan=False)
    back = json.loads(text)
    assert back["decision"] == result.decision
    assert back["warnings"] == ["mind the gap"]
    assert back["claim"] is None


def test_a_match_in_words() -> None:
    assert verdict_words(MATCH).splitlines() == [
        "match: the recording begins 2022-09-17T11:06:40.312Z, "
        "40000.31 ± 0.01 s into the reference",
        "  how well        correlation 0.9999 (1 is perfect) over 101 s of usable signal",
        "  other times     86380 compared; the next best is 10^12.8 times less likely",
        "  elsewhere       a time outside this reference is 10^4.3 times less likely",
        "  in all          strong support for this time",
        "  camera's clock  +0.7 ± 0.1 ppm (12 ppm is a second a day)",
    ]


def test_a_zone_that_is_unknown_stands_in_the_first_line() -> None:
    unknown = dataclasses.replace(MATCH, zone_unknown=True)
    assert verdict_words(unknown).splitlines()[0] == (
        "match: the recording begins 2022-09-17T11:06:40.312Z, "
        "40000.31 ± 0.01 s into the reference; zone unknown: by whole hours uncertain"
    )
    assert verdict_json(unknown, [])["zone_unknown"] is True
    assert verdict_json(MATCH, [])["zone_unknown"] is False


def test_what_decides_nothing_says_what_may_help() -> None:
    reason = "several times fit about equally well"
    undecided = dataclasses.replace(
        MATCH, decision="no_decision", reason=reason, log10_lr=0.2, log10_lr_absent=-1.0
    )
    lines = verdict_words(undecided).splitlines()
    assert lines[0] == f"no_decision: {reason}"
    assert lines[1].split(maxsplit=2)[:2] == ["best", "fit"]
    assert "the next best is about as likely" in lines[3]
    assert "a time outside this reference is 10 times more likely" in lines[4]
    assert lines[-1] == "  what may help   a longer recording, or a reference of fewer hours"


def test_nothing_compared_is_one_line() -> None:
    assert verdict_words(MatchResult(header=Header(), reason="no usable signal")) == (
        "no_decision: no usable signal"
    )


def test_a_claim_comes_last() -> None:
    claimed = dataclasses.replace(MATCH, claim="refuted", claimed_utc_ns=BEGIN_NS + 10**9)
    last = verdict_words(claimed).splitlines()[-1]
    assert last == "  claimed start   2022-09-17T11:06:41.312Z: refuted"


def test_what_is_unknown_is_not_said() -> None:
    bare = dataclasses.replace(
        MATCH, start_utc_ns=0, lag_std_s=float("nan"), log10_lr=float("nan"),
        log10_lr_absent=float("nan"), clock_std_ppm=float("nan"), verbal="",
    )  # fmt: skip
    words = verdict_words(bare)
    assert not re.search(r"nan|None|inf", words)
    assert words.startswith("match: the recording begins 40000.31 s into the reference\n")

"""Likelihood ratios in sentences: the right way round, and no larger than can be vouched for."""

from __future__ import annotations

import math

import pytest

from rsenf.match.calibration import calibration
from rsenf.match.search import MAX_VERBAL_LOG10
from rsenf.messages import Header, MatchResult
from rsenf.report.recording_time.evidence import claim_comparisons, comparisons, ratio_texts


def sentence(log10_lr: float, method: str = "ncc") -> str:
    result = MatchResult(header=Header(), method=method, log10_lr=log10_lr)
    first, second = comparisons(result)
    assert second["log10_lr"] is None
    assert second["verbal"] == "not computed"
    return str(first["sentence"]).replace("\N{NARROW NO-BREAK SPACE}", " ")


@pytest.mark.parametrize(
    ("log10_lr", "expected"),
    [
        (0.1, "What was measured is about as probable if H1 is true as if H2 is."),
        (-0.1, "What was measured is about as probable if H1 is true as if H2 is."),
        (0.5, "What was measured is about 3.2 times as probable if H1 is true as if H2 is."),
        (1.5, "What was measured is about 32 times as probable if H1 is true as if H2 is."),
        (-2.1, "What was measured is about 130 times as probable if H2 is true as if H1 is."),
        (
            11.4,
            "What was measured is 1 000 times or more as probable if H1 is true as if H2 is. "
            "(Computed: 10^11.4.)",
        ),
        (math.nan, "There is no ratio of H1 against H2: too little could be compared."),
    ],
)
def test_a_ratio_in_a_sentence(log10_lr: float, expected: str) -> None:
    assert sentence(log10_lr) == expected


def test_a_calibrated_ratio_stops_at_its_limit() -> None:
    text = sentence(min(calibration().other.limit, MAX_VERBAL_LOG10), "phase")
    assert text.endswith("times or more as probable if H1 is true as if H2 is.")


def test_a_claim_is_weighed_where_the_method_does() -> None:
    assert claim_comparisons(MatchResult(header=Header())) == []
    result = MatchResult(
        header=Header(), method="phase", claim_log10_lr=-2.0, claim_log10_lr_other=1.0
    )
    against = {x["against"]: x["log10_lr"] for x in claim_comparisons(result)}
    assert against == {"H2": 1.0, "H3": -2.0}
    assert {x["for"] for x in claim_comparisons(result)} == {"C"}


def test_the_scale_leaves_no_hole() -> None:
    scale = ratio_texts(MatchResult(header=Header()))["scale"]
    words = [step["words"] for step in scale]
    assert words[0] == "no support either way"
    assert words[-1] == "extremely strong support"
    ends = [step["ratio"].replace("\N{NARROW NO-BREAK SPACE}", "") for step in scale]
    assert ends == [
        "below 2", "2 to 10", "10 to 100", "100 to 1000", "1000 to 10000", "10000 to 1000000",
        "above 1000000",
    ]  # fmt: skip

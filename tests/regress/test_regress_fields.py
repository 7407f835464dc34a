"""What counts as moved, field by field."""

from __future__ import annotations

import dataclasses

import pytest

from rsenf.messages import EnfEstimate, MatchResult, RowBlock
from rsenf.messages.schema import field_specs, message_classes
from rsenf.messages.verdicts import Candidate
from rsenf.regress.tolerance import OTHER, TOLERANCES, moved
from tests.record.record_samples import header, random_message, rows

NAN = float("nan")


@pytest.mark.parametrize("cls", list(message_classes().values()), ids=lambda c: c.__name__)
def test_a_message_is_as_it_is_itself(cls: type) -> None:
    if "header" not in {s.name for s in field_specs(cls)}:
        return
    message = random_message(cls, 3, header(3))
    other_run = dataclasses.replace(
        message, header=dataclasses.replace(header(3), run_id="other", arrival_time_ns=1)
    )
    for exact in (True, False):
        assert moved(message, other_run, exact=exact) == []


def test_every_tolerance_is_of_a_field_and_has_a_reason() -> None:
    for name, fields in TOLERANCES.items():
        there = {spec.name for spec in field_specs(message_classes()[name])}
        assert set(fields) <= there, name
        assert all(tolerance.why for tolerance in fields.values())
    assert "frames" not in TOLERANCES["RowBlock"]


def test_an_estimate_may_move_by_a_hundredth_of_its_error_elsewhere_and_not_at_all_here() -> None:
    then = EnfEstimate(header=header(0), enf_hz=50.01, enf_var_hz2=1e-8, snr_db=30.0)
    near = dataclasses.replace(then, enf_hz=50.01 + 0.9e-6)
    far = dataclasses.replace(then, enf_hz=50.01 + 2e-6)
    assert moved(then, near, exact=False) == []
    (found,) = moved(then, near, exact=True)
    assert (found.field, found.allowed) == ("enf_hz", 0.0)
    assert found.by == pytest.approx(0.9e-6, rel=1e-3)
    (found,) = moved(then, far, exact=False)
    assert found.field == "enf_hz"
    assert found.allowed == pytest.approx(1e-6, rel=0.1)


def test_nan_is_no_number_and_equal_to_itself() -> None:
    then = EnfEstimate(header=header(0), enf_hz=NAN)
    assert moved(then, dataclasses.replace(then, enf_hz=-NAN), exact=False) == []
    (found,) = moved(then, dataclasses.replace(then, enf_hz=50.0), exact=False)
    assert (found.field, found.by) == ("enf_hz", None)


def test_the_sign_of_zero_is_a_bit() -> None:
    then = EnfEstimate(header=header(0), snr_db=0.0)
    now = dataclasses.replace(then, snr_db=-0.0)
    assert [m.field for m in moved(then, now, exact=True)] in (["snr_db"], [OTHER])
    assert moved(then, now, exact=False) == []


def test_arrays_of_other_shapes_and_single_values() -> None:
    then = rows(0)
    level = then.level.copy()
    level[1, 2, 0] += 0.5
    (found,) = moved(then, dataclasses.replace(then, level=level), exact=False)
    assert found.field == "level"
    assert found.by == pytest.approx(0.5, rel=1e-5)
    shorter: RowBlock = rows(0, n_rows=5)
    assert "level" in [m.field for m in moved(then, shorter, exact=False)]


def test_within_a_list_of_messages() -> None:
    then = MatchResult(header=header(0), candidates=(Candidate(lag_s=1.0), Candidate(lag_s=9.0)))
    now = dataclasses.replace(then, candidates=(Candidate(lag_s=1.0), Candidate(lag_s=9.5)))
    (found,) = moved(then, now, exact=False)
    assert (found.field, found.by) == ("candidates.lag_s", 0.5)
    fewer = dataclasses.replace(then, candidates=then.candidates[:1])
    assert [m.field for m in moved(then, fewer, exact=False)] == ["candidates"]


@pytest.mark.parametrize(
    ("then", "now", "same"),
    [
        ("only 12% of the picture is steady", "only 13% of the picture is steady", True),
        ("only 12% of the picture is steady", "only 15% of the picture is steady", False),
        ("only 12% of the picture is steady", "12% of the picture is steady", False),
        ("read off at 0.38 s", "read off at 0.39 s", True),
        ("1.0e-05 a minute", "1.1e-05 a minute", True),
        ("1.0e-05 a minute", "1.0e-04 a minute", False),
    ],
)
def test_words(then: str, now: str, same: bool) -> None:
    a, b = (MatchResult(header=header(0), reason=text) for text in (then, now))
    assert (moved(a, b, exact=False) == []) is same
    assert [m.field for m in moved(a, b, exact=True)] == ["reason"]


# What is read from a file or a clock, or counted: no processor does it otherwise.
_NOT_COMPUTED = {"nominal_hz", "declared_rate_hz", "seconds_used"}
_MEASURED = {"Health", "ReferenceBlock"}


@pytest.mark.parametrize("name", sorted(set(message_classes()) - _MEASURED))
def test_every_number_that_is_computed_has_a_tolerance(name: str) -> None:
    specs = field_specs(message_classes()[name])
    computed = {spec.name for spec in specs if spec.wire in ("double", "float")} - _NOT_COMPUTED
    assert computed - set(TOLERANCES.get(name, {})) == set()

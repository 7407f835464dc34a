"""Whatever happens to a file: what comes out went in, and what doesn't is reported."""

from __future__ import annotations

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.record.corruptions import CORRUPTIONS, bounded, make_sample, outcome, study

EDITS = st.lists(
    st.tuples(st.floats(0, 1), st.integers(0, 3000), st.binary(max_size=60)), min_size=1, max_size=4
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("corruptions")


@pytest.fixture(scope="module", params=[True, False], ids=["closed", "killed"])
def sample(request, folder):
    return make_sample(folder, closed=request.param)


def test_corruptions_of_every_kind(folder):
    outcomes, wrong = study(4 * len(CORRUPTIONS), 1, folder)
    assert wrong == []
    assert {kind for kind, _ in outcomes} == set(CORRUPTIONS)
    assert sum(n for (_, came), n in outcomes.items() if came == "lost") > 5


@settings(max_examples=40, deadline=None, suppress_health_check=list(HealthCheck))
@given(edits=EDITS)
def test_stretches_replaced_by_anything(sample, folder, edits):
    """Each edit takes a stretch out, at some share of the file, and puts other bytes in."""
    content = sample.content
    for place, taken, put in edits:
        at = round(place * len(content))
        content = content[:at] + put + content[at + taken :]
    with bounded():
        outcome(content, sample, folder)


@settings(max_examples=40, deadline=None, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_records_with_other_heads(sample, folder, data):
    content = bytearray(sample.content)
    for _ in range(data.draw(st.integers(1, 3))):
        _, start, _ = data.draw(st.sampled_from(sample.records))
        content[start] = data.draw(st.integers(0, 255) | st.just(content[start]))
        length = data.draw(st.integers(0, 2**64 - 1) | st.integers(0, len(content)))
        content[start + 1 : start + 9] = length.to_bytes(8, "little")
    with bounded():
        outcome(bytes(content), sample, folder)

"""Somebody else's reference: taken over where it can be one, left out and counted where not."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rsenf.messages import Header, ReferenceBlock
from rsenf.reference.live import RelayedReference
from rsenf.timebase import NS_PER_S
from tests.reference.joined import joined

T0_NS = 1_700_000_000 * NS_PER_S


def block(first: int = 0, samples: int = 10, **other: Any) -> ReferenceBlock:
    values: dict[str, Any] = {
        "header": Header(run_id="theirs", source="reference/x", seq=first),
        "grid": "x",
        "nominal_hz": 50.0,
        "t0_ns": T0_NS,
        "step_ns": NS_PER_S,
        "first": first,
        "samples": samples,
        "freq_hz": 50 + 1e-3 * np.arange(first, first + samples),
        "readings": np.ones(samples, np.uint32),
    }
    return ReferenceBlock(**{**values, **other})


def test_their_blocks_become_ours() -> None:
    stage = RelayedReference("ce", "ours")
    out = [b for k in (0, 10, 10, 30) for b in stage.update(block(k))]
    assert [(b.first, b.samples) for b in out] == [(0, 10), (10, 10), (20, 20)]
    assert {(b.grid, b.header.run_id, b.header.source, b.t0_ns) for b in out} == {
        ("ce", "ours", "reference/ce", T0_NS)
    }
    freq_hz = joined(out).freq_hz
    assert np.isnan(freq_hz[20:30]).all()
    np.testing.assert_allclose(np.delete(freq_hz, range(20, 30))[-1], 50.039)


@pytest.mark.parametrize(
    ("wrong", "why"),
    [
        ({"t0_ns": 0}, "tell no time"),
        ({"nominal_hz": 16.7}, "nominal frequency"),
        ({"nominal_hz": 60.0}, "nominal frequency"),
        ({"step_ns": 0}, "can't be"),
        ({"step_ns": 2 * NS_PER_S}, "changes"),
        ({"first": -5}, "can't be counted"),
        ({"samples": 11}, "can't be counted"),
        ({"t0_ns": 2**62, "first": 2**40}, "no time that can be"),
    ],
)
def test_what_cannot_be_a_reference_is_counted(wrong: dict[str, Any], why: str) -> None:
    stage = RelayedReference("ce")
    stage.update(block())
    assert stage.update(dataclasses.replace(block(10), **wrong)) == []
    (line,) = stage.notes.lines
    assert why in line
    assert line.endswith(": 1")
    assert stage.update(block(10))


def test_values_that_are_no_frequency_are_gaps() -> None:
    freq_hz = np.array([50.0, 230.0, np.inf, np.nan, 49.9])
    (out,) = RelayedReference("ce").update(block(samples=5, freq_hz=freq_hz))
    assert np.isfinite(out.freq_hz).tolist() == [True, False, False, False, True]


@given(
    st.integers(-(2**63), 2**63 - 1),
    st.integers(-(2**63), 2**63 - 1),
    st.integers(-(2**63), 2**63 - 1),
    st.integers(-(2**63), 2**63 - 1),
)
def test_no_numbers_end_it(t0_ns: int, step_ns: int, first: int, samples: int) -> None:
    stage = RelayedReference("ce")
    for wrong in (block(t0_ns=t0_ns, step_ns=step_ns), block(first=0, t0_ns=t0_ns)):
        stage.update(dataclasses.replace(wrong, first=first))
        stage.update(dataclasses.replace(wrong, samples=samples))


def test_samples_too_fine_to_fill_a_gap_with_are_refused() -> None:
    stage = RelayedReference("ce")
    far_ns = T0_NS + 3600 * NS_PER_S
    assert stage.update(block(step_ns=1)) + stage.update(block(step_ns=1, t0_ns=far_ns)) == []

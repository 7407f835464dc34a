"""What every idle method must do, whoever made it; and that a faulty one is caught."""

from __future__ import annotations

import copy
import dataclasses
import functools
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest

from rsenf.idle import METHODS, EstimatorState, Finding, IdleSettings, make_idle
from rsenf.idle.coherent import conclude
from rsenf.idle.stage import IdleStage
from rsenf.messages import IdleEstimate, RowBlock, canonical
from rsenf.run.runner import Runner
from tests.contracts.clips import CELLS, FOREIGN, NOTHING_THERE, Cell, clip

MOST_Z = 2.0  # root mean square, over all clips, of the error over the stated one
MOST_ERROR = 0.05  # of an idle ratio; the paper's tables are in such steps
# Where every method has what it needs, and may not refuse. The foreign camera's idle period puts
# the flicker so near one line that the next is 36 times weaker: too weak for a ratio of lines.
CLEAR = (CELLS[0], CELLS[1])


@functools.cache
def _fed(cell: Cell) -> IdleStage:
    """Return a stage that has taken in all of a clip, to end it with any method."""
    stage = IdleStage(IdleSettings(every_s=math.inf), _not_yet)
    for block in clip(cell).blocks:
        stage.update(block)
    return stage


def _not_yet(seen: EstimatorState) -> Finding:
    raise AssertionError("each test ends the clip by the method that it is about")


def _end(method: str, cell: Cell) -> IdleEstimate:
    stage = copy.deepcopy(_fed(cell))
    stage._conclude = METHODS[method]
    (estimate,) = stage.flush()
    return estimate  # type: ignore[no-any-return]


def run(method: str, blocks: Sequence[RowBlock]) -> list[IdleEstimate]:
    stage = make_idle(IdleSettings(method=method))
    return [e for block in blocks for e in stage.update(block)] + stage.flush()


def check_accuracy(method: str) -> None:
    z = []
    for cell in CELLS:
        found = _end(method, cell)
        if found.verdict != "estimated":
            assert cell not in CLEAR, found.reason
            assert found.reason
            assert np.isnan(found.idle_ratio)
            continue
        error = found.idle_ratio - cell[2]
        assert abs(error) <= MOST_ERROR
        assert found.idle_ratio_low <= found.idle_ratio <= found.idle_ratio_high
        z.append(error / np.sqrt(found.idle_ratio_var))
    assert np.sqrt(np.mean(np.square(z))) <= MOST_Z


def check_refusal(method: str, what: str) -> None:
    *_, last = run(method, NOTHING_THERE[what]())
    assert last.verdict in ("no_signal", "refused")
    assert last.reason
    assert np.isnan(last.idle_ratio)


def check_streaming(method: str) -> None:
    blocks, others = clip(CELLS[0]).blocks, clip(FOREIGN).blocks
    alone = run(method, blocks)
    one, other = (make_idle(IdleSettings(method=method)) for _ in range(2))
    out = []
    for block, foreign in zip(blocks, others, strict=False):
        other.update(foreign)
        out += one.update(block)
    out += [e for block in blocks[len(others) :] for e in one.update(block)] + one.flush()
    assert [canonical(e) for e in out] == [canonical(e) for e in alone]
    runner = Runner("idle", lambda: make_idle(IdleSettings(method=method)))
    for block in others[:40]:
        runner.feed(block)
    anew = [dataclasses.replace(b, header=dataclasses.replace(b.header, epoch=1)) for b in blocks]
    sent = [e for block in anew for e in runner.feed(block) if e.header.epoch == 1]
    assert sent
    assert [e.idle_ratio for e in sent] == pytest.approx(
        [e.idle_ratio for e in alone[: len(sent)]], abs=0.0, nan_ok=True
    )
    # In blocks of another length sums are rounded otherwise.
    for frames in (1, 13):
        last = run(method, clip(CELLS[0], frames).blocks)[-1]
        assert last.verdict == alone[-1].verdict
        assert last.idle_ratio == pytest.approx(alone[-1].idle_ratio, abs=1e-6)


@pytest.mark.parametrize("method", METHODS)
def test_it_is_within_its_own_errors(method: str) -> None:
    check_accuracy(method)


@pytest.mark.parametrize("what", NOTHING_THERE)
@pytest.mark.parametrize("method", METHODS)
def test_it_finds_nothing_where_nothing_is(method: str, what: str) -> None:
    check_refusal(method, what)


@pytest.mark.parametrize("method", METHODS)
def test_it_says_in_a_stream_what_it_says_of_a_file(method: str) -> None:
    check_streaming(method)


def off(seen: EstimatorState) -> Finding:
    """Wrong by a part in a hundred."""
    found = conclude(seen)
    return dataclasses.replace(found, turns=found.turns * 0.99)


def never(seen: EstimatorState) -> Finding:
    """Refuses whatever it sees."""
    return Finding(verdict="refused", reason="who knows?")


def forgetful(seen: EstimatorState) -> Finding:
    """Goes by how often it was asked."""
    asked.append(1)
    found = conclude(seen)
    return dataclasses.replace(found, turns=found.turns * (1 + 1e-3 * len(asked)))


asked: list[int] = []


@pytest.mark.parametrize(
    ("fault", "check"),
    [(off, check_accuracy), (never, check_accuracy), (forgetful, check_streaming)],
    ids=lambda x: x.__name__,
)
def test_a_fault_is_caught(
    fault: Callable[[EstimatorState], Finding], check: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(METHODS, "_items", dict(METHODS._items))
    METHODS.register("faulty", fault)
    with pytest.raises(AssertionError):
        check("faulty")


def test_a_claim_where_nothing_is_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    """The stage asks no method where nothing was followed: see that such a claim would be."""
    claim = Finding.of_turns(2.0, 1e-6, 100.0)
    monkeypatch.setattr(IdleStage, "_finding", lambda self, rate_hz: claim)
    with pytest.raises(AssertionError):
        check_refusal("coherent", "noise")

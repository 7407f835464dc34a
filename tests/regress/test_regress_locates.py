"""One constant changed in one stage: it is seen, and no other stage is blamed for it."""

from __future__ import annotations

import dataclasses
import shutil
from importlib import import_module
from pathlib import Path

import pytest

from rsenf.idle import estimator_state as idle_state
from rsenf.messages import EnfEstimate, RowBlock, encode
from rsenf.record import open_recording
from rsenf.record.growing import ABOUT
from rsenf.regress import accept, regress
from rsenf.track import METHODS
from rsenf.track.projection import ProjectionTracker
from tests.golden.make import FOLDER


def _always(*_: object) -> bool:
    return True


# What is changed, to what, and the stage that it is a part of.
CHANGES = [
    ("moving", "rsenf.rows.steady.LEARNING_RATE", 0.06, "rows"),
    ("weak_cfl", "rsenf.track.projection.is_faint", _always, "track"),
    ("still_2997", "rsenf.idle.estimator_state.NORMAL_STDS", 2.1, "idle"),
    ("still_2997", "rsenf.match.phase_search.APART_S", 60.0, "match"),
    ("no_mains_light", "rsenf.discrepancy.window.FEWEST_THERE", 2.0, "discover"),
]


def golden(name: str) -> Path:
    return FOLDER / f"{name}.mcap"


@pytest.mark.parametrize(("name", "constant", "value", "stage"), CHANGES)
def test_a_constant_is_located(
    name: str, constant: str, value: object, stage: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    module, _, name_there = constant.rpartition(".")
    monkeypatch.setattr(import_module(module), name_there, value)
    result = regress(golden(name))
    assert not result.passed
    assert [t.stage for t in result.topics if not t.passed] == [stage]
    assert result.first is not None
    assert result.first.stage == stage
    assert result.first.since is not None
    assert result.first.since.utc is not None
    assert result.first.since.utc.startswith("2026-01-15T10:0")
    assert result.first.fields


@pytest.fixture
def made_here(tmp_path: Path) -> Path:
    """A golden as this machine makes it: on another than its maker's, bits may differ."""
    path = tmp_path / "here.mcap"
    shutil.copy(golden("still_2997"), path)
    result = regress(path)
    if not result.exact:
        accept(result, "made on this machine")
    return path


def test_rounding_is_seen_on_the_same_versions_and_allowed_on_others(
    made_here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(idle_state, "NORMAL_STDS", 1.959964 * (1 + 1e-9))
    assert _stages_that_moved(made_here) == ["idle"]
    facts = open_recording(made_here).metadata[ABOUT]
    monkeypatch.setattr(
        "rsenf.regress.plan.program_facts", lambda: {**facts, "library numpy": "99.0"}
    )
    assert _stages_that_moved(made_here) == []
    monkeypatch.setattr(idle_state, "NORMAL_STDS", 2.1)
    assert _stages_that_moved(made_here) == ["idle"]


def _stages_that_moved(path: Path) -> list[str]:
    return [t.stage for t in regress(path).topics if not t.passed]


def test_since_when(monkeypatch: pytest.MonkeyPatch) -> None:
    class Off(ProjectionTracker):
        """By ten millihertz, from the 20th estimate on."""

        def update(self, message: RowBlock) -> list[EnfEstimate]:
            return [self._off(e) for e in super().update(message)]

        def flush(self) -> list[EnfEstimate]:
            return [self._off(e) for e in super().flush()]

        def _off(self, e: EnfEstimate) -> EnfEstimate:
            return dataclasses.replace(e, enf_hz=e.enf_hz + 0.01 * (e.header.seq >= 20))

    monkeypatch.setitem(METHODS._items, "projection", Off)
    first = regress(golden("still_2997")).first
    recorded = [
        m.header
        for _, m, _ in open_recording(golden("still_2997")).messages()
        if isinstance(m, EnfEstimate)
    ]
    assert first is not None
    assert first.since is not None
    assert first.since.message == 20
    assert first.since.frame == recorded[20].frame_first
    assert first.since.time_s == pytest.approx((recorded[20].pts_ns - recorded[0].pts_ns) / 1e9)
    assert first.fields["enf_hz"].by == pytest.approx(0.01)


def test_accepted_with_a_reason_it_is_as_it_was(
    made_here: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "accepted.mcap"
    shutil.copy(made_here, path)
    before = open_recording(path)
    monkeypatch.setattr("rsenf.flicker.mains.MIN_FLICKER_RATIO", 0.5)
    moved = regress(path)
    accept(moved, "flicker below a half of the light is none")
    again = regress(path)
    assert again.passed
    assert again.whole
    # What was not re-made is what it was, and lies where it lay.
    kept = [t for t in before.topics if t.endswith(("/video", "/grid", "/rows"))]
    assert len(kept) == 3
    assert _same(made_here, path, kept)
    story = open_recording(path).metadata
    number = 1 + sum(name.startswith("rsenf.accepted") for name in before.metadata)
    accepted = story[f"rsenf.accepted.{number}"]
    assert accepted["reason"] == "flicker below a half of the light is none"
    assert "moved rsenf/golden/cam/track" in accepted
    assert story[ABOUT]["config"] == before.metadata[ABOUT]["config"]
    monkeypatch.undo()
    back = regress(path)
    assert back.first is not None
    assert back.first.stage == "track"
    accept(back, "no, it isn't")
    names = [n for n in open_recording(path).metadata if n.startswith("rsenf.accepted")]
    assert names[-2:] == [f"rsenf.accepted.{number}", f"rsenf.accepted.{number + 1}"]
    assert _same(made_here, path, list(before.topics))


def _same(a: Path, b: Path, topics: list[str]) -> bool:
    read = [
        [(t, encode(m), at) for t, m, at in open_recording(path).messages([topic])]
        for topic in topics
        for path in (a, b)
    ]
    return read[::2] == read[1::2]

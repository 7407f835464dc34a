"""Processes side by side: one that dies costs its task, and no other."""

from __future__ import annotations

import multiprocessing
from pathlib import Path

from rsenf.batch.pool import Trouble, worked
from rsenf.run.process import slowness
from tests.batch.batch_works import Order, obey


def test_every_task_has_one_answer_whatever_dies(tmp_path: Path) -> None:
    does = {"a": "", "b": "die", "c": "die once", "d": "raise", "e": "exit", "f": ""}
    orders = [Order(name, what, tmp_path) for name, what in does.items()]
    done = {one.task.name: one for one in worked(orders, obey, jobs=2, tries=2)}
    marks = {path.name: len(path.read_text().split()) for path in tmp_path.iterdir()}
    assert marks == {"a": 1, "b": 2, "c": 2, "d": 1, "e": 2, "f": 1}
    assert sorted(done) == sorted(does)
    assert {name: one.tries for name, one in done.items()} == marks
    told = {name: one.answer for name, one in done.items() if isinstance(one.answer, Trouble)}
    assert {name: (trouble.text, trouble.died) for name, trouble in told.items()} == {
        "b": ("the process that worked on it was ended by SIGSEGV", True),
        "d": ("ValueError: d", False),
        "e": ("the process that worked on it ended by itself, with 7", True),
    }
    assert "Traceback" in told["d"].trace
    assert multiprocessing.active_children() == []


def test_whoever_looks_away_ends_the_processes(tmp_path: Path) -> None:
    orders = [Order("quick", "", tmp_path), Order("slow", "wait", tmp_path)]
    answers = worked(orders, obey, jobs=2)
    assert next(answers).task.name == "quick"
    answers.close()  # type: ignore[attr-defined]  # it is a generator
    assert multiprocessing.active_children() == []


def test_what_takes_too_long_is_given_up(tmp_path: Path) -> None:
    orders = [Order("slow", "wait", tmp_path), *(Order(name, "", tmp_path) for name in "ab")]
    limit_s = round(10 * slowness())  # for a process to start, too
    done = {d.task.name: d for d in worked(orders, obey, jobs=1, tries=2, timeout_s=limit_s)}
    assert sorted(done) == ["a", "b", "slow"]
    told = done["slow"]
    assert (told.answer, told.tries) == (Trouble(f"not done within {limit_s} s", died=True), 1)
    assert multiprocessing.active_children() == []


def test_nothing_to_do_starts_nothing() -> None:
    assert list(worked([], obey, jobs=2)) == []

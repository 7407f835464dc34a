"""The outcome of an answer of the workflow, and the errors of its parameters."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any, TypeVar

import numpy as np

from rsenf.bench.discover import Hidden
from rsenf.errors import RsenfError

T = TypeVar("T")
RIGHT, REST, WRONG, MISSED = "right", "right, and a rest", "wrong", "missed"
# Some of several effects; no effect, but a residual called unexplained; nothing of what rows can't
# show.
HALF, LEFT, UNSEEN = "half", "a rest", "unseen"
# Place in the chain of an effect of the catalogue, and the parameters that are its rate and size.
PLACED: dict[str, tuple[str, str, str]] = {
    "interharmonic": ("light", "flicker_hz", "depth_ratio"),
    "pwm_tone": ("added_light", "tone_hz", "depth_ratio"),
    "auto_exposure": ("gain", "freq_hz", "size"),  # of its course
}
# Relative errors, and shares of the height, within which a description is right.
RATE_OFF, SIZE_OFF, ROWS_OFF = 0.01, 0.2, 0.1
TIME_OFF_S, SETTLES_S = 0.05, 1.0


def answered(work: Callable[[], tuple[dict[str, Any], T]]) -> tuple[dict[str, Any], T | None]:
    """Time the workflow, of which a refusal is an answer as well, and its other result None."""
    begun_s, found, refused = time.process_time(), None, ""
    try:
        answer, found = work()
    except RsenfError as exc:
        answer = {"verdict": "refused", "effects": [], "gap": {}, "reference": {}}
        refused = str(exc)
    cpu_s = round(time.process_time() - begun_s, 2)
    return {**answer, "refused": refused, "cpu_s": cpu_s}, found


def recorded(
    case: Hidden,
    hidden: Mapping[str, Sequence[str]],
    sizes: Mapping[str, Mapping[str, Any]],
    answer: dict[str, Any],
    of_lamp: Collection[str] = (),
) -> dict[str, Any]:
    """Return the part of a record that all cases have: the case, the answer and its errors.

    Parameters
    ----------
    hidden : mapping
        Names of the hidden effects, each with those of nearly equal ones.
    sizes : mapping
        Their true parameters, as of :func:`parameter_errors`.
    answer : dict
        Of :func:`answered`.
    of_lamp : collection of str, optional
        Effects of the lamp, which may be named as well.
    """
    errors = parameter_errors(sizes, answer, case.duration_s)
    share, beside = _closed(answer, hidden, of_lamp)
    return {
        **dataclasses.asdict(case),
        "hidden": list(case.hidden),
        **{name: answer[name] for name in ("verdict", "refused", "gap", "cpu_s")},
        "named": [" or ".join(names) for names in _said_of(answer)],
        "parameters": [effect["parameters"] for effect in answer["effects"]],
        **_judged(case.kind, hidden, answer, of_lamp),
        "relative_error": {name: error[0] for name, error in errors.items()},
        "error_over_stderr": {name: error[1] for name, error in errors.items()},
        "closed": share,
        "closed_beside": beside,
    }


def _said_of(answer: dict[str, Any]) -> list[tuple[str, ...]]:
    """Return the names of each effect in an answer: one, or those of a class of equivalent ones."""
    return [tuple(effect["class"]) or (effect["name"],) for effect in answer["effects"]]


def _judged(
    kind: str,
    hidden: Mapping[str, Sequence[str]],
    answer: dict[str, Any],
    of_lamp: Collection[str] = (),
) -> dict[str, Any]:
    """Return the outcome of an answer; arguments are as of :func:`recorded`.

    An effect outside the catalogue is right if called unexplained, or explained by a nearly equal
    one. ``wrong_names``: of any outcome. ``by_like``: number named by a nearly equal effect.
    """
    said, verdict = _said_of(answer), answer["verdict"]
    named = [set(names) for names in said]
    fair = [{name, *like} for name, like in hidden.items()]
    allowed = set().union(of_lamp, *fair)
    wrong = [" or ".join(names) for names in said if not allowed & set(names)]
    found = _matched(fair, named)
    by_like = found - _matched([{name} for name in hidden], named)
    if kind == "unknown":
        explained = WRONG if wrong else RIGHT if found else MISSED
        outcome = {"unexplained": RIGHT, "explained": explained}.get(verdict, MISSED)
    elif wrong:
        outcome = WRONG
    elif kind == "none" or not hidden:
        outcome = {"unexplained": LEFT, "refused": MISSED}.get(verdict, RIGHT)
    elif found == len(hidden):
        outcome = RIGHT if verdict == "explained" else REST
    else:
        outcome = HALF if found else MISSED
    return {"outcome": outcome, "wrong_names": wrong, "by_like": by_like}


def _matched(wanted: Sequence[set[str]], named: Sequence[set[str]]) -> int:
    """Return the size of the largest matching of hidden effects with named ones."""
    from scipy.optimize import linear_sum_assignment

    equal = np.array([[bool(names & fair) for names in named] for fair in wanted], int)
    if not equal.size:
        return 0
    return int(equal[linear_sum_assignment(equal, maximize=True)].sum())


def judged_description(
    truth: Mapping[str, Any], answer: dict[str, Any], of_lamp: Collection[str]
) -> dict[str, Any]:
    """Return the outcome of an answer on a physical program that no catalogue has.

    Descriptions beside the lamp's harmonics have to be of the right place in the chain (or a class
    with it), form, rate (or times), size and rows.

    Parameters
    ----------
    truth : mapping
        ``place``, ``form``, and ``hz``, ``at_s``, ``time_constant_s`` or ``speed_per_s``,
        ``size_ratio`` and ``rows`` where it has them.
    answer, of_lamp
        As of :func:`recorded`.
    """
    said = [e for e in answer["effects"] if not {e["name"], *e["class"]} & {*of_lamp}]
    wrong = [" or ".join(e["class"]) or e["name"] for e in said if not _is_as(truth, e)]
    if answer["verdict"] == "unexplained":
        outcome = LEFT
    elif truth["form"] == "clock":
        outcome = WRONG if said else UNSEEN
    elif answer["verdict"] != "explained" or not said:
        outcome = MISSED
    else:
        outcome = WRONG if wrong else RIGHT
    return {"outcome": outcome, "wrong_names": wrong, "by_like": 0}


def _is_as(truth: Mapping[str, Any], effect: dict[str, Any]) -> bool:
    """Whether place, form, rate, size and rows of a description are right."""
    names = effect["class"] or [effect["name"]]
    values = {**effect["parameters"], **effect.get("course", {})}
    places = {PLACED[n][0] if n in PLACED else n for n in names}
    if not any(n == p or n.startswith(f"{p}_") for n in places for p in truth["place"]):
        return False
    if truth["form"] in ("event", "step"):
        found, true_s = values.get("at_s", ()), sorted(truth["at_s"])
        found = sorted(found) if isinstance(found, Sequence) else [found]
        if truth["form"] == "step":  # what starts may take a while to settle
            ends = (abs(at_s - true_s[0]) < SETTLES_S for at_s in found)
            return bool(found) and abs(found[0] - true_s[0]) < TIME_OFF_S and all(ends)
        near = (abs(a - b) < TIME_OFF_S for a, b in zip(found, true_s, strict=False))
        return len(found) == len(true_s) and all(near)
    # The parameters are those of the first of a class.
    _, rate, size = PLACED.get(names[0], ("", "tone_hz", ""))
    true_rate, most = truth.get("hz"), RATE_OFF
    for form, name in (("drifting band", "speed_per_s"), ("settling", "time_constant_s")):
        if truth["form"] == form:
            rate, true_rate, most = name, truth[name], SIZE_OFF
    if true_rate is None or values.get(rate) is None or truth["form"] == "other":
        return False
    found_rows = values.get("top_ratio", 0.0), values.get("bottom_ratio", 1.0)
    rows = zip(found_rows, truth.get("rows", (0.0, 1.0)), strict=True)
    value, true = values.get(size) if size else effect.get("size"), truth["size_ratio"]
    if truth["form"] == "settling":  # which has a sign
        value = values.get("depth_ratio")
    return (
        abs(values[rate] / true_rate - 1.0) < most
        and (true is None or (value is not None and abs(value / true - 1.0) < SIZE_OFF))
        and all(abs(a - b) < ROWS_OFF for a, b in rows)
    )


def _closed(
    answer: dict[str, Any], hidden: Mapping[str, Sequence[str]], of_lamp: Collection[str]
) -> tuple[float | None, float | None]:
    """Return the closed share of the gap above the floor, in all and without the lamp's effects.

    None without such a gap; the second also if the lamp's effects may be the hidden ones.
    """
    gap = answer["gap"]
    if not gap:
        return None, None
    remaining, least = max(abs(gap["after"]) - gap["floor"], 0.0), gap["limit"] - gap["floor"]
    above = abs(gap["before"]) - gap["floor"]
    share = 1.0 - remaining / above if above > least else None
    if not (hidden and of_lamp) or set(of_lamp) & {*hidden}.union(*hidden.values()):
        return share, None
    others = sum(
        abs(effect["gap_before"]) - abs(effect["gap_after"])
        for effect, names in zip(answer["effects"], _said_of(answer), strict=True)
        if not {*of_lamp} & {*names}
    )
    return share, float(others / (others + remaining)) if others + remaining > least else None


def parameter_errors(
    sizes: Mapping[str, Mapping[str, Any]], answer: dict[str, Any], duration_s: float
) -> dict[str, tuple[float | None, float | None]]:
    """Compare the parameters of hidden effects with the truth.

    Parameters
    ----------
    sizes : mapping
        True parameters by name, for each effect: a size, or a set of frame numbers.

    Returns
    -------
    dict
        By ``effect.parameter``: the relative error (of frame numbers, the share missed or added),
        and the error over its standard error; None if unknown.
    """
    out: dict[str, tuple[float | None, float | None]] = {}
    for name, truth in sizes.items():
        effects = [e for e in answer["effects"] if name == e["name"] or name in e["class"]]
        for parameter, true in truth.items():
            error: tuple[float | None, float | None] = None, None
            fitted = effects[0]["parameters"] if effects else {}
            value = fitted.get(parameter)
            if parameter == "drift_ratio" and not value and "drift_per_min" in fitted:
                # The rms of a linear drift about its mean.
                value = fitted["drift_per_min"] / 60.0 * duration_s / 12**0.5
            if isinstance(true, set) and value is not None:
                error = len(true ^ set(value)) / len(true), None
            elif true and value is not None:
                off, stderr = abs(value) - abs(true), effects[0]["stderr"].get(parameter)
                error = off / abs(true), off / stderr if stderr else None
            out[f"{name}.{parameter}"] = error
    return out

"""What an answer is worth, now that the truth is open.

What an answer on a foreign camera is worth, and how far off the sizes are that it tells.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Mapping, Sequence
from statistics import fmean
from typing import Any, TypeVar

from rsenf.bench.discover.plan import LIKE, Case
from rsenf.errors import RsenfError
from rsenf.model import CATALOGUE

T = TypeVar("T")
RIGHT, REST, WRONG, MISSED = "right", "right, and a rest", "wrong", "missed"


def answered(
    work: Callable[[], tuple[dict[str, Any], T]],
) -> tuple[dict[str, Any], T | None, str, float]:
    """Run the workflow; what it refuses is an answer, too.

    Parameters
    ----------
    work : callable
        Returns a dict as of :func:`rsenf.discrepancy.discovery_json`, and what it is made from.

    Returns
    -------
    told : dict
    found : object or None
        None where it refused.
    refused : str
        Why; empty where it didn't.
    cpu_s : float
        Processor time.
    """
    begun_s, found, refused = time.process_time(), None, ""
    try:
        told, found = work()
    except RsenfError as exc:
        told, refused = {"verdict": "refused", "effects": [], "gap": {}, "reference": {}}, str(exc)
    return told, found, refused, round(time.process_time() - begun_s, 2)


def recorded(case: Case, told: dict[str, Any], refused: str, cpu_s: float) -> dict[str, Any]:
    """Return what the records of all cases have: the case, and the answer."""
    return {
        "key": case.key,
        "kind": case.kind,
        "hidden": list(case.hidden),
        "seed": case.seed,
        "times": case.times,
        "video": case.video,
        "verdict": told["verdict"],
        "refused": refused,
        "named": [" or ".join(names) for names in said_of(told)],
        "gap": told["gap"],
        "cpu_s": cpu_s,
    }


def said_of(told: dict[str, Any]) -> list[tuple[str, ...]]:
    """Return what is named: the names of each class, or one."""
    return [tuple(effect["class"]) or (effect["name"],) for effect in told["effects"]]


def judged(kind: str, hidden: tuple[str, ...], told: dict[str, Any]) -> str:
    """Say whether what was told is right.

    Parameters
    ----------
    kind : str
        Of the case.
    hidden : tuple of str
        What was in it.
    told : dict
        Of :func:`rsenf.discrepancy.discovery_json`.

    Returns
    -------
    str
        ``right``; ``right, and a rest`` where all that is named is right, but something is said to
        be unexplained (of a pair: one of the two); ``wrong`` where something is named that isn't
        there, or what no catalogue has is said to be explained; ``missed``.
    """
    verdict = told["verdict"]
    named = [set(names) for names in said_of(told)]
    if kind == "none":
        return RIGHT if verdict == "no_discrepancy" else WRONG
    if kind == "outside":
        like = {LIKE.get(name, "") for name in hidden}
        if named and all(one & like for one in named):
            return RIGHT
        return {"unexplained": RIGHT, "explained": WRONG}.get(verdict, MISSED)
    if any(not one & set(hidden) for one in named):
        return WRONG
    found = [name for name in hidden if any(name in one for one in named)]
    if len(found) == len(hidden):
        return RIGHT if verdict == "explained" else REST
    if found and verdict == "unexplained":
        return REST
    return MISSED


def parameter_error(
    name: str, truth: dict[str, Any], told: dict[str, Any]
) -> tuple[float | None, float | None]:
    """Relative error of an effect's size, and over its standard error; None where not told."""
    weakest = CATALOGUE[name].weakest if name in CATALOGUE else None
    size = weakest.size if weakest else ""
    found = next((e for e in told["effects"] if e["name"] == name), None)
    if not size or found is None or not truth.get(size):
        return None, None
    off = abs(found["parameters"][size]) - abs(truth[size])
    stderr = found["stderr"].get(size)
    return off / abs(truth[size]), off / stderr if stderr else None


# More outcomes: some of the effects hidden; nothing wrong, but something is said to be unexplained.
HALF, LEFT = "half", "a rest"
# Parameters that are compared: the camera's, and what a model of rsenf calls it.
SIZES: dict[str, dict[str, str]] = {
    "harmonics": {"second_ratio": "second_ratio"},
    "gamma": {"exponent": "exponent"},
    "pwm_tone": {"depth_ratio": "depth_ratio", "tone_hz": "tone_hz"},
    "interharmonic": {"depth_ratio": "depth_ratio", "flicker_hz": "flicker_hz"},
    "second_lamp": {"weight": "weight"},
    "auto_exposure": {"gain_rms_ratio": "gain_ratio"},
    "row_banding": {"banding_rms_ratio": "banding_ratio"},
    "readout_drift": {"drift_rms_ratio": "drift_ratio"},
    "capture_jitter": {"jitter_s": "jitter_s"},
    "timestamp_jitter": {"jitter_s": "jitter_s"},
    "frame_drop": {"at_frames": "at_frames"},
    "frame_duplicate": {"at_frames": "at_frames"},
}


def judged_foreign(
    kind: str, hidden: Mapping[str, Sequence[str]], told: dict[str, Any], own: Collection[str]
) -> dict[str, Any]:
    """Say what an answer is worth.

    Parameters
    ----------
    kind : str
        Of the case.
    hidden : mapping
        Names of what was hidden, each with those that may fairly be given instead.
    told : dict
        Of :func:`rsenf.discrepancy.discovery_json`.
    own : collection of str
        What may be named beside, since the lamp has it.

    Returns
    -------
    dict
        ``outcome``: ``right``; ``right, and a rest`` where all that was hidden is named, but
        something is said to be unexplained; ``half`` where some of several is named; ``a rest``
        where nothing was hidden, nothing is named wrongly, and something is said to be unexplained;
        ``wrong`` where something is named that isn't there; ``missed``. What is in no catalogue is
        right where it is said to be unexplained, or is explained by what it is like.
        ``wrong_names``: those, of any outcome. ``by_like``: how many are named only so.
    """
    said, verdict = [set(names) for names in said_of(told)], told["verdict"]
    fair = [{name, *like} for name, like in hidden.items()]
    allowed = set().union(own, *fair)
    wrong = [" or ".join(names) for names in said_of(told) if not allowed & set(names)]
    found = _matched(fair, said)
    by_like = found - _matched([{name} for name in hidden], said)
    if kind == "unknown":
        explained = WRONG if wrong else RIGHT if found else MISSED
        outcome = {"unexplained": RIGHT, "explained": explained}.get(verdict, MISSED)
    elif wrong:
        outcome = WRONG
    elif kind == "none":
        outcome = {"unexplained": LEFT, "refused": MISSED}.get(verdict, RIGHT)
    elif found == len(hidden):
        outcome = RIGHT if verdict == "explained" else REST
    else:
        outcome = HALF if found else MISSED
    return {"outcome": outcome, "wrong_names": wrong, "by_like": by_like}


def _matched(wanted: Sequence[set[str]], said: Sequence[set[str]]) -> int:
    """How many of those wanted are said, where each thing said stands for one at most."""
    if not wanted:
        return 0
    first, *rest = wanted
    ways = [1 + _matched(rest, [*said[:n], *said[n + 1 :]])
            for n, names in enumerate(said) if names & first]  # fmt: skip
    return max([_matched(rest, said), *ways])


def closed(
    told: dict[str, Any], hidden: Mapping[str, Sequence[str]], own: Collection[str]
) -> tuple[float | None, float | None]:
    """Share of the gap above the floor that is closed, and beside what the lamp's own part closes.

    Gaps count by their size, since some are below zero. None where nothing is above the floor; and
    beside the lamp where its own part may be what was hidden, too.
    """
    gap = told["gap"]
    if not gap:
        return None, None
    left, least = max(abs(gap["after"]) - gap["floor"], 0.0), gap["limit"] - gap["floor"]
    above = abs(gap["before"]) - gap["floor"]
    share = 1.0 - left / above if above > least else None
    if not hidden or set(own) & {*hidden}.union(*hidden.values()):
        return share, None
    others = sum(
        abs(effect["gap_before"]) - abs(effect["gap_after"])
        for effect, names in zip(told["effects"], said_of(told), strict=True)
        if not {*own} & {*names}
    )
    return share, float(others / (others + left)) if others + left > least else None


def parameter_errors(
    hidden: Mapping[str, dict[str, Any]], told: dict[str, Any], duration_s: float
) -> dict[str, tuple[float | None, float | None]]:
    """Compare what is told of what was hidden with the truth.

    Returns
    -------
    dict
        By effect and parameter, joined by a dot: the relative error, and the error over its
        standard error; None where not told. Of frames it is the share that is lost or too many.
    """
    out: dict[str, tuple[float | None, float | None]] = {}
    for name, truth in hidden.items():
        own = [e for e in told["effects"] if name == e["name"] or name in e["class"]]
        for theirs, ours in SIZES.get(name, {}).items():
            out[f"{name}.{ours}"] = None, None
            if not own:
                continue
            value = _value(ours, own[0]["parameters"], duration_s)
            if value is None:
                continue
            if ours == "at_frames":
                frames = _captured(name, truth)
                out[f"{name}.{ours}"] = len(frames ^ set(value)) / len(frames), None
                continue
            true, stderr = _true(name, theirs, truth), own[0]["stderr"].get(ours)
            off = abs(value) - true
            out[f"{name}.{ours}"] = off / true, off / stderr if stderr else None
    return out


def _true(name: str, theirs: str, truth: dict[str, Any]) -> float:
    """Return a true size as a model of rsenf means it, which has one for all strips."""
    size = abs(float(truth[theirs]))
    if name == "second_lamp":  # beside the light there was, not in the place of some of it
        return size / (1.0 + size)
    if theirs == "depth_ratio" and "strip_ratio" in truth:
        return size * fmean(truth["strip_ratio"])
    return size


def _value(name: str, parameters: dict[str, Any], duration_s: float) -> Any:
    """Return a parameter that was told; None where it wasn't."""
    if name == "drift_ratio" and not parameters.get(name) and "drift_per_min" in parameters:
        # A straight course, whose rms about its mean is this.
        return parameters["drift_per_min"] / 60.0 * duration_s / 12**0.5
    return parameters.get(name)


def _captured(name: str, truth: dict[str, Any]) -> set[int]:
    """Return the frames lost or repeated, by their numbers as captured, as rsenf counts them."""
    at, before = truth["at_frames"], 0
    if name == "frame_duplicate":  # `at` are the copies, as they arrive
        return {n - 1 - (0 if truth["form"] == "in place" else k) for k, n in enumerate(at)}
    out: set[int] = set()
    for n, many in zip(at, truth["frames_lost"], strict=True):  # first to arrive after the loss
        out |= set(range(n + before, n + before + many))
        before += many
    return out

"""What an answer is worth, now that the truth is open."""

from __future__ import annotations

from typing import Any

from rsenf.bench.discover.outside import LIKE
from rsenf.model import CATALOGUE

RIGHT, REST, WRONG, MISSED = "right", "right, and a rest", "wrong", "missed"


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
    named = [set(effect["class"]) or {effect["name"]} for effect in told["effects"]]
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

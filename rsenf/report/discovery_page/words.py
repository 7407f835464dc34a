"""What was found, in sentences."""

from __future__ import annotations

from typing import Any

from rsenf.discrepancy.verdict import Discovery
from rsenf.report.discovery_page.steps import gap_words, names_of
from rsenf.report.hint_words import kind_words, tone_words

DEFINITIONS = (
    "A model of lamp, camera and codec is fitted to every other stretch of 3 s; all figures here "
    "are of the stretches between, which nothing of the camera or the lamp was fitted to, and the "
    "light's own course, which every moment has for itself, was fitted to every other row only.",
    "The gap is the mean product of what is left on neighbouring rows, over the power of the "
    "fitted flicker: noise differs from row to row and has no part in it, so it is the share of "
    "the flicker's power that the model gets wrong (below zero where neighbours are wrong in "
    "opposite ways); its standard error is that of the mean over the stretches.",
    "Chance alone is the gap of 20 recordings that the last model made itself, fitted alike: their "
    "median is the floor, and four of their standard deviations above it is the limit; an effect "
    "is added only if it makes the held-out rows likelier by more than a limit (in nats, "
    "logarithms of a likelihood ratio) that grows with the number of candidates tried.",
)
_CHANCE = "no more than chance leaves of recordings that the model has made itself"


def headline(found: Discovery, told: dict[str, Any]) -> str:
    """Return the verdict in one sentence."""
    added, shrinks = _and(names_of(found)), _shrinks(found)
    if found.verdict == "no_discrepancy":
        return f"The model explains this recording: what it leaves is {_CHANCE}."
    if found.verdict == "explained":
        it = "it" if len(names_of(found)) == 1 else "them"
        return f"The model lacked {added}: with {it} {shrinks}what is left is {_CHANCE}."
    kind = kind_words(told["unexplained"])
    first = f"With {added} {shrinks}still s" if added else "S"
    return (
        f"{first}omething is missing that no effect known here explains; what is left looks like "
        f"this: {kind}."
    )


def left_over(found: Discovery, told: dict[str, Any]) -> dict[str, Any]:
    """Return what is to be told of what is left at the end."""
    left = told["unexplained"]
    return {
        "gap": gap_words(found.last.gap),
        "limit": f"{found.floor.limit:.1e}",
        "floor": f"{found.floor.median:.1e}",
        "kind": kind_words(left) if left else "",
        "tone": tone_words(left) if left else "",
        "would_tell": left["would_tell"] if left else [],
    }


def _shrinks(found: Discovery) -> str:
    """Say how much of the gap goes, where there was one and it shrank."""
    share = found.shrinkage
    return f"the gap shrinks by {min(100.0 * share, 100.0):.1f} %, and " if share > 0.0 else ""


def _and(names: list[str]) -> str:
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)

"""A discovery as one HTML page: the result in sentences, steps, pictures and tables."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rsenf import __version__
from rsenf.discrepancy.clock_offset import ClockOffsetDiscovery, beside_json, joined
from rsenf.discrepancy.verdict import Discovery
from rsenf.model import CaptureModel
from rsenf.report.discovery import kind_words, tone_words
from rsenf.report.discovery_page.beside import DEFINITIONS as BESIDE
from rsenf.report.discovery_page.beside import draw_beside, model_text, section
from rsenf.report.discovery_page.pictures import draw_pictures
from rsenf.report.discovery_page.steps import gap_words, names_of, places_table, round_of, step_of
from rsenf.report.pages import fill

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


def headline(found: Discovery, doc: dict[str, Any]) -> str:
    """Return the verdict in one sentence.

    Parameters
    ----------
    found : Discovery
    doc : dict
        Of :func:`rsenf.discrepancy.discovery_json`.
    """
    added, shrinks = _and(names_of(found)), _shrinks(found)
    if found.verdict == "no_discrepancy":
        return f"The model explains this recording: what it leaves is {_CHANCE}."
    if found.verdict == "explained":
        it = "it" if len(names_of(found)) == 1 else "them"
        return f"The model lacked {added}: with {it} {shrinks}what is left is {_CHANCE}."
    kind = kind_words(doc["unexplained"])
    first = f"With {added} {shrinks}still s" if added else "S"
    return (
        f"{first}omething is missing that no effect known here explains; what is left looks like "
        f"this: {kind}."
    )


def left_over(found: Discovery, doc: dict[str, Any]) -> dict[str, Any]:
    """Return the template's values for the remaining residual; parameters as for ``headline``."""
    residual = doc["unexplained"]
    return {
        "gap": gap_words(found.last.gap),
        "limit": f"{found.floor.limit:.1e}",
        "floor": f"{found.floor.median:.1e}",
        "kind": kind_words(residual) if residual else "",
        "tone": tone_words(residual) if residual else "",
        "would_tell": residual["would_tell"] if residual else [],
    }


def _shrinks(found: Discovery) -> str:
    """Return by how much the gap shrinks, as a clause; empty if it doesn't."""
    share = found.shrinkage
    return f"the gap shrinks by {min(100.0 * share, 100.0):.1f} %, and " if share > 0.0 else ""


def _and(names: list[str]) -> str:
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)


def discovery_page(
    found: Discovery,
    doc: dict[str, Any],
    recording: str,
    extended: CaptureModel,
    beside: ClockOffsetDiscovery | None = None,
) -> str:
    """Return the page as HTML; its text is deterministic.

    Parameters
    ----------
    found : Discovery
    doc : dict
        Of :func:`rsenf.discrepancy.discovery_json`: the result from rows.
    recording : str
        Name of the recording.
    extended : CaptureModel
        Of :func:`rsenf.discrepancy.model_of`.
    beside : ClockOffsetDiscovery, optional
        The result against a reference.
    """
    data = found.last.data
    pictures = draw_pictures(found)
    beside_doc = beside_json(beside, "") if beside else None
    reference = section(beside, beside_doc, len(pictures)) if beside and beside_doc else None
    smaller = found.last.gap.value / (found.first.gap.value or 1e-30)
    none = found.verdict == "no_discrepancy"
    return fill(
        Path(__file__).parent / "page.html.j2",
        [*pictures, *(draw_beside(beside) if beside else [])],
        recording=recording,
        verdict=joined(doc, beside_doc)["verdict"] if beside_doc else found.verdict,
        headline=headline(found, doc) + (f" {reference['headline']}" if reference else ""),
        facts=(
            f"{data.frames} frames at {float(data.frame_rate):.3f} a second "
            f"({data.time_s[-1]:.0f} s), {data.lines} {data.axis} in {data.strips} "
            f"strip{'s' * (data.strips > 1)}, mains of {data.nominal_hz:.0f} Hz"
        ),
        steps=[step_of(step, n) for n, step in enumerate(found.steps, 1)],
        refused=round_of(found.refused) if found.refused else None,
        left=left_over(found, doc),
        places=[] if none else places_table(found.before, found.after, smaller),
        reference=reference,
        misfit=doc["held_out_mean_square"],
        model=model_text(extended),
        definitions=[*DEFINITIONS, *(BESIDE if beside else ())],
        version=__version__,
    )

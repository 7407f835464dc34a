"""A discovery as one HTML page."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rsenf import __version__
from rsenf.discrepancy.beside import BesideDiscovery, beside_json, joined
from rsenf.discrepancy.verdict import Discovery
from rsenf.model import CaptureModel
from rsenf.report.discovery_page.beside import DEFINITIONS as BESIDE
from rsenf.report.discovery_page.beside import section
from rsenf.report.discovery_page.beside_pictures import draw_beside
from rsenf.report.discovery_page.model_text import model_text
from rsenf.report.discovery_page.pictures import draw_pictures
from rsenf.report.discovery_page.places import places_table
from rsenf.report.discovery_page.steps import round_of, step_of
from rsenf.report.discovery_page.words import DEFINITIONS, headline, left_over
from rsenf.report.pages import fill


def discovery_page(
    found: Discovery,
    told: dict[str, Any],
    recording: str,
    extended: CaptureModel,
    beside: BesideDiscovery | None = None,
) -> str:
    """Return the page; the same discovery gives the same text.

    Parameters
    ----------
    found : Discovery
    told : dict
        Of :func:`rsenf.discrepancy.discovery_json`: what the rows told.
    recording : str
        Name of what was looked at.
    extended : CaptureModel
        Of :func:`rsenf.discrepancy.model_of`.
    beside : BesideDiscovery, optional
        What a reference told.
    """
    data = found.last.data
    pictures = draw_pictures(found)
    own = beside_json(beside, "") if beside else None
    reference = section(beside, own, len(pictures)) if beside and own else None
    smaller = found.last.gap.value / (found.first.gap.value or 1e-30)
    none = found.verdict == "no_discrepancy"
    return fill(
        Path(__file__).parent / "page.html.j2",
        [*pictures, *(draw_beside(beside) if beside else [])],
        recording=recording,
        verdict=joined(told, own)["verdict"] if own else found.verdict,
        headline=headline(found, told) + (f" {reference['headline']}" if reference else ""),
        facts=(
            f"{data.frames} frames at {float(data.frame_rate):.3f} a second "
            f"({data.time_s[-1]:.0f} s), {data.lines} {data.axis} in {data.strips} "
            f"strip{'s' * (data.strips > 1)}, mains of {data.nominal_hz:.0f} Hz"
        ),
        steps=[step_of(step, n) for n, step in enumerate(found.steps, 1)],
        refused=round_of(found.refused) if found.refused else None,
        left=left_over(found, told),
        places=[] if none else places_table(found.before, found.after, smaller),
        reference=reference,
        misfit=told["held_out_mean_square"],
        model=model_text(extended),
        definitions=[*DEFINITIONS, *(BESIDE if beside else ())],
        version=__version__,
    )

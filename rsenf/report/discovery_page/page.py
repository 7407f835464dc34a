"""A discovery as one HTML page."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rsenf import __version__
from rsenf.discrepancy import Discovery
from rsenf.model import CaptureModel
from rsenf.report.discovery_page.model_text import model_text
from rsenf.report.discovery_page.pictures import draw_pictures
from rsenf.report.discovery_page.places import places_table
from rsenf.report.discovery_page.steps import round_of, step_of
from rsenf.report.discovery_page.words import DEFINITIONS, headline, left_over
from rsenf.report.pages import fill


def discovery_page(
    found: Discovery, told: dict[str, Any], recording: str, extended: CaptureModel
) -> str:
    """Return the page; the same discovery gives the same text.

    Parameters
    ----------
    found : Discovery
    told : dict
        Of :func:`rsenf.discrepancy.discovery_json`.
    recording : str
        Name of what was looked at.
    extended : CaptureModel
        Of :func:`rsenf.discrepancy.model_of`.
    """
    data = found.last.data
    return fill(
        Path(__file__).parent / "page.html.j2",
        draw_pictures(found),
        recording=recording,
        verdict=found.verdict,
        headline=headline(found, told),
        facts=(
            f"{data.frames} frames at {float(data.frame_rate):.3f} a second "
            f"({data.time_s[-1]:.0f} s), {data.lines} {data.axis} in {data.strips} "
            f"strip{'s' * (data.strips > 1)}, mains of {data.nominal_hz:.0f} Hz"
        ),
        steps=[step_of(step, n) for n, step in enumerate(found.steps, 1)],
        refused=round_of(found.refused) if found.refused else None,
        left=left_over(found, told),
        places=places_table(found),
        misfit=told["held_out_mean_square"],
        model=model_text(extended),
        definitions=DEFINITIONS,
        version=__version__,
    )

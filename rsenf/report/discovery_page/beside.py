"""Discovery against a reference: a page by itself, or a section on the page of the rows."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rsenf import __version__
from rsenf.discrepancy.clock_offset import ClockOffsetDiscovery, where_beside
from rsenf.model import CATALOGUE, CaptureModel
from rsenf.report.discovery import kind_words
from rsenf.report.discovery_page.beside_pictures import draw_beside
from rsenf.report.discovery_page.model_text import model_text
from rsenf.report.discovery_page.places import places_table
from rsenf.report.discovery_page.steps import gap_words, summary
from rsenf.report.pages import fill

DEFINITIONS = (
    "The capture model films a lamp on the grid that the reference tells of, and the very tracker "
    "that read the recording reads the film: so what is compared has passed the same windows. "
    "Where the reference is itself an average, the recording's ENF is averaged alike.",
    "The lag, and the clock's error where it is added, are fitted to every other stretch of time; "
    "the gap is of the stretches between. It is the mean square of measured less simulated ENF, a "
    "constant offset and all, less what estimates and reference would differ by through their "
    "noise, over the variance of the reference meanwhile; its standard error is that of the mean "
    "over the stretches.",
    "Chance alone is the gap of 60 recordings of the same noise that the last model explains, "
    "fitted alike: their median is the floor, and four of their standard deviations above it is "
    "the limit.",
    "The values given are of a last fit to all stretches; their standard errors are by chance, or "
    "larger where more than that is left.",
)


def beside_page(
    found: ClockOffsetDiscovery, doc: dict[str, Any], recording: str, extended: CaptureModel
) -> str:
    """Return the page of a recording with one mean per frame; its text is deterministic.

    Parameters
    ----------
    found : ClockOffsetDiscovery
    doc : dict
        Of :func:`rsenf.discrepancy.clock_offset.beside_json`.
    recording : str
        Name of the recording.
    extended : CaptureModel
        Of :func:`rsenf.discrepancy.clock_offset.beside_model`.
    """
    clip = found.beside.clip
    return fill(
        Path(__file__).parent / "beside.html.j2",
        draw_beside(found),
        recording=recording,
        verdict=found.verdict,
        facts=(
            f"{clip.duration_s:.0f} s of one mean a frame, at {float(clip.frame_rate):.3f} frames "
            f"a second, beside the reference {found.beside.grid.name}"
        ),
        reference=section(found, doc, first_picture=0),
        model=model_text(extended),
        definitions=DEFINITIONS,
        version=__version__,
    )


def section(found: ClockOffsetDiscovery, doc: dict[str, Any], first_picture: int) -> dict[str, Any]:
    """Return the template's values for the section on a reference.

    Parameters
    ----------
    found : ClockOffsetDiscovery
    doc : dict
        Of :func:`rsenf.discrepancy.clock_offset.beside_json`.
    first_picture : int
        Index of its first picture on the page.
    """
    gap, residual = doc["gap"], doc["unexplained"]
    before, after = (where_beside(found, fit) for fit in (found.first, found.last))
    smaller = gap["after"] / (gap["before"] or 1e-30)
    return {
        "first": first_picture,
        "verdict": found.verdict,
        "headline": headline(found, doc),
        "added": bool(found.skew),
        "about": summary(CATALOGUE["clock_skew"]()),
        "values": _values(found, gap, doc["reference"]),
        "kind": kind_words(residual) if residual else "",
        "would_tell": residual["would_tell"] if residual else [],
        "places": [] if found.verdict == "no_discrepancy" else places_table(before, after, smaller),
    }


def headline(found: ClockOffsetDiscovery, doc: dict[str, Any]) -> str:
    """Return the result against the reference in one sentence; parameters as for ``section``."""
    clock, kind = _clock(found), doc["unexplained"]
    shrinks = f"the gap shrinks by {100.0 * min(found.shrinkage, 1.0):.1f} %"
    chance = "no more than the noise of recording and reference makes"
    if found.verdict == "no_discrepancy":
        return f"The recording follows the reference: what is left between them is {chance}."
    if found.verdict == "explained":
        return f"{clock}: with that {shrinks}, and what is left is {chance}."
    looks = f"what is left looks like this: {kind_words(kind)}."
    if not found.skew:
        return f"Recording and reference differ, and not by a clock's error; {looks}"
    return f"{clock}, and with that {shrinks}, but still more is left than noise; {looks}"


def _clock(found: ClockOffsetDiscovery) -> str:
    if not found.skew:
        return ""
    ppm, error = found.clock
    return f"The camera's clock is off by {ppm:+.1f} ± {error:.1g} ppm against the reference"


def _values(
    found: ClockOffsetDiscovery, gap: dict[str, Any], how: dict[str, Any]
) -> list[tuple[str, str, str]]:
    """Return names, values and explanations."""
    out = []
    if found.skew:
        ppm, error = found.clock
        out.append(("clock_ppm", f"{ppm:+.2f} ± {error:.2g}", "fast above 0; by all the recording"))
    out += [
        ("lag", f"{how['lag_s']:.2f} ± {how['lag_stderr_s']:.2f} s", "from the reference's start"),
        ("reference", how["read_as"], "what its values are taken for"),
        ("gap before", gap_words(found.gap(found.first)), "share of the reference's variance"),
        ("gap after", gap_words(found.gap(found.last)), "on held-out stretches"),
        ("chance", f"{gap['floor']:.1e}, at most {gap['limit']:.1e}", "of data without any gap"),
        ("noise", f"{1e3 * how['estimate_noise_hz']:.2g} and {1e3 * how['reference_noise_hz']:.2g} "
         "mHz", "of a value of the recording, and of the reference"),
    ]  # fmt: skip
    if found.skew:
        evidence = f"{found.skew.nats:.4g} nats"
        out.append(("evidence", evidence, f"on held-out stretches, of {found.tried} ways tried"))
    return out

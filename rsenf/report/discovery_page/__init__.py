"""The page on what a capture model lacks of a recording: by its rows, beside a reference, or both.

Its sections and verdicts in sentences; ``steps`` makes blocks, ``pictures`` draws.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import yaml
from markupsafe import Markup

from rsenf import __version__
from rsenf.discrepancy.clock_offset import ClockOffsetDiscovery, beside_json, joined
from rsenf.discrepancy.effect_file import file_of
from rsenf.discrepancy.grammar import term_of
from rsenf.discrepancy.verdict import Discovery
from rsenf.model import CaptureModel
from rsenf.report import page as html
from rsenf.report.discovery import camera_words, kind_words
from rsenf.report.discovery_page import steps
from rsenf.report.discovery_page.pictures import draw_pictures, names_of
from rsenf.report.page import Head, Section, figure, listed, note, paragraph
from rsenf.report.panels import Panel
from rsenf.report.values import texts


class About(NamedTuple):
    """What a page is about: a discovery from rows, or beside a reference, or both."""

    model: CaptureModel
    found: Any = None  # a Discovery, with its document and pictures
    doc: Any = None
    pictures: Sequence[Panel] = ()
    beside: ClockOffsetDiscovery | None = None
    beside_doc: Any = None


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
        Of :func:`rsenf.discrepancy.result.discovery_json`: the result from rows.
    recording : str
        Name of the recording.
    extended : CaptureModel
        Of :func:`rsenf.discrepancy.result.model_of`.
    beside : ClockOffsetDiscovery, optional
        The result against a reference.
    """
    data, verdict, text = found.last.data, found.verdict, _headline(found, doc)
    beside_doc = beside_json(beside, "") if beside else {}
    if beside:
        verdict = joined(doc, beside_doc)["verdict"]
        text = f"{text} {steps.headline(beside, beside_doc)}"
    facts = (
        f"{data.frames} frames at {float(data.frame_rate):.3f} a second "
        f"({data.time_s[-1]:.0f} s), {data.lines} {data.axis} in {data.strips} "
        f"strip{'s' * (data.strips > 1)}, mains of {data.nominal_hz:.0f} Hz."
    )
    if "camera" in doc:
        facts = f"{facts} The camera's model: {camera_words(doc['camera'])}."
    about = About(extended, found, doc, draw_pictures(found), beside, beside_doc)
    head = _head("", recording, (verdict, text), facts)
    return html.render(head, (*BY_ROWS, *IN_ALL), about, _FOOTER.format(__version__, "row"))


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
    facts = (
        f"{clip.duration_s:.0f} s of one mean a frame, at {float(clip.frame_rate):.3f} frames "
        f"a second, beside the reference {found.beside.grid.name}."
    )
    kind, answer = ", beside a reference of the grid", (found.verdict, steps.headline(found, doc))
    head = _head(kind, recording, answer, facts)
    about = About(extended, beside=found, beside_doc=doc)
    return html.render(head, (BESIDE, *IN_ALL), about, _FOOTER.format(__version__, "value"))


def _head(beside: str, recording: str, answer: tuple[str, str], facts: str) -> Head:
    return Head(
        title=f"What the model lacks: {recording}",
        kind=f"Report on what a model of the capture lacks{beside}",
        heading=f"What does the model lack to explain {recording}?",
        answer=answer,
        note=facts,
    )


_FOOTER = (
    "Made by rsenf {}. The numbers are in discovery.json beside this page, what is left of every "
    "{} in residuals.npz."
)
_CHANCE = "no more than chance leaves of recordings that the model has made itself"


def _headline(found: Discovery, doc: dict[str, Any]) -> str:
    """Return the verdict in one sentence."""
    *names, last = names_of(found) or [""]
    added, share = " and ".join(filter(None, [", ".join(names), last])), found.shrinkage
    less = f"the gap shrinks by {min(100.0 * share, 100.0):.1f} %, and " if share > 0.0 else ""
    if found.verdict == "no_discrepancy":
        return f"The model explains this recording: what it leaves is {_CHANCE}."
    if found.verdict == "explained":
        them = "them" if names else "it"
        return f"The model lacked {added}: with {them} {less}what is left is {_CHANCE}."
    kind = kind_words(doc["unexplained"])
    first = f"With {added} {less}still s" if added else "S"
    return (
        f"{first}omething is missing that no effect known here explains; what is left looks like "
        f"this: {kind}."
    )


Blocks = list[Markup]


def _shrinking(about: About) -> Blocks:
    misfit = about.doc["held_out_mean_square"]
    last = f", {misfit['after']:.4g} at last" if about.found.steps else ""
    return [
        paragraph(texts("discovery")["gap"]),
        figure(about.pictures[0], narrow=True),
        note(
            "Mean square of all that is left of held-out rows, noise and all: "
            f"{misfit['before']:.4g} levels² at first{last}."
        ),
    ]


def _images(about: About) -> Blocks:
    return [figure(about.pictures[1], narrow=True)]


def _where(about: About) -> Blocks:
    found = about.found
    shown = [figure(picture, narrow=True) for picture in about.pictures[2:]]
    if found.verdict == "no_discrepancy":
        return [*shown, paragraph(texts("discovery")["no_gap"])]
    smaller = found.last.gap.value / (found.first.gap.value or 1e-30)
    return [
        *shown,
        steps.shares_table(found.before, found.after, smaller, bool(found.steps)),
        note(texts("discovery")["shares"]),
    ]


def _steps(about: About) -> Blocks:
    found = about.found
    blocks = [
        block for n, step in enumerate(found.steps, 1) for block in steps.step_blocks(step, n)
    ]
    if found.refused:
        number = "Last round" if found.steps else "The only round"
        blocks += [html.heading(f"{number}: nothing added"), *steps.round_blocks(found.refused)]
    return blocks


def _left(about: About) -> Blocks:
    found = about.found
    template, floor = texts("discovery")["left"], found.floor
    gap = template.format(gap=steps.gap_text(found.last.gap), floor=floor.median, limit=floor.limit)
    guess = steps.guess_blocks(about.doc["unexplained"], found.verdict)
    return [paragraph(gap), *(guess or [paragraph("This is nothing to explain.")])]


def _reference(about: About) -> Blocks:
    if not about.beside:
        return []
    found, doc = about.beside, about.beside_doc
    headed = paragraph(steps.headline(found, doc) if about.found else "")
    return [headed, *steps.reference_blocks(found, doc, steps.draw_beside(found))]


def _numbers(about: About) -> Blocks:
    fixed = texts("discovery")
    of_rows = fixed["of_rows"] if about.found else []
    return [listed([*of_rows, *(fixed["of_reference"] if about.beside else [])], "ol")]


def _model(about: About) -> Blocks:
    kept = _short(about.model.to_dict())
    files = [f"--effects {file_of(e)} " for e in about.model.effects if term_of(e)]
    return [
        paragraph(Markup(
            "{} are cut short here; the file model.yaml has all of it, and "
            "<code>rsenf simulate {}--model model.yaml</code> takes it as it is."
        ).format("Lists and numbers" if about.found else "Numbers", "".join(files))),
        html.verbatim(yaml.safe_dump(kept, sort_keys=False, width=90, allow_unicode=True)),
    ]  # fmt: skip


DIGITS = 7
FEW = 6  # longest list that is printed in full


def _short(value: Any) -> Any:
    """Return a value of which numbers are rounded, and long lists have their first values only."""
    if isinstance(value, dict):
        return {name: _short(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        first = [_short(item) for item in value[:FEW]]
        return first if len(value) <= FEW else [*first[:2], f"… {len(value)} in all"]
    return float(f"{value:.{DIGITS}g}") if isinstance(value, float) else value


BESIDE = Section("reference", "Beside the reference", _reference, "The reference")
BY_ROWS = (
    Section("shrinks", "How the gap shrinks", _shrinking, "The gap"),
    Section("rows", "Measured beside simulated", _images, "The rows"),
    Section("where", "Where they disagree", _where, "Where it is"),
    Section("steps", "Step by step", _steps),
    Section("left", "What remains", _left),
    Section("reference", "Beside a reference of the grid", _reference, "The reference"),
)
IN_ALL = (
    Section("numbers", "What the numbers are", _numbers, "The numbers"),
    Section("model", "The model, as it was written", _model, "The model"),
)

"""The page of a report on the time of a recording: its sections in their order.

To add a section, add a function of the document and a line in ``SECTIONS``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from markupsafe import Markup

from rsenf.report import page as html
from rsenf.report.page import Head, Section, facts, heading, listed, note, paragraph, unbroken
from rsenf.report.panels import Panel
from rsenf.report.recording_time.document import Document
from rsenf.report.values import (
    count,
    duration,
    fixed,
    known,
    mhz,
    percent,
    power,
    ppm,
    setting,
    texts,
    utc,
)

Blocks = list[Markup]
Report = dict[str, Any]  # a Document, and its pictures as "drawn"


def page_of(document: Document, pictures: Sequence[Panel]) -> str:
    """Return the page."""
    r, claim = document, document["claim"]
    head = Head(
        title=f"Time of recording: {r['inputs']['recording']['name']}",
        kind=f"{r['kind'].capitalize()} report on the time of a recording, from the flicker of "
        "its light",
        heading=r["question"],
        answer=(claim["verdict"] if claim else r["decision"], r["answer"]),
        note=r["kind_meaning"],
    )
    footer = Markup(
        "Made by rsenf {} on <time>{}</time>. The same input gives the same report on the same "
        "machine, but for this date. All numbers are in report.json, the pictures as files beside "
        "this page."
    ).format(r["versions"].get("rsenf", ""), r["made_utc"])
    return html.render(head, SECTIONS, {**document, "drawn": pictures}, footer)


def _case(r: Report) -> Blocks:
    case = r["case"]
    if not case:
        return []
    return [
        facts((name, setting(value)) for name, value in case.items()),
        note(texts("recording_time")["case"]),
    ]


def _evidence(r: Report) -> Blocks:
    ratio = r["likelihood_ratio_texts"]
    among = r["claim"]["among"] if r["claim"] else ""
    return [
        paragraph("These propositions are set against each other, in pairs:"),
        facts(((n, unbroken(text)) for n, text in r["propositions"].items()), kind="short"),
        *_ratios(r["likelihood_ratios"]),
        paragraph(among),
        heading("What a likelihood ratio means, and what not"),
        listed([*ratio["meaning"], ratio["limit"]]),
        note(ratio["method"]),
        html.table(
            ["Likelihood ratio", "Words"],
            ([step["ratio"], step["words"]] for step in ratio["scale"]),
            "The words for a ratio, as forensic institutes use them",
        ),
        note(f"{ratio['scale_source']}. For a ratio against H1 the same words hold for the other "
             "proposition."),
    ]  # fmt: skip


def _ratios(comparisons: Sequence[dict[str, Any]]) -> Blocks:
    return [
        block
        for one in comparisons
        for block in (
            heading(f"{one['for']} against {one['against']}: {one['verbal']}"),
            paragraph(one["sentence"]),
        )
    ]


def _claim(r: Report) -> Blocks:
    claim = r["claim"]
    if not claim:
        return []
    begin = Markup("{} The recording was said to begin at {}.").format(
        html.badge(claim["verdict"]), unbroken(utc(claim["start_utc"]))
    )
    blocks = [paragraph(begin), paragraph(claim["meaning"])]
    if claim["after_best_time_s"] is not None:
        blocks.append(paragraph(
            f"Claimed start less best time: {claim['after_best_time_s']:+.2f} s. A start within "
            f"{setting(claim['tolerance_s'])} s of a claimed one counts as the same."
        ))  # fmt: skip
    if claim["likelihood_ratios"]:
        blocks += [*_ratios(claim["likelihood_ratios"]), note(texts("recording_time")["claim"])]
    return blocks


def _edits(r: Report) -> Blocks:
    segments = r["result"]["segments"]
    blocks, several = [], len(r["inputs"]["references"]) > 1
    if segments:
        blocks = [
            paragraph(texts("recording_time")["segments"]),
            html.table(
                ["#from (s)", "#to (s)", "begins", "#± (s)", *["reference"] * several, "#lag (s)",
                 "#LR"],
                ([fixed(s["from_s"], 0), fixed(s["to_s"], 0), utc(s["start_utc"]),
                  fixed(s["lag_std_s"]), *[s["grid"]] * several, fixed(s["lag_s"]),
                  power(s["log10_lr"])] for s in segments),
            ),
        ]  # fmt: skip
    return [*blocks, listed(unbroken(e["text"]) for e in r["edits"])] * bool(r["edits"])


def _pictures(r: Report) -> Blocks:
    quality = r["quality"]
    db = known(quality["median_snr_db"], ".1f", unit=" dB")
    return [
        paragraph(r["pictures_left_out"]),
        *map(html.figure, r["drawn"]),
        facts(
            [
                ("values of the ENF", count(quality["values"])),
                ("of use", count(quality["usable_values"])),
                ("standard error of a value, median", mhz(quality["median_std_hz"])),
                ("signal over noise, median", db),
                *((f"of no use: {reason or 'no reason given'}", count(times))
                  for reason, times in quality["unusable_reasons"].items()),
            ],
            "Quality of the signal, in numbers",
        ),
    ]  # fmt: skip


def _candidates(r: Report) -> Blocks:
    found = r["result"]["candidates"]
    several = len(r["inputs"]["references"]) > 1
    if not found:
        return [paragraph(f"There are none: {r['result']['reason']}.")]
    return [
        paragraph(texts("recording_time")["candidates"]),
        html.table(
            ["#rank", "start", *["reference"] * several, "#lag (s)", "#correlation", "#LR",
             "#clock (ppm)", "#used (s)"],
            ([rank, utc(c["start_utc"]), *[c["grid"]] * several, fixed(c["lag_s"]),
              fixed(c["correlation"], 4), power(c["log10_lr"]), ppm(c["clock_ppm"]),
              fixed(c["seconds_used"], 0)] for rank, c in enumerate(found, 1)),
        ),
    ]  # fmt: skip


def _camera(r: Report) -> Blocks:
    found, idle = r["result"], r["idle"]
    clock, assumed = "Nothing is known of it: no time was found to compare it at.", ""
    if found["clock_ppm"] is not None:
        std = fixed(found["clock_std_ppm"], 1)
        clock = texts("recording_time")["clock"].format(ppm=ppm(found["clock_ppm"]), std=std)
        if r["decision"] != "match":
            clock += " As no time was settled on, this is no measurement of the camera."
    if found["idle_ratio"] is not None:
        assumed = (
            f"The comparison was made with an idle ratio of {percent(found['idle_ratio'], 1)}."
        )
    elif not idle:
        assumed = "Not looked for."
    return [heading("Its clock"), paragraph(clock), heading("Its idle ratio"), paragraph(assumed),
            *(_idle(idle) if idle else [])]  # fmt: skip


def _idle(idle: dict[str, Any]) -> Blocks:
    ratio, std, low, high = (
        percent(idle[f"idle_ratio{end}"], 3) for end in ("", "_std", "_low", "_high")
    )
    rate = fixed(idle["frame_rate_hz"], 3)
    template = texts("recording_time")["idle"]
    text = template.format(ratio=ratio, std=std, low=low, high=high, rate=rate)
    if idle["verdict"] != "estimated":
        text = (
            f"Not known ({idle['verdict'].replace('_', ' ')}: {idle['reason']}). The time of "
            "recording doesn't depend on it."
        )
    return [paragraph(text), *(note(f"Mind that: {warning}.") for warning in idle["warnings"])]


def _search(r: Report) -> Blocks:
    search = r["search"]
    found = [
        ("decision", html.plain(r["decision"])),
        ("reason", r["result"]["reason"]),
        ("method", search["method"] or "none"),
        ("starts compared", count(search["starts_compared"])),
        ("usable seconds behind the best", duration(search["seconds_used"])),
        ("correlation there", fixed(r["result"]["correlation"], 4)),
        ("residual there", mhz(search["residual_std_hz"])),
        ("residual expected", mhz(search["expected_std_hz"])),
    ]
    return [facts(found), *map(_searched, r["inputs"]["references"])]


def _searched(ref: dict[str, Any]) -> Markup:
    times = f"{utc(ref['start_utc'])} to {utc(ref['end_utc'])}"
    longest = f", the longest {duration(ref['longest_gap_s'])}" if ref["gaps"] else ""
    length, step = duration(ref["duration_s"]), setting(ref["step_s"])
    counts = f"{count(ref['valid_samples'])} of {count(ref['samples'])} values"
    return facts(
        [
            ("time", times if ref["start_utc"] else "not known: values alone"),
            ("length, step", f"{length}, a value every {step} s"),
            ("coverage", f"{percent(ref['coverage_ratio'], 2)}: {counts}"),
            ("gaps", f"{count(ref['gaps'])}{longest}"),
            ("values given twice", count(ref["duplicates"])),
        ],
        f"Searched: the reference “{ref['grid']}”",
    )


def _inputs(r: Report) -> Blocks:
    inputs = r["inputs"]
    recording, verdict = inputs["recording"], inputs["verdict"]
    return [
        facts(
            [
                ("file", recording["name"]),
                ("size", f"{count(recording['bytes'])} bytes"),
                ("SHA-256", html.digest(recording["sha256"])),
                ("length", duration(recording["seconds"])),
                ("unbroken stretches", count(recording["stretches"])),
                ("frame rate, by the times of its frames",
                 f"{fixed(recording['frame_rate_hz'], 4)} Hz"),
            ],
            "Recording",
        ),
        *([_container(recording["container"])] if recording["container"] else []),
        *map(_reference, inputs["references"]),
        facts(
            [("file", verdict["name"]), ("SHA-256", html.digest(verdict["sha256"]))],
            Markup("Result, as <code>rsenf verify --json</code> prints it"),
        ),
    ]  # fmt: skip


def _container(c: Mapping[str, Any]) -> Markup:
    return facts(
        [
            ("container", c["format"]),
            ("codec, pixels", f"{c['codec']}, {c['pixel_format']}"),
            ("picture", f"{c['width_px']} × {c['height_px']}"),
            ("bit rate", f"{count(c['bit_rate_bps'])} bit/s"),
            ("length", duration(c["duration_s"])),
            ("frame rate declared", f"{fixed(c['declared_rate_hz'], 4)} Hz"),
            ("frame times", _stamps(c)),
            *((name, c[name] or "it doesn't say")
              for name in ("creation_time", "encoder", "make", "model")),
        ],
        "What the recording's file says of itself: anyone could have written it",
    )  # fmt: skip


def _stamps(container: Mapping[str, Any]) -> str:
    if container["rate_basis"]:
        return f"none: they are counted at a rate that is {container['rate_basis']}"
    frames = f"{count(container['stamped_frames'])} frames have one"
    if container["median_s"] is None:
        return frames
    first, usual, last = (
        f"{1e3 * container[f'{n}_s']:.3f}" for n in ("shortest", "median", "longest")
    )
    return f"{frames}; from one to the next {first} to {last} ms, mostly {usual} ms"


def _reference(ref: dict[str, Any]) -> Markup:
    size = [] if ref["bytes"] is None else [("size", f"{count(ref['bytes'])} bytes")]
    return facts(
        [
            ("file", ref["name"]),
            *size,
            ("SHA-256", html.digest(ref["sha256"])),
            ("nominal frequency", f"{setting(ref['nominal_hz'])} Hz"),
            *(("note", text) for text in ref["notes"]),
        ],
        f"Reference “{ref['grid']}”",
    )


def _command(r: Report) -> Blocks:
    if not r["command"]:
        return []
    return [html.verbatim(r["command"]), note(texts("recording_time")["command"])]


def _parameters(r: Report) -> Blocks:
    groups = (
        facts(((name, setting(value)) for name, value in values.items()), group)
        for group, values in r["parameters"].items()
    )
    return [html.columns(groups), facts(r["versions"].items(), "program and machine")]


SECTIONS: tuple[Section[Report], ...] = (
    Section("case", "The case", _case, "Case"),
    Section("evidence", "Weight of the evidence", _evidence),
    Section("claim", "The claim", _claim),
    Section("conditions", "What this is conditioned on",
            lambda r: [listed(map(unbroken, r["conditions"]))], "Conditions"),
    Section("segments", "What seems to have been done to the recording", _edits, "Edits"),
    Section("help", "What would help",
            lambda r: [listed(map(unbroken, r["what_would_help"]))]),
    Section("pictures", "Pictures", _pictures),
    Section("candidates", "Candidates", _candidates),
    Section("camera", "The camera", _camera, "Camera"),
    Section("search", "The search", _search, "Search"),
    Section("warnings", "Warnings",
            lambda r: [listed(r["warnings"]) if r["warnings"] else paragraph("There are none.")]),
    Section("limits", "Known limits of the method",
            lambda r: [listed(r["limits"])], "Limits"),
    Section("inputs", "What this rests on", _inputs, "Inputs"),
    Section("command", "The command, to copy", _command, "Command"),
    Section("parameters", "Parameters in effect, and versions", _parameters, "Parameters"),
    Section("terms", "Terms", lambda r: [html.terms(r["glossary"])]),
)  # fmt: skip

"""Recordings compared with each other in time, as JSON and text."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from rsenf.match.against import Against, Aligned
from rsenf.report.values import error_text, fields_json, lines_text, number, ppm_text

MEANINGS = {
    "match": "made at the same time, in the light of one grid",
    "no_match": "not made at the same time, or not on one grid",
    "no_decision": "can't be told from these recordings",
}
NEXT = "longer recordings, or ones with more usable signal, may help"


AGAINST = (
    "decision", "reason", "offset_s", "offset_std_s", "log10_lr", "log10_lr_other", "clock_ppm",
    "clock_std_ppm", "verbal",
)  # fmt: skip


def against_json(found: Against, warnings: list[str]) -> dict[str, Any]:
    """Return the JSON document of a comparison of two recordings; its keys are stable.

    Parameters
    ----------
    found : Against
    warnings : list of str
        All warnings that a reader should know.
    """
    return fields_json(found, AGAINST) | {"warnings": warnings}


def against_words(found: Against) -> str:
    """Return a comparison of two recordings as a few lines of text."""
    details = [("because", found.reason)]
    if math.isfinite(found.offset_s):
        error = error_text(found.offset_std_s, ".2f")
        before = "after" if found.offset_s >= 0 else "before"
        name = "offset" if found.decision == "match" else "best fit"
        details += [
            (name, f"the first begins {abs(found.offset_s):.2f}{error} s {before} the second"),
            ("likelihood", f"for this offset 10^{found.log10_lr:+.1f} against different times, "
             f"10^{found.log10_lr_other:+.1f} against another offset"),
        ]  # fmt: skip
    if found.decision == "match":
        clock = f"{ppm_text(found.clock_ppm)} ± {found.clock_std_ppm:.1f} ppm"
        details += [("in all", found.verbal), ("clocks", f"the first is faster by {clock}")]
    elif found.decision == "no_decision":
        details.append(("what may help", NEXT))
    return lines_text(f"{found.decision}: {MEANINGS[found.decision]}", details)


MOST_MISFIT = 3.0  # largest deviation of pairs from the common alignment, in standard errors


def aligned_json(names: Sequence[str], found: Aligned, warnings: list[str]) -> dict[str, Any]:
    """Return the JSON document of several recordings aligned in time; its keys are stable.

    Parameters
    ----------
    names : sequence of str
        Names of the recordings.
    found : Aligned
    warnings : list of str
        All warnings that a reader should know.
    """
    apart = [name for name, at in zip(names, found.begin_s, strict=True) if not math.isfinite(at)]
    fits = not found.misfit > MOST_MISFIT
    columns = (found.begin_s, found.begin_std_s, found.clock_ppm, found.clock_std_ppm)
    return {
        "decision": "match" if fits and not apart else "no_decision",
        "reason": f"not placed: {', '.join(apart)}" if apart else ALIGNED if fits else DIFFER,
        "recordings": [
            dict(zip(RECORDING, (name, *map(number, values)), strict=True))
            for name, *values in zip(names, *columns, strict=True)
        ],
        "pairs": [
            {"first": names[i], "second": names[k], **against_json(pair, [])}
            for (i, k), pair in found.pairs.items()
        ],
        "misfit": number(found.misfit),
        "warnings": warnings,
    }


RECORDING = ("recording", "begin_s", "begin_std_s", "clock_ppm", "clock_std_ppm")
ALIGNED = "every one fits the first, or one that does"
DIFFER = "the pairs contradict each other"


def aligned_words(doc: dict[str, Any]) -> str:
    """Return the document of :func:`aligned_json` as text."""
    details = []
    for at, one in enumerate(doc["recordings"]):
        begin_s = one["begin_s"]
        where = "begins at 0" if not at else "can't be placed"
        if at and begin_s is not None:
            where = (
                f"begins {abs(begin_s):.2f} ± {one['begin_std_s']:.2f} s "
                f"{'after' if begin_s >= 0 else 'before'} the first, its clock faster by "
                f"{ppm_text(one['clock_ppm'])} ± {one['clock_std_ppm']:.1f} ppm"
            )
        details.append((one["recording"], where))
    if doc["misfit"] is not None:
        agreement = f"of all pairs: {doc['misfit']:.1f} standard errors (rms)"
        details.append(("agreement", agreement))
    details += [
        ("pair", f"{pair['first']}, {pair['second']}: {pair['decision']}") for pair in doc["pairs"]
    ]
    return lines_text(f"{doc['decision']}: {doc['reason']}", details)

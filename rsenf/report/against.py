"""Recordings compared with each other in time, as JSON and text."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from rsenf.match.against import Against, Aligned
from rsenf.report.verdict import number, ppm_text

MEANINGS = {
    "match": "made at the same time, in the light of one grid",
    "no_match": "not made at the same time, or not on one grid",
    "no_decision": "can't be told from these recordings",
}
NEXT = "longer recordings, or ones with more usable signal, may help"


def against_json(found: Against, warnings: list[str]) -> dict[str, Any]:
    """Return the JSON document of a comparison of two recordings; its keys are stable.

    Parameters
    ----------
    found : Against
    warnings : list of str
        All warnings that a reader should know.
    """
    return {
        "decision": found.decision,
        "reason": found.reason,
        "offset_s": number(found.offset_s),
        "offset_std_s": number(found.offset_std_s),
        "log10_lr": number(found.log10_lr),
        "log10_lr_other": number(found.log10_lr_other),
        "clock_ppm": number(found.clock_ppm),
        "clock_std_ppm": number(found.clock_std_ppm),
        "verbal": found.verbal,
        "warnings": warnings,
    }


def against_words(found: Against) -> str:
    """Return a comparison of two recordings as a few lines of text."""
    lines = [f"{found.decision}: {MEANINGS[found.decision]}", f"  {'because':15} {found.reason}"]
    if math.isfinite(found.offset_s):
        error = f" ± {found.offset_std_s:.2f}" if math.isfinite(found.offset_std_s) else ""
        before = "after" if found.offset_s >= 0 else "before"
        name = "offset" if found.decision == "match" else "best fit"
        lines.append(
            f"  {name:15} the first begins {abs(found.offset_s):.2f}{error} s {before} the second"
        )
        against = f"10^{found.log10_lr:+.1f} against different times"
        other = f"10^{found.log10_lr_other:+.1f} against another offset"
        lines.append(f"  {'likelihood':15} for this offset {against}, {other}")
    if found.decision == "match":
        lines.append(f"  {'in all':15} {found.verbal}")
        lines.append(
            f"  {'clocks':15} the first is faster by {ppm_text(found.clock_ppm)} "
            f"± {found.clock_std_ppm:.1f} ppm"
        )
    elif found.decision == "no_decision":
        lines.append(f"  {'what may help':15} {NEXT}")
    return "\n".join(lines)


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
    lines = [f"{doc['decision']}: {doc['reason']}"]
    for at, one in enumerate(doc["recordings"]):
        begin_s = one["begin_s"]
        where = "begins at 0" if not at else "can't be placed"
        if at and begin_s is not None:
            where = (
                f"begins {abs(begin_s):.2f} ± {one['begin_std_s']:.2f} s "
                f"{'after' if begin_s >= 0 else 'before'} the first, its clock faster by "
                f"{ppm_text(one['clock_ppm'])} ± {one['clock_std_ppm']:.1f} ppm"
            )
        lines.append(f"  {one['recording']:15} {where}")
    if doc["misfit"] is not None:
        lines.append(f"  {'agreement':15} of all pairs: {doc['misfit']:.1f} standard errors (rms)")
    lines += [
        f"  {'pair':15} {pair['first']}, {pair['second']}: {pair['decision']}"
        for pair in doc["pairs"]
    ]
    return "\n".join(lines)

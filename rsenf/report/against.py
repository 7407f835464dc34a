"""Two recordings compared in time, as JSON and in words."""

from __future__ import annotations

import math
from typing import Any

from rsenf.match.against import Against
from rsenf.report.verdict import number, ppm_text

MEANINGS = {
    "match": "made at the same time, in the light of one grid",
    "no_match": "not made at the same time, or not on one grid",
    "no_decision": "can't be told from these recordings",
}
NEXT = "longer recordings, or ones with more usable signal, may help"


def against_json(found: Against, warnings: list[str]) -> dict[str, Any]:
    """Return the stable keys of a comparison."""
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
    """Say a comparison to a person, in a few lines."""
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

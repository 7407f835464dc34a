"""An idle estimate, and a comparison of two, as JSON and text."""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING, Any

from rsenf.messages import IdleEstimate
from rsenf.report.verdict import number

if TYPE_CHECKING:
    from rsenf.idle.compare import Comparison

DIRECTIONS = {
    "forward": "forward: top to bottom, or left to right",
    "reverse": "reverse: bottom to top, or right to left",
    "": "not told apart",
}
MEANINGS = {
    "estimated": "the camera reads no row during this share of each frame",
    "ambiguous": "more than one answer fits the recording, so none is given",
    "no_signal": "no flicker of mains light was found",
    "refused": "there is flicker, but this recording can't bear an answer",
}
COMPARED = {
    "different": "the read-out times differ: two cameras, or two modes of one",
    "compatible": "the read-out times agree, which proves nothing",
    "undecidable": "the read-out times neither agree nor differ clearly, or one is unknown",
}


def idle_json(estimate: IdleEstimate, warnings: list[str]) -> dict[str, Any]:
    """Return the JSON document of an idle estimate; its keys are stable.

    Parameters
    ----------
    estimate : IdleEstimate
    warnings : list of str
        All warnings that a reader should know, including the estimate's own.
    """
    return {
        "verdict": estimate.verdict,
        "method": estimate.method,
        "idle_ratio": number(estimate.idle_ratio),
        "idle_ratio_std": number(estimate.idle_ratio_std),
        "idle_ratio_low": number(estimate.idle_ratio_low),
        "idle_ratio_high": number(estimate.idle_ratio_high),
        "read_out_time_s": number(estimate.read_out_time_s),
        "read_out_time_std_s": number(estimate.read_out_time_std_s),
        "direction": estimate.direction or None,
        "frame_rate_hz": number(estimate.frame_rate_hz),
        "nominal_hz": number(estimate.nominal_hz),
        "converted": estimate.converted,
        "slips": estimate.slips,
        "reason": estimate.reason or None,
        "warnings": warnings,
        "rate_hypotheses": [dataclasses.asdict(h) for h in estimate.rate_hypotheses],
    }


def idle_words(estimate: IdleEstimate) -> str:
    """Return an idle estimate as a few lines of text."""
    lines = [f"{estimate.verdict}: {estimate.reason or _value(estimate)}"]
    return "\n".join([*lines, *(f"  {name:15} {text}" for name, text in _details(estimate))])


def _value(estimate: IdleEstimate) -> str:
    percent, error = 100 * estimate.idle_ratio, 100 * estimate.idle_ratio_std
    digits = decimals(error)
    return f"{percent:.{digits}f} ± {error:.{digits}f} % of each frame is idle"


def _details(estimate: IdleEstimate) -> list[tuple[str, str]]:
    details = []
    if estimate.verdict == "estimated":
        low, high = 100 * estimate.idle_ratio_low, 100 * estimate.idle_ratio_high
        digits = decimals(100 * estimate.idle_ratio_std)
        read_ms, error_ms = 1e3 * estimate.read_out_time_s, 1e3 * estimate.read_out_time_std_s
        places = decimals(error_ms)
        details = [
            ("95 % interval", f"{low:.{digits}f} to {high:.{digits}f} %"),
            ("read-out time", f"{read_ms:.{places}f} ± {error_ms:.{places}f} ms"),
            ("direction", DIRECTIONS[estimate.direction]),
        ]
    if math.isfinite(estimate.nominal_hz):
        details.append(("grid", f"{estimate.nominal_hz:.0f} Hz"))
    if math.isfinite(estimate.frame_rate_hz):
        details.append(("frame rate", f"{estimate.frame_rate_hz:.3f} frames/s"))
    return [*details, ("what it means", MEANINGS[estimate.verdict])]


def decimals(error: float) -> int:
    """Return the number of decimals that show two digits of an error; from 1 to 5.

    >>> decimals(0.012), decimals(3.4), decimals(float("nan"))
    (3, 1, 2)
    """
    if not (math.isfinite(error) and error > 0):
        return 2
    return min(max(1 - math.floor(math.log10(error)), 1), 5)


def comparison_json(found: Comparison) -> dict[str, Any]:
    """Return the JSON document of a comparison of two read-out times; its keys are stable."""
    return {
        "log10_lr_same_readout": number(found.log10_lr_same_readout),
        "verdict": found.verdict,
        "caveats": list(found.caveats),
    }


def comparison_words(found: Comparison) -> str:
    """Return a comparison of two read-out times as text."""
    lines = [f"{found.verdict}: {COMPARED[found.verdict]}"]
    if math.isfinite(found.log10_lr_same_readout):
        ratio = f"10^{found.log10_lr_same_readout:+.1f}"
        lines.append(f"  likelihood      {ratio}, for one read-out time against two cameras'")
    return "\n".join([*lines, *(f"  mind that       {caveat}" for caveat in found.caveats)])

"""What is told of a camera, as JSON and text: its idle period, and which known camera it is.

Covers an idle estimate, the comparison of two, and the cameras of a store.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from rsenf.idle import compare
from rsenf.match.search import verbal
from rsenf.messages import IdleEstimate
from rsenf.report import values

IDLE = (
    "verdict", "method", "idle_ratio", "idle_ratio_std", "idle_ratio_low", "idle_ratio_high",
    "read_out_time_s", "read_out_time_std_s", "direction", "frame_rate_hz", "nominal_hz",
    "converted", "slips", "reason",
)  # fmt: skip


def idle_json(estimate: IdleEstimate, warnings: Sequence[str] | None = None) -> dict[str, Any]:
    """Return the JSON document of an idle estimate; its keys are stable.

    Parameters
    ----------
    estimate : IdleEstimate
    warnings : sequence of str, optional
        All warnings that a reader should know, including the estimate's own; by default only those.
    """
    return values.fields_json(estimate, IDLE) | {
        "direction": estimate.direction or None,
        "reason": estimate.reason or None,
        "warnings": list(estimate.warnings if warnings is None else warnings),
        "rate_hypotheses": [dataclasses.asdict(h) for h in estimate.rate_hypotheses],
    }


def idle_words(estimate: IdleEstimate) -> str:
    """Return an idle estimate as a few lines of text."""
    value = values.with_error(estimate.idle_ratio, estimate.idle_ratio_std, 100.0)
    head = estimate.reason or f"{value} % of each frame is idle"
    return values.lines_text(f"{estimate.verdict}: {head}", _details(estimate))


def _details(estimate: IdleEstimate) -> list[tuple[str, str]]:
    details = []
    if estimate.verdict == "estimated":
        low, high = 100 * estimate.idle_ratio_low, 100 * estimate.idle_ratio_high
        digits = values.decimals(100 * estimate.idle_ratio_std)
        details = [
            ("95 % interval", f"{low:.{digits}f} to {high:.{digits}f} %"),
            ("read-out time", _read_out(values.fields_json(estimate, IDLE))),
            ("direction", values.texts("camera")["directions"][estimate.direction]),
        ]
    if math.isfinite(estimate.nominal_hz):
        details.append(("grid", f"{estimate.nominal_hz:.0f} Hz"))
    if math.isfinite(estimate.frame_rate_hz):
        details.append(("frame rate", f"{estimate.frame_rate_hz:.3f} frames/s"))
    return [*details, ("what it means", values.texts("camera")["meanings"][estimate.verdict])]


def comparison_json(found: compare.Comparison) -> dict[str, Any]:
    """Return the JSON document of a comparison of two read-out times; its keys are stable."""
    return {
        "log10_lr_same_readout": values.number(found.log10_lr_same_readout),
        "verdict": found.verdict,
        "caveats": list(found.caveats),
    }


def comparison_words(found: compare.Comparison) -> str:
    """Return a comparison of two read-out times as text."""
    details = [("mind that", caveat) for caveat in found.caveats]
    if math.isfinite(found.log10_lr_same_readout):
        ratio = f"10^{found.log10_lr_same_readout:+.1f}"
        details.insert(0, ("likelihood", f"{ratio}, for one read-out time against two cameras'"))
    return values.lines_text(
        f"{found.verdict}: {values.texts('camera')['compared'][found.verdict]}", details
    )


PROVES_NOTHING = "compatible proves nothing"
TURNED = "was read in the other direction: a camera turned over?"


def mode_json(mode: compare.Mode) -> dict[str, Any]:
    """Return a mode as plain data; None for what is unknown."""
    return {name: value or None for name, value in dataclasses.asdict(mode).items()}


def known_json(known: compare.Known) -> dict[str, Any]:
    """Return what is known of a camera in one mode, as plain data."""
    time_s, std_s = known.read_out
    clocks = [r.clock_ppm for r in known.readings if r.clock_ppm is not None]
    return {
        "name": known.name,
        **mode_json(known.mode),
        "direction": "/".join(sorted(known.directions)) or None,
        "read_out_time_s": time_s,
        "read_out_time_std_s": std_s,
        "scatter_s": known.scatter_s,
        "clock_ppm": float(np.median(clocks)) if clocks else None,
        "recordings": [r.recording for r in known.readings],
    }


def cameras_words(store: str, known: Sequence[compare.Known]) -> str:
    """Return the known cameras as text."""
    if not known:
        return f"no camera is known in {store}; rsenf camera add NAME FILE adds one"
    lines = []
    for doc in map(known_json, known):
        more = [_recordings(doc), doc["direction"]]
        if doc["clock_ppm"] is not None:
            more.append(f"clock {values.ppm_text(doc['clock_ppm'])} ppm")
        known_of = ("read-out time", f"{_read_out(doc)}; {', '.join(filter(None, more))}")
        lines.append(values.lines_text(f"{doc['name']}: {_mode(doc)}", [known_of]))
    return "\n".join(lines)


def identification_json(
    reading: compare.ReadOutTime | None,
    why_none: str,
    weighed: Sequence[tuple[compare.Known, float]],
    known_in: Sequence[str],
    same_model_ratio: float,
) -> dict[str, Any]:
    """Return the JSON document of the identification of a recording's camera.

    Parameters
    ----------
    reading : Reading or None
        The recording's read-out time; None if there is none.
    why_none : str
        Why there is none.
    weighed : sequence of (Known, float)
        Known cameras in its mode with their log10 likelihood ratios, the likeliest first.
    known_in : sequence of str
        Cameras in whose stored recordings this one is included.
    same_model_ratio : float
        Share of the other cameras that are of the same model.
    """
    cameras = [
        known_json(camera)
        | {
            "log10_lr": ratio,
            "verbal": verbal(ratio, "this camera"),
            "verdict": compare.verdict_of(ratio),
        }
        for camera, ratio in weighed
    ]
    said = [camera["verdict"] for camera in cameras]
    caveats = [f"it is one of {name}'s own recordings, and was left out there" for name in known_in]
    if "compatible" in said:
        caveats.append(compare.EQUAL_PROVES_NOTHING)
    directions = {reading.direction} if reading and reading.direction else set()
    caveats += [
        f"{known.name} {TURNED}"
        for known, _ in weighed
        if directions and known.directions and not directions <= known.directions
    ]
    verdict = "different" if set(said) == {"different"} else "undecidable"
    reason = f"no read-out time: {why_none}" if reading is None else None
    if reading and not weighed:
        reason = f"no camera is known in this recording's mode; {compare.MODE}"
    return {
        "verdict": "compatible" if "compatible" in said else verdict,
        "reason": reason,
        "mode": mode_json(reading.mode) if reading else None,
        "read_out_time_s": reading.read_out_time_s if reading else None,
        "read_out_time_std_s": reading.read_out_time_std_s if reading else None,
        "cameras": cameras,
        "log10_odds": compare.log10_odds([ratio for _, ratio in weighed]) if weighed else None,
        "same_model_ratio": same_model_ratio,
        "prior": f"{100 * same_model_ratio:g} % of those about are of the same model; "
        f"{compare.PRIOR}",
        "caveats": caveats,
    }


def identification_words(doc: dict[str, Any]) -> str:
    """Return the document of :func:`identification_json` as text."""
    cameras = doc["cameras"]
    said = [camera["verdict"] for camera in cameras]
    heads = {
        "compatible": f"{said.count('compatible')} of {len(said)} known in this mode may have "
        "taken it, and so may others of the model",
        "different": f"none of the {len(said)} known in this mode has its read-out time",
        "undecidable": doc["reason"] or "the read-out times neither agree nor differ clearly",
    }
    details = []
    if doc["mode"]:
        details.append(("this recording", f"{_read_out(doc)}; {_mode(doc['mode'])}"))
    for camera in cameras:
        ratio = camera["log10_lr"]
        weak = f"; {PROVES_NOTHING}" if 0.0 < ratio < compare.WEAK_LOG10_LR else ""
        details += [
            (camera["name"], f"10^{ratio:+.1f}, {camera['verbal']}{weak}"),
            ("", f"{_read_out(camera)}; {_recordings(camera)}"),
        ]
    if cameras:
        details += [
            ("against", f"another of those about: {doc['prior']}"),
            ("odds", f"10^{doc['log10_odds']:+.1f} for {cameras[0]['name']} against all others, "
             "were it as likely one of these as not"),
        ]  # fmt: skip
    details += [("mind that", caveat) for caveat in doc["caveats"]]
    return values.lines_text(f"{doc['verdict']}: {heads[doc['verdict']]}", details)


def _read_out(doc: dict[str, Any]) -> str:
    return f"{values.with_error(doc['read_out_time_s'], doc['read_out_time_std_s'], 1e3)} ms"


def _mode(doc: dict[str, Any]) -> str:
    across = f" of {doc['across_px']} pixels" if doc["across_px"] else ""
    crop = f", {doc['crop']}" if doc["crop"] else ""
    return f"{doc['frame_rate_hz']:.3f} frames/s, {doc['lines']} lines{across}{crop}"


def _recordings(doc: dict[str, Any]) -> str:
    count = len(doc["recordings"])
    return f"{count} recording{'s' * (count != 1)}"

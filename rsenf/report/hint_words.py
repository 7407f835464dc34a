"""Hints on the nature of an unexplained residual, as text."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

KINDS = {
    "other_readout": "hardly anything fits: a read-out, or a light, unlike the model's",
    "single_lines": "every line on its own: neighbouring rows are wrong in opposite ways",
    "event": "something that happened at one time",
    "tone": "light, gain or motion at a steady frequency",
    "fast_tone": "light at a steady frequency: a lamp's driver, a screen, another supply",
    "level": "it follows the level: a tone curve or clipping",
    "waveform": "the shape of the flicker: a lamp's waveform or a tone curve",
    "flicker": "at the flicker's own frequency: a second lamp, or another shutter",
    "gain": "the brightness of whole frames",
    "timing": "the time at which whole frames see the light",
    "flicker_size": "the size of the flicker, frame by frame",
    "frame_by_frame": "whole frames at random: timing or gain",
    "rows": "some rows only",
    "strips": "not alike on all sides of the picture",
    "clock_drift": "a clock that drifts, the camera's or the reference's",
    "lag_step": "a leap of time: frames lost or repeated, or a cut",
    "wander": "a frame rate that wanders, or a reference that does",
    "other_course": "camera and reference move apart otherwise than by a clock's error",
    "unknown": "of no kind that is known here",
}
FEW = 4  # frequencies or times that are listed


def kind_words(residual: dict[str, Any]) -> str:
    """Return the possible kinds of an unexplained residual as text.

    Parameters
    ----------
    residual : dict
        ``unexplained`` of :func:`rsenf.discrepancy.discovery_json`.
    """
    words = [KINDS[residual["kind"]], *(KINDS[kind] for kind in residual["also"])]
    if residual["at_s"]:
        words[0] += f", {_some(residual['at_s'], '.1f')} s after the start"
    if residual["period_frames"]:
        words[0] += f", coming again after {residual['period_frames']} frames"
    if residual["slow"] is not None:
        words[0] += ", wandering slowly" if residual["slow"] else ", at random from frame to frame"
    if residual["rows"]:
        first, last = residual["rows"]
        words[words.index(KINDS["rows"])] += f" ({first:.0f} to {last:.0f})"
    return "; ".join(words)


def tone_words(residual: dict[str, Any]) -> str:
    """Return the frequencies that a tone with this alias may have, as text; '' without a tone."""
    if "alias_hz" not in residual:
        return ""
    alias = f"the frames show {residual['alias_hz']:.2f} Hz"
    likely = _some(residual["likely_hz"], ".1f", " or ")
    by_rows = f", which down the rows looks like {likely} Hz" if likely else ""
    others = residual["may_be_hz"]
    return (
        f"{alias}{by_rows}; by the frames alone it may be any of {len(others)} frequencies up to "
        f"{others[-1]:.0f} Hz ({_some(others, '.1f')})"
    )


def _some(values: Sequence[float], how: str, between: str = ", ") -> str:
    text = between.join(f"{value:{how}}" for value in values[:FEW])
    return f"{text} …" if len(values) > FEW else text

"""The report's pictures, with their captions and alternative texts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from rsenf.match.series import Track, track_of, without_jumps
from rsenf.messages import EnfEstimate, MatchResult
from rsenf.report.panels import (
    ALONG,
    HEIGHT_IN,
    INK,
    MARK,
    SIGNAL,
    Panel,
    annotate,
    fixed_style,
    picture_of,
    say_nothing,
)
from rsenf.report.picture import curve_of, draw_enf, draw_spectrogram
from rsenf.report.recording_time.words import Basis
from rsenf.report.score_curve import NEAR_S, ScoreCurve, draw_near, draw_score
from rsenf.report.values import texts
from rsenf.timebase import utc_text

WIDE = 10.0  # ratio of the largest to the smallest error from which the scale is logarithmic


def _draw_quality(
    estimates: Sequence[EnfEstimate], error_axes: Any, snr_axes: Any, use_axes: Any
) -> None:
    """Draw standard error, signal-to-noise ratio, and usability of each second."""
    error_axes.set_title("Quality of the signal over time")
    if not estimates:
        for axes in (error_axes, snr_axes, use_axes):
            say_nothing(axes, "no estimate: too short")
        return
    t_s = np.array([e.t_s for e in estimates])
    usable = np.array([e.usable for e in estimates])
    std_mhz = 1e3 * np.array([e.enf_std_hz for e in estimates])
    snr_db = np.array([e.snr_db for e in estimates])
    _dots(error_axes, t_s, std_mhz, usable)
    if np.nanmax(std_mhz, initial=0.0) > WIDE * np.nanmin(std_mhz, initial=np.inf) > 0:
        error_axes.set_yscale("log")
        error_axes.yaxis.set_major_formatter("{x:g}")
    error_axes.set_ylabel("standard error\n(mHz)")
    _dots(snr_axes, t_s, snr_db, usable)
    snr_axes.set_ylabel("signal over\nnoise (dB)")
    half_s = float(np.median(np.diff(t_s))) / 2 if t_s.size > 1 else 0.5
    for flag, colour, label in ((True, SIGNAL, "of use"), (False, MARK, "of no use")):
        spans = [(t - half_s, 2 * half_s) for t in t_s[usable == flag]]
        # At different heights, so that they are not distinguished by colour only.
        use_axes.broken_barh(spans, (0.55 if flag else 0.0, 0.45), color=colour, lw=0)
        at = (1.0, 0.775 if flag else 0.225)
        annotate(use_axes, label, at, (4, 0), colour, xycoords="axes fraction", va="center")
    use_axes.set_ylim(0.0, 1.0)
    use_axes.set_yticks([])
    use_axes.set_ylabel("seconds", rotation=0, ha="right", va="center")
    use_axes.set_xlim(max(float(t_s[0]) - half_s, 0.0), float(t_s[-1]) + half_s)
    use_axes.set_xlabel("time in the recording (s)")


def _dots(axes: Any, t_s: Any, values: Any, usable: Any) -> None:
    """Draw a value for each second: dots, and crosses for unusable seconds."""
    if not np.isfinite(values).any():
        axes.text(0.5, 0.5, "not known", ha="center", va="center", transform=axes.transAxes,
                  color=INK)  # fmt: skip
        axes.set_yticks([])
        return
    axes.plot(t_s[usable], values[usable], ".", color=SIGNAL, ms=4)
    axes.plot(t_s[~usable], values[~usable], "x", color=MARK, ms=4)


def _draw_timeline(axes: Any, result: MatchResult) -> None:
    """Draw the segments of an edited recording over its time, and the edits.

    A segment's height is the offset of its start from that of one unedited piece with the first.
    """
    axes.set_title("What fits, stretch by stretch")
    segments = result.segments
    first_s = segments[0].lag_s - segments[0].from_s
    for one in segments:
        later_s = one.lag_s - one.from_s - first_s
        axes.plot([one.from_s, one.to_s], [later_s] * 2, color=SIGNAL, lw=6, solid_capstyle="butt")
        start = utc_text(one.start_utc_ns) or f"{one.lag_s:.1f} s"
        annotate(axes, f"{start}, LR 10^{one.log10_lr:.1f}", (one.from_s, later_s), (0, 7), INK)
    for edit in result.edits:
        if not math.isfinite(edit.at_s):
            continue
        axes.axvline(edit.at_s, color=MARK, lw=1, ls="--")
        if edit.at_std_s > 0.0:
            axes.axvspan(
                edit.at_s - edit.at_std_s, edit.at_s + edit.at_std_s, color=MARK, alpha=0.12, lw=0
            )
        annotate(axes, edit.kind, (edit.at_s, 0.0), (3, 3), MARK, xycoords=ALONG)
    axes.margins(y=0.3)
    axes.set_xlim(0.0, max(one.to_s for one in segments))
    axes.set_xlabel("time in the recording (s)")
    axes.set_ylabel("later than as\none piece (s)")


def draw_pictures(case: Basis) -> list[Panel]:
    """Draw all pictures that have data; the same case gives the same bytes."""
    result, grid = case.result, case.grid
    track = without_jumps(track_of(case.estimates))[0] if case.estimates else None
    t0_ns = grid.t0_ns if grid else 0
    curve = curve_of(track, grid, case.settings, result)
    drawn, captions = [], texts("recording_time")["captions"]

    def add(*what: Any, high: float = 1.0) -> None:
        drawn.append(picture_of(*what, height_in=high * HEIGHT_IN))

    with fixed_style():
        if track is not None and track.usable:
            add(
                "enf.png", "The recording over the reference",
                lambda f: draw_enf(f.subplots(), track, grid, result),
                _enf_caption(case), _enf_alt(case, track),
            )  # fmt: skip
        if result.segments:
            spans = ", ".join(f"{one.from_s:.0f} to {one.to_s:.0f} s" for one in result.segments)
            add(
                "timeline.png", "What fits, stretch by stretch",
                lambda f: _draw_timeline(f.subplots(), result), captions["timeline"],
                f"Timeline of {len(result.segments)} stretches, {spans}; "
                f"{len(result.edits)} edits.",
            )  # fmt: skip
        if not curve.is_empty:
            add(
                "score.png", "How well each time fits: the whole search",
                lambda f: draw_score(f.subplots(), curve, t0_ns, result),
                _score_caption(case, curve), _score_alt(case, curve),
            )  # fmt: skip
        if np.isfinite(curve.near).any():
            add(
                "score_near.png", "How well each time fits: around the best",
                lambda f: draw_near(f.subplots(), curve, t0_ns, result),
                captions["near"].format(near_s=NEAR_S),
                f"Line chart of {curve.name} within {NEAR_S:g} s of the best time, from "
                f"{np.nanmin(curve.near):.4g} to {np.nanmax(curve.near):.4g}; the best is in the "
                "middle.",
            )  # fmt: skip
        if case.estimates:
            used = f"{sum(e.usable for e in case.estimates)} of {len(case.estimates)} values"
            add(
                "quality.png", "Quality of the signal over time",
                lambda f: _draw_quality(
                    case.estimates, *f.subplots(3, 1, sharex=True, height_ratios=(3, 3, 1))
                ),
                captions["quality"],
                "Three charts over time: standard error, signal over noise, and use; "
                f"{used} are of use.", high=1.4,
            )  # fmt: skip
        if math.isfinite(case.spectrum.frame_rate_hz):
            lasts = f"{case.spectrum.seconds:.0f} s"
            add(
                "spectrogram.png", "The flicker itself",
                lambda f: draw_spectrogram(f.subplots(), case.spectrum, case.estimates),
                captions["spectrogram"],
                f"Spectrogram of the flicker over {lasts}, up to 240 Hz at most.",
            )  # fmt: skip
    return drawn


def left_out(case: Basis) -> str:
    """Return why there are no pictures of the comparison; empty if there are."""
    if math.isfinite(case.result.lag_s):
        return ""
    return f"There are no pictures of the comparison, as there was none: {case.result.reason}."


def _enf_caption(case: Basis) -> str:
    result, captions = case.result, texts("recording_time")["captions"]
    recorded, grids = captions["enf"], captions["enf_reference"]
    if not math.isfinite(result.lag_s):
        return f"{recorded}It was compared with nothing: {result.reason}."
    if result.decision == "match":
        return f"{recorded}{grids}Where the two run together, the light followed the grid."
    return f"{recorded}{grids}This is the best that could be found; it is not enough to count."


def _enf_alt(case: Basis, track: Track) -> str:
    low, high = float(np.nanmin(track.enf_hz)), float(np.nanmax(track.enf_hz))
    alt = (
        f"Line chart of the recording's network frequency, {low:.3f} to {high:.3f} Hz over "
        f"{track.enf_hz.size * track.hop_s:.0f} s"
    )
    residual_hz = case.result.residual_std_hz
    if math.isfinite(residual_hz):
        alt += f", over the reference's; they differ by {1e3 * residual_hz:.2f} mHz rms"
    return f"{alt}."


def _score_caption(case: Basis, curve: ScoreCurve) -> str:
    captions = texts("recording_time")["captions"]
    text = str(captions["score"]).format(name=curve.name, unit=curve.unit)
    if len(case.references) > 1:
        text = f"Of the reference “{case.result.grid}”, which holds the best time. {text}"
    if case.result.decision == "match":
        return text + "It stands out from the others."
    return text + f"It does not settle the matter: {case.result.reason}."


def _score_alt(case: Basis, curve: ScoreCurve) -> str:
    hours = case.grid.duration_s / 3600 if case.grid else 0.0
    return (
        f"Line chart of {curve.name} against start time over {hours:.3g} hours of reference; "
        f"the best is {case.result.lag_s:.2f} s after its start, at {np.nanmax(curve.high):.4g}."
    )

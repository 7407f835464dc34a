"""Probes a camera or a file: what it sends, whether its light can be used, what to change on it."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, field
from threading import Event
from typing import Any

import numpy as np

from rsenf.api.shared import Progress, Result, row_settings, silent
from rsenf.api.track import track_result
from rsenf.errors import SourceLost
from rsenf.flicker.acquire import NO_FLICKER
from rsenf.flicker.frame_rate import COMMON_HZ
from rsenf.flicker.lines import alias_hz
from rsenf.flicker.mains import FAINT
from rsenf.flicker.regular_clock import MIN_JITTER_S, MOST_ALIKE, MOST_OFF, RegularClock
from rsenf.flicker.slow_time import usual_gap_ns
from rsenf.idle import IdleSettings
from rsenf.idle.estimator_state import STILL_HZ
from rsenf.messages import Frame, RateBasis, VideoPacket
from rsenf.report.values import number
from rsenf.run.inline import Analysis, analyse
from rsenf.run.live_input import LiveInput
from rsenf.timebase import NS_PER_S
from rsenf.track import TrackSettings

MOST_MISSING = 0.02  # share of frames; with more the rate is no constant one
LEAST_FRAMES = 30
CLEAR_HZ = 4.5  # between the light's alias and 0 Hz, or half the frame rate, for a rate to advise
# Below, idle periods from H.264 aren't validated: 150 kbit/s at 720p.
LEAST_BPS_PER_PX = 150e3 / (1280 * 720)
LEAST_S = 5.0  # of stream, for the flicker's absence to mean anything


@dataclass
class _Seen:
    """What passed by: time stamps of the frames, and bits of the packets."""

    pts_ns: list[int] = field(default_factory=list)
    coded_bytes: int = 0

    def note(self, item: Any) -> None:
        if isinstance(item, Frame):
            self.pts_ns.append(item.header.pts_ns)
        elif isinstance(item, VideoPacket):
            self.coded_bytes += len(item.data)


class _Looked(LiveInput):
    """A source that may break off: what was seen until then counts."""

    broke = ""

    def messages(self) -> Any:
        begun = False
        try:
            for frame in super().messages():
                begun = True
                yield frame
        except SourceLost as exc:
            if not begun:
                raise
            self.broke = exc.message

    @property
    def loss(self) -> str:
        return "; ".join(filter(None, [super().loss, self.broke]))


def probe(
    url: str,
    *,
    seconds: float = 10.0,
    nominal_hz: float | None = None,
    stop: Event | None = None,
    progress: Progress = silent,
) -> ProbeResult:
    """Look at a camera or a file for some seconds.

    Parameters
    ----------
    url : str
        Address of a camera, or a path.
    seconds : float
        Time to look, on the stream's clock.
    nominal_hz : float, optional
        50 or 60; found from the data when not given.
    stop : Event, optional
        Ends it early.
    progress : callable, optional
        Called with the seconds that are done.

    Raises
    ------
    SourceLost, InputError, UsageError
        When it can't be opened, or sends no picture.
    """
    seen = _Seen()
    source = _Looked(
        url, stop or Event(), silent, seconds=seconds, on_item=seen.note, effort="full"
    )
    tracked = TrackSettings(nominal_hz=nominal_hz)
    analysis = analyse(
        source,
        rows=row_settings(None, tracked),
        track=tracked,
        idle=IdleSettings(nominal_hz=nominal_hz),
        progress=progress,
    )
    if not seen.pts_ns:
        raise SourceLost(f"{source.name}: stopped before its first picture", "look for longer")
    info, lasted_s = source.info, analysis.seconds
    stamps, rate_hz, jitter_s, missing = _stamps(np.array(seen.pts_ns), info.rate_basis)
    flicker, reason = _flicker(analysis, nominal_hz)
    usable = [e for e in analysis.estimates if e.usable]
    found_hz = analysis.idle.nominal_hz if analysis.idle.verdict == "estimated" else math.nan
    grid_hz = usable[-1].nominal_hz if usable else found_hz
    coded_bps = 8 * seen.coded_bytes / lasted_s if seen.coded_bytes and lasted_s else math.nan
    notes = track_result(source.name, analysis, nominal_hz).warnings
    result = ProbeResult(
        recording=source.name,
        analysis=analysis,
        codec=info.codec,
        width_px=info.width_px,
        height_px=info.height_px,
        declared_rate_hz=number(info.declared_rate_hz or math.nan),
        frame_rate_hz=number(rate_hz),
        bit_rate_bps=number(coded_bps),
        frames=len(seen.pts_ns),
        seconds=lasted_s,
        stamps=stamps,
        jitter_ms=number(1e3 * jitter_s),
        frames_missing=missing,
        flicker=flicker,
        reason=reason,
        nominal_hz=number(grid_hz if flicker == "seen" else nominal_hz or math.nan),
        snr_db=number(usable[-1].snr_db if usable else math.nan),
        advice=[],
        warnings=notes if flicker == "seen" else [],
    )
    of_each = _of_exposure, _of_rate, _of_stamps, _of_bits  # the most important first
    result.advice.extend(filter(None, (advice_of(result) for advice_of in of_each)))
    return result


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class ProbeResult(Result):
    """What a source sends, and whether its light can be used.

    Attributes
    ----------
    codec : str
    width_px, height_px : int
    declared_rate_hz, frame_rate_hz : float or None
        As the stream says, and as its time stamps are.
    bit_rate_bps : float or None
        Of the compressed pictures.
    frames : int
    seconds : float
        From the first frame to the last.
    stamps : {'steady', 'jittering', 'irregular', 'none', 'cannot_tell'}
        'jittering': frames are even, their stamps are not; 'irregular': neither is.
    jitter_ms : float or None
        Rms of the stamps about even times.
    frames_missing : int
        By gaps between stamps.
    flicker : {'seen', 'swallowed', 'not_seen', 'cannot_tell'}
        'swallowed': a remainder is seen, as an exposure of whole periods leaves it. 'cannot_tell':
        what is seen may be light or not, or can't be judged.
    reason : str
        Why it isn't seen; '' if it is.
    nominal_hz : float or None
        Of the grid.
    snr_db : float or None
    advice : list of str
        What to change on the camera, one line each.
    warnings : list of str
    """

    codec: str
    width_px: int
    height_px: int
    declared_rate_hz: float | None
    frame_rate_hz: float | None
    bit_rate_bps: float | None
    frames: int
    seconds: float
    stamps: str
    jitter_ms: float | None
    frames_missing: int
    flicker: str
    reason: str
    nominal_hz: float | None
    snr_db: float | None
    advice: list[str]
    warnings: list[str]

    def to_dict(self) -> dict[str, Any]:
        """Return plain values, with what could not be read as ``loss``."""
        return {"source": self.recording, **super().to_dict(), "loss": self.loss}

    def __str__(self) -> str:
        declared = f", {self.declared_rate_hz:.6g} declared" if self.declared_rate_hz else ""
        measured = f"{self.frame_rate_hz:.3f}" if self.frame_rate_hz else "unknown"
        rate = f", {self.bit_rate_bps / 1e3:.0f} kbit/s" if self.bit_rate_bps else ""
        jitter = f" ({self.jitter_ms:.2f} ms rms)" if self.jitter_ms is not None else ""
        missing = f", {self.frames_missing} frames missing" if self.frames_missing else ""
        snr = f", {self.snr_db:.0f} dB" if self.snr_db is not None else ""
        grid = f" of a {self.nominal_hz:.0f} Hz grid{snr}" if self.flicker == "seen" else ""
        lines = [
            f"{self.recording}: {self.codec}, {self.width_px}x{self.height_px}{rate}",
            f"  frame rate  {measured} frames/s{declared}; {self.frames} in {self.seconds:.1f} s",
            f"  stamps      {self.stamps.replace('_', ' ')}{jitter}{missing}",
            f"  flicker     {_FLICKER[self.flicker]}{grid}"
            + (f": {self.reason}" if self.reason else ""),
        ]
        return "\n".join([*lines, *(f"  change      {line}" for line in self.advice)])


_FLICKER = {
    "seen": "seen", "swallowed": "swallowed", "not_seen": "not seen", "cannot_tell": "can't tell",
}  # fmt: skip


def _stamps(pts_ns: Any, basis: RateBasis) -> tuple[str, float, float, int]:
    """Judge stamps; return verdict, frame rate (Hz), jitter (s, rms), and how many are missing."""
    if basis is not RateBasis.STAMPED:
        return "none", math.nan, math.nan, 0
    usual_ns = usual_gap_ns(pts_ns)
    if pts_ns.size < LEAST_FRAMES or not usual_ns:
        return "cannot_tell", 1e9 / usual_ns if usual_ns else math.nan, math.nan, 0
    steps = np.maximum(np.rint(np.diff(pts_ns) / usual_ns).astype(np.int64), 1)
    missing = int((steps - 1).sum())
    clock = RegularClock(np.append(0, np.cumsum(steps)), (pts_ns - pts_ns[0]) / NS_PER_S)
    jitters = clock.jitter_s > MIN_JITTER_S
    uneven = missing > MOST_MISSING * pts_ns.size or clock.most_off > MOST_OFF
    verdict = "jittering" if jitters else "steady"
    if uneven or (jitters and clock.alike > MOST_ALIKE):
        verdict = "irregular"
    return verdict, clock.frame_rate_hz, clock.jitter_s, missing


def _still_hz(rate_hz: float | None, nominal_hz: float | None) -> list[float]:
    """Return the grids whose light nearly stands still at a frame rate."""
    grids = [nominal_hz] if nominal_hz else [50.0, 60.0]
    return [hz for hz in grids if rate_hz and abs(alias_hz(2.0 * hz, rate_hz)) < STILL_HZ]


def _flicker(analysis: Analysis, nominal_hz: float | None) -> tuple[str, str]:
    """Say whether the light's flicker is in the rows, and why not."""
    if any(e.usable for e in analysis.estimates) or analysis.idle.verdict == "estimated":
        return "seen", ""
    reasons = Counter(e.reason for e in analysis.estimates)
    reasons += Counter({why: 1 for why, _ in analysis.row_reasons.most_common(1) if why})
    why = reasons.most_common(1)[0][0] if reasons else analysis.idle.reason
    if analysis.seconds < LEAST_S:
        return "cannot_tell", f"{analysis.seconds:.1f} s are too short"
    if 2 * reasons[FAINT] > reasons.total():
        return "swallowed", FAINT
    if _still_hz(analysis.frame_rate_hz, nominal_hz):
        text = "light nearly stands still at this frame rate, and moves too little"
        return "cannot_tell", f"{text} in {analysis.seconds:.0f} s"
    if 2 * (reasons[NO_FLICKER] + reasons[FAINT]) > reasons.total():
        return "not_seen", "the exposure swallows it, or no lamp on the mains is in view"
    return "cannot_tell", why or "too short to tell"


def _of_exposure(found: ProbeResult) -> str:
    if found.flicker not in ("swallowed", "not_seen"):
        return ""
    periods = f"1/{2 * found.nominal_hz:.0f} s" if found.nominal_hz else "1/100 s (1/120)"
    return (
        f"the exposure: shorter than {periods} and no multiple of it, such as 1/250 s; "
        "anti-flicker off, or set for the other grid; a lamp on the mains in view"
    )


def _of_rate(found: ProbeResult) -> str:
    rate_hz = found.frame_rate_hz
    still = _still_hz(rate_hz, found.nominal_hz)
    if not still or rate_hz is None:
        return ""

    def clear_hz(rate_hz: float) -> float:
        off_hz = abs(alias_hz(2.0 * still[0], rate_hz))
        return min(off_hz, rate_hz / 2.0 - off_hz)

    others = [hz for hz in COMMON_HZ if hz == round(hz) and clear_hz(hz) >= CLEAR_HZ]
    better_hz = min(others, key=lambda hz: abs(hz - rate_hz))
    return (
        f"the frame rate: at {rate_hz:.5g} frames/s the light of a {still[0]:.0f} Hz grid stands "
        f"still; set {better_hz:.0f}"
    )


def _of_stamps(found: ProbeResult) -> str:
    if found.stamps == "none":
        return "the protocol: no frame times are sent; use RTSP"
    if found.stamps != "irregular":
        return ""
    return "the frame rate: set a constant one; no 'smart' codec, no slow shutter at night"


def _of_bits(found: ProbeResult) -> str:
    bits, pixels = found.bit_rate_bps, found.width_px * found.height_px
    if bits is None or bits >= LEAST_BPS_PER_PX * pixels:
        return ""
    return (
        f"the bit rate: {bits / 1e3:.0f} kbit/s may hide the flicker at this size; well above "
        f"{1e-3 * LEAST_BPS_PER_PX * pixels:.0f}"
    )

"""Conditions under which no idle ratio is reported, whatever the method.

One is drifting weighted prediction (:class:`Sawtooth`): an encoder that predicts each frame as the
one before it times a factor (H.264's weighted prediction) may follow the flicker with the factor
and not return. The picture's brightness ramps by tens of levels until the next key frame resets it,
and row levels depend more on the encoder than on the light.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rsenf.flicker import acquire, mains
from rsenf.flicker.lines import alias_hz
from rsenf.flicker.rate_conversion import BLENDED, DOUBTFUL
from rsenf.idle.estimator_state import EstimatorState, Finding
from rsenf.idle.moments import orders, row_tones

Float = NDArray[np.float64]


# Phasors with a longer mean have turned by less than about a radian: at a span of ``s`` radians the
# mean of ``exp(jψ)`` is ``sinc(s/2)``.
MAX_STILL_RATIO = 0.96
# With fewer turns every row sees the same light: half a millisecond of read-out.
MIN_TURNS = 0.05
# Few turns require proof: an encoder that copies rows downwards leaves just such a ramp, and
# scatters the rows' phases far more than noise. With fewer turns the error has to be this small.
FEW_TURNS, FEW_STD_RATIO = 0.5, 1e-3
MAX_STD_RATIO = 0.035  # standard error of the idle ratio
# A mixture of lamps with several phases turns down the rows as well: at worst by some three times
# the phase's deviation from one ramp across the picture. One lamp's deviates by less than 0.007
# turns; with an alias at 0 Hz it is known less well.
MIXED, ONE_TURNS, ONE_STILL_TURNS = 3.0, 0.007, 0.03
# Bands in which the second harmonic's phase is compared with the first's, standard errors of a
# difference, and the ramp's error over it (rms over mixtures); larger ones aren't light.
HARMONIC_BANDS, HARMONIC_STDS, HARMONIC_SHARE = 8, 8.0, 0.6
MOST_HARMONIC_RAD = 2.0
# With an alias at 0 Hz: residual over white noise from which several lamps may mix, and unexplained
# share above which it has other causes.
MIXED_NOISE, MOST_LEFT = 5.0, 0.01
# Of the frame period: an estimated read-out may exceed it by this, a true one can't.
SLACK_RATIO = 0.02
# Least share of the rows' tones that adds up along the ramp.
MIN_COHERENCE = 0.6
# Least phase between even and odd rows of two fields, in rad and in standard errors; bands for the
# latter.
LEAST_FIELD_RAD, FIELD_STDS, FIELD_BANDS = 0.1, 6.0, 24
# Two grids whose aliases differ by less look alike.
ALIKE_HZ = 1.0

SEVERAL = "light of several phases: its mixture's change down the rows can't be told from read-out"
INTERLACED = "interlaced: even rows and odd ones are of different times"
CROP = "a crop, as by electronic image stabilisation, counts as idle"
CHANGES = (
    "the read-out changes along the recording (idle {:.1f} to {:.1f} %): a digital zoom, or a cut "
    "to another camera"
)
JITTERS = "the time stamps jitter by {:.1f} ms (rms): frames are taken to be even"


def refused(reason: str) -> Finding:
    """Return a refusal."""
    return Finding(verdict="refused", reason=reason)


NO_FLICKER = Finding(verdict="no_signal", reason=acquire.NO_FLICKER)
TOO_SHORT = Finding(verdict="no_signal", reason="too short to tell")
STILL = Finding(
    verdict="ambiguous",
    reason="the flicker stands still from frame to frame, and its phase turned by less than about "
    "a radian: it can't be told from the picture's texture",
)
WEAK = refused(mains.FAINT)
REMADE = tuple(map(refused, (BLENDED, DOUBTFUL)))
NO_ROWS = refused("one mean for the whole frame: the rows are needed")
SAWTOOTH = refused(
    "the brightness ramps and is reset at key frames: weighted prediction of the encoder, not light"
)
GLOBAL = refused(
    "all rows show the same phase: a global shutter, a very short read-out, or a codec that copies "
    "rows downwards"
)
NO_RAMP = refused("the rows' phases don't lie on one ramp")
SECOND = refused(mains.SECOND)
TOO_LONG = refused("by the rows' phases a frame would take longer to read than it lasts")


def checked(seen: EstimatorState, finding: Finding) -> Finding:
    """Return the finding, with a larger error for mixed light, or a refusal to report it.

    Parameters
    ----------
    seen : EstimatorState
    finding : Finding
    """
    if finding.verdict != "estimated":
        return finding
    if not seen.stands_still and mains.is_second_harmonic(
        seen.f0_hz, seen.nominal_hz, seen.frame_rate_hz, finding.turns
    ):
        return SECOND
    mixed_turns = np.hypot(MIXED * _apart_turns(seen), _bent_turns(seen, finding.turns))
    if mixed_turns > 0.0:
        turns_var = finding.turns_var + mixed_turns**2
        finding = replace(finding, turns_var=turns_var, warnings=(*finding.warnings, SEVERAL))
    std_ratio = finding.read_out_std_s * seen.frame_rate_hz
    if not std_ratio <= MAX_STD_RATIO:
        return refused(
            f"too uncertain, ±{100 * std_ratio:.1f} points: the codec has gone too far, or "
            "there is too little light or time"
        )
    if abs(finding.turns) < max(MIN_TURNS, 2.0 * finding.read_out_std_s * finding.f0_hz):
        return GLOBAL
    if abs(finding.turns) < FEW_TURNS and std_ratio > FEW_STD_RATIO:
        return GLOBAL
    if finding.read_out_s * seen.frame_rate_hz - 1.0 > max(SLACK_RATIO, 3.0 * std_ratio):
        return TOO_LONG
    return finding


def woven_fields(seen: EstimatorState) -> Finding | None:
    """Refuse interlaced pictures, by the phase between even and odd rows.

    With progressive read-out a row's phase is halfway between its neighbours'. Interlaced fields
    are half a frame apart; if that is a whole number of the light's periods nothing shows.
    """
    if seen.stands_still or hardly_turned(seen):
        return None
    tone, _ = row_tones(seen.moments)
    odd = tone[1:-1:2]
    even = tone[: 2 * odd.size : 2] + tone[2 : 2 * odd.size + 1 : 2]
    parts = [part.sum() for part in np.array_split(odd * even.conj(), FIELD_BANDS)]
    mean = sum(parts)
    offset_rad = float(np.angle(mean))
    away = np.array(parts) * np.exp(-1j * offset_rad)
    std_rad = float(np.sqrt(np.sum(away.imag**2)) / np.abs(mean)) if mean else np.inf
    if not abs(offset_rad) > max(LEAST_FIELD_RAD, FIELD_STDS * std_rad):
        return None
    half_rad = np.pi * seen.f0_hz / seen.frame_rate_hz
    off = [abs(np.angle(np.exp(1j * (offset_rad - sign * half_rad)))) for sign in (1, -1)]
    first = "top" if off[0] < off[1] else "bottom"
    whose = f", {first} field first" if min(off) < 0.5 * max(off) else ""
    return refused(f"{INTERLACED}{whose}: separate the fields, or deinterlace, then try again")


def _apart_turns(seen: EstimatorState) -> float:
    """Deviation of the light's phase from one ramp, if larger than one lamp's; else 0."""
    light = seen.still_rows.light
    if seen.stands_still:
        return light.apart_turns if light and light.apart_turns > ONE_STILL_TURNS else 0.0
    return seen.apart_turns if seen.apart_turns > ONE_TURNS else 0.0


def _bent_turns(seen: EstimatorState, turns: float) -> float:
    """Error of the ramp by lamps of several phases that strips don't show; 0 without a sign of it.

    Down the rows their mixture turns its second harmonic by another angle than twice the first's.
    With an alias at 0 Hz it leaves a residual beyond noise, and its amplitude varies: a relative
    change of amplitude may come with a phase change of as many radians.
    """
    if seen.stands_still:
        fit = seen.still_rows.told_apart()
        if fit is None or fit.noise_ratio < MIXED_NOISE:
            return 0.0
        unexplained = 1.0 - fit.explained if 1.0 - fit.explained < MOST_LEFT else 0.0
        return float(np.hypot(np.abs(fit.share).sum() / np.pi, np.sqrt(max(unexplained, 0.0))))
    if seen.moments.harmonics() < 2:
        return 0.0
    every = np.append(orders(seen.moments.harmonics()), 0)
    found = np.linalg.solve(seen.moments.gram(every), seen.moments.response(every))
    place = (np.arange(found.shape[1]) + 0.5) / found.shape[1]
    second = found[every == 2][0] * np.exp(-4j * np.pi * turns * place)
    bands = np.array_split(second, HARMONIC_BANDS)
    phase = np.unwrap([float(np.angle(band.sum())) for band in bands])
    (slope, _), cov = np.polyfit(np.linspace(0.0, 1.0, HARMONIC_BANDS), phase, 1, cov=True)
    if not HARMONIC_STDS * np.sqrt(cov[0, 0]) < abs(slope) < MOST_HARMONIC_RAD:
        return 0.0  # noise, or motion at twice the light's frequency
    return HARMONIC_SHARE * float(abs(slope)) / (2.0 * np.pi)


def is_weak(seen: EstimatorState, flicker_ratio: float) -> bool:
    """Whether flicker may be what an exposure of whole periods leaves of a strong lamp's."""
    return mains.is_faint(flicker_ratio, seen.f0_hz, seen.nominal_hz)


def hardly_turned(seen: EstimatorState) -> bool:
    """Whether the tracked flicker hardly turned from frame to frame, so that texture hides it."""
    return seen.moments.still_ratio() > MAX_STILL_RATIO


def look_alike(frame_rate_hz: float) -> Finding:
    """Return the finding that the frame rate can't distinguish the two grids."""
    return Finding(
        verdict="ambiguous",
        reason=f"at {frame_rate_hz:.4g} frames/s light on 50 and on 60 Hz looks alike: give the "
        "nominal frequency",
    )


def are_alike(frame_rate_hz: float) -> bool:
    """Whether 100 and 120 Hz have the same alias, or mirror images of each other.

    >>> are_alike(20.0), are_alike(25.0)
    (True, False)
    """
    gaps = (120.0 - 100.0, 120.0 + 100.0)
    return any(abs(alias_hz(gap, frame_rate_hz)) < ALIKE_HZ for gap in gaps)


RESET_LEVEL = 8.0  # least step of the frame's mean at a reset: light doesn't jump like that
OVER_USUAL = 6.0  # and its least ratio to the mean step
WARM_UP = 25  # steps before any is judged
MIN_RESETS = 2
MIN_RETURN = 0.5  # least share of the resets that ramps compensate


class Sawtooth:
    """Watches the frame means of a stream."""

    def __init__(self) -> None:
        self._last = float("nan")
        self._steps, self._travelled = 0, 0.0
        self._up, self._down = 0, 0
        self._jumped, self._drifted = 0.0, 0.0

    def add(self, mean_level: Float) -> None:
        """Add frame means, in order."""
        for level in mean_level.tolist():
            step = level - self._last
            self._last = level
            if math.isfinite(step):
                self._take(step)

    def _take(self, step: float) -> None:
        usual = self._travelled / max(self._steps, 1)
        self._steps += 1
        self._travelled += abs(step)
        if abs(step) > RESET_LEVEL and self._steps > WARM_UP and abs(step) > OVER_USUAL * usual:
            self._up, self._down = self._up + (step > 0), self._down + (step < 0)
            self._jumped += step
        else:
            self._drifted += step

    @property
    def found(self) -> bool:
        """Whether ramps of one sign compensate resets of the other."""
        resets = max(self._up, self._down)
        return (
            resets >= MIN_RESETS
            and resets >= 3 * min(self._up, self._down)
            and -self._drifted * np.sign(self._jumped) > MIN_RETURN * abs(self._jumped)
        )

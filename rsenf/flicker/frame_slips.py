"""Detects lost and repeated frames that the time stamps don't show.

Model: ``s`` frames lost between two others advance the light's phase by ``s`` frame periods from
there on, and repeated frames set it back: by hundreds of times a frame's phase noise at most rates.

Statistic: a generalised likelihood ratio at every frame, of a phase jump by ``s`` periods against
none, from the mean phasors of a few frames before and after.

Approximate: noise is white, the phase otherwise smooth over those frames. Where a frame period
holds a whole number of flicker periods the phase doesn't jump, and only the frame count suffers.

References
----------
Willsky, A. S. and Jones, H. L. (1976), A generalized likelihood ratio approach to the detection and
estimation of jumps in linear systems, IEEE Trans. Automatic Control 21.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]
Complex = NDArray[np.complex128]

# Frames compared before and after a place: few suffice where the flicker is strong.
HALVES = (4, 16)
MOST = 3  # frames lost or repeated at one place
# Least log likelihood ratio of a slip. Noise reaches it with a probability of e⁻³⁰ at each of a
# hundred thousand frames, slips and lengths in an hour: 1e-8 an hour if Gaussian.
LEAST_LOG_RATIO = 30.0
# Smaller phase jumps (rad) aren't clear: a grid may make them within some frames.
LEAST_LEAP_RAD = 0.3
# Tolerance of a jump from a whole number of periods: standard errors, plus rad.
OFF_STDS, OFF_RAD = 4.0, 0.2
# Small jumps: least size (rad) and relative tolerance. They count only since the size fits exactly.
LEAST_STEP_RAD, OFF_RATIO = 5e-3, 0.15
LEAST_STEP_LOG_RATIO = 18.0  # there are a hundred places and six sizes in half a minute
# Variance above which a single frame shows nothing: low bit rates repeat arbitrary parts.
CLEAR_VAR = 0.01
MOST_AT_ONCE = 8  # places in one window: more are no accident
# Largest deviation of a frame from its neighbours as a copy of the last, relative to that without.
STALE_RATIO = 0.6
# Amplitude of the flicker on both sides relative to the window's, and share of the window in which
# it must be in this range: where light comes and goes, its phase is meaningless.
SIZES, STEADY_RATIO = (0.5, 1.6), 0.8
# Two frames are equal if their mean square difference is below this share of what noise causes.
EQUAL_RATIO = 0.2
NAMED = 12  # places listed in words
LEAST_VAR = 1e-6  # of a frame's phasor: rounding, and errors of any model of the light


@dataclass(frozen=True)
class FrameSlip:
    """Frames lost or repeated at one place.

    Attributes
    ----------
    frame_number : int
        First frame after the gap, or the first repeated one.
    frames : int
        Number of lost frames; negative for repeated ones. If ``k`` frame periods hold nearly a
        whole number of flicker periods, it is known modulo ``k`` only: then it is the smallest
        number, of repeated frames where the frame equals the one before, else of lost ones.
    """

    frame_number: int
    frames: int


def find_slips(
    light: Complex, step_rad: float, equal: NDArray[np.bool_], first: int = 0, apart: int = 1
) -> list[tuple[int, int]]:
    """Find all clear phase jumps by lost or repeated frames, in order (Willsky and Jones 1976).

    Parameters
    ----------
    light : ndarray of complex, shape (frames,)
        Each frame's flicker relative to a smooth phase course, of roughly constant amplitude.
    step_rad : float
        Phase advance of the light in a frame period.
    equal : ndarray of bool, shape (frames,)
        Whether a frame equals the one before, noise included.
    first : int
        First frame to search.
    apart : int
        Least number of frames between two places.

    Returns
    -------
    list of tuple of int
        The frame, and the number of frames lost before it; negative for repeated ones.
    """
    slips = np.array([s for s in range(-MOST, MOST + 1) if s])
    leap = np.angle(np.exp(1j * slips * step_rad))
    detectable = np.abs(leap) > LEAST_LEAP_RAD
    slips, leap = slips[detectable], leap[detectable]
    if not slips.size or np.abs(np.diff(light)).max(initial=0.0) < LEAST_LEAP_RAD / 2.0:
        return []
    half = HALVES[-1]
    sizes = np.abs(light[: light.size // half * half].reshape(-1, half).mean(axis=1))
    # A fit that jumps have bent underestimates the flicker's amplitude.
    usual = float(np.median(sizes)) if sizes.size else 0.0
    if not (usual > 0.0 and np.mean(_is_usual(sizes / usual)) >= STEADY_RATIO):
        return []
    found: list[tuple[int, int]] = []
    light, free = light / usual, np.arange(light.size) >= first
    while len(found) < MOST_AT_ONCE:
        one = _likeliest(light, slips, leap, equal, free)
        if one is None:
            break
        found.append(one)
        light[one[0] :] *= np.exp(-1j * one[1] * step_rad)
        beside = max(apart, MOST)  # else frames might be repeated before their originals
        free[max(one[0] + 1 - beside, 0) : one[0] + beside] = False
    in_place = _in_place(light, step_rad, equal & free) if 1 in slips else []
    # Near a frame said to be repeated a picture must equal its neighbour. Else something that
    # passes the light has turned its phase.
    shown = all(k > 0 or equal[max(at - MOST, 0) : at + MOST].any() for at, k in found)
    if len(found) + len(in_place) > MOST_AT_ONCE or not shown:
        return []
    return sorted([*found, *((at + k, (-1, 1)[k]) for at in in_place for k in (0, 1))])


def leaps(residual_rad: Float, covariance: Float, step_rad: Float) -> list[tuple[int, int, Float]]:
    """Find where a phase leaps by whole steps, of its residual from a smooth course.

    The same ratio of likelihoods, of phases whose errors are correlated: those of bins of light
    that hardly turns, where a step is less than a frame's own noise. A leap lies within a bin,
    which shows any part of it.

    Parameters
    ----------
    residual_rad : ndarray, shape (bins,)
        Phase less its expected course.
    covariance : ndarray, shape (bins, bins)
        Of its errors and of what that course may be off.
    step_rad : ndarray, shape (bins,)
        By how much the light's phase turns in a frame period, around each bin.

    Returns
    -------
    list of tuple
        The bin, how many frames are lost in it (negative for those shown again), and by how much
        they turn the phase of each bin, shape (bins,).
    """
    weight = np.linalg.inv(covariance)
    diagonal = weight.diagonal()
    after = np.triu(weight, 1).sum(axis=1)  # of each bin with those after it
    later = np.cumsum(np.cumsum(weight[::-1, ::-1], axis=0), axis=1).diagonal()[::-1]
    known = np.append(later[1:], 0.0) - after**2 / diagonal  # whatever the bin itself shows
    known = np.maximum(known, 1e-12)
    slips = np.array([s for s in range(-MOST, MOST + 1) if s])
    leap = slips[:, None] * step_rad
    found: list[tuple[int, int, Float]] = []
    residual_rad, free = residual_rad.copy(), np.arange(residual_rad.size) > 0
    while len(found) < MOST_AT_ONCE:
        pull = weight @ residual_rad
        tail = np.append(np.cumsum(pull[::-1])[::-1][1:], 0.0)
        score = tail - after * pull / diagonal
        at = int(np.argmax(score**2 / known * free))  # whatever its size
        log_ratio = leap[:, at] * score[at] - leap[:, at] ** 2 * known[at] / 2.0
        which = int(np.argmax(log_ratio))
        size = float(leap[which, at])
        off_rad = abs(score[at] / known[at] - size)
        is_whole = off_rad < OFF_STDS / np.sqrt(known[at]) + OFF_RATIO * abs(size)
        if log_ratio[which] < LEAST_LOG_RATIO or not is_whole:
            break
        turned = np.where(np.arange(residual_rad.size) > at, size, 0.0)
        turned[at] = size * np.clip((pull[at] - after[at] * size) / diagonal[at] / size, 0.0, 1.0)
        found.append((at, int(slips[which]), turned))
        residual_rad = residual_rad - turned
        free[max(at - 1, 0) : at + 2] = False
    return sorted(found, key=lambda one: one[0])


def _is_usual(size: Float) -> NDArray[np.bool_]:
    return (size > SIZES[0]) & (size < SIZES[1])


def _in_place(light: Complex, step_rad: float, equal: NDArray[np.bool_]) -> list[int]:
    """Find frames that repeat the last one instead of the next, by their light."""
    if _noise_var(light) > CLEAR_VAR:
        return []
    beside = 0.5 * (light[2:] + light[:-2])
    deviation, again = light[1:-1] - beside, light[1:-1] * np.exp(1j * step_rad) - beside
    stale = (np.abs(again) < STALE_RATIO * np.abs(deviation)) & _is_usual(np.abs(beside))
    return list((1 + np.flatnonzero(equal[1:-1] & stale)).tolist())


def _likeliest(
    light: Complex,
    slips: NDArray[np.int64],
    leap: Float,
    equal: NDArray[np.bool_],
    free: NDArray[np.bool_],
) -> tuple[int, int] | None:
    """Find the slip of largest likelihood ratio, if it exceeds the threshold."""
    total = np.concatenate([[0.0], np.cumsum(light)])
    noise_var = _noise_var(light)
    best, at, frames = LEAST_LOG_RATIO, -1, 0
    for half in HALVES:
        place = np.arange(half, light.size - half + 1)
        if place.size == 0:
            continue
        before = (total[place] - total[place - half]) / half
        after = (total[place + half] - total[place]) / half
        apart = np.abs(after - before) ** 2
        var = max(noise_var, half * float(np.median(apart)) / (4.0 * np.log(2.0)), LEAST_VAR)
        looked = (
            np.append(free, False)[place] & _is_usual(np.abs(before)) & _is_usual(np.abs(after))
        )
        before, after, place = before[looked], after[looked], place[looked]
        if place.size == 0:
            continue
        off = np.abs(np.angle((after * before.conj())[:, None] * np.exp(-1j * leap)))
        slack = OFF_RAD + OFF_STDS * np.sqrt(2.0 * var / half)
        ahead = np.abs(before[:, None] + after[:, None] * np.exp(-1j * leap))
        gain = np.where(off <= slack, ahead - np.abs(before + after)[:, None], 0.0) * half / var
        i, j = np.unravel_index(int(gain.argmax()), gain.shape)
        if gain[i, j] > best:
            best, at = float(gain[i, j]), _placed(total, int(place[i]), float(leap[j]))
            nearly = slips[off[i] <= off[i].min() + slack].tolist()
            frames = min(nearly, key=lambda s: ((s < 0) != bool(equal[at]), abs(s)))
    return (at, frames) if frames else None


def _noise_var(light: Complex) -> float:
    """Variance of a frame's real (or imaginary) part, from differences of neighbours."""
    return float(np.median(np.abs(np.diff(light)) ** 2) / (4.0 * np.log(2.0)))


def _placed(total: Complex, at: int, leap: float) -> int:
    """Refine the place of a jump, by the few frames around it."""
    half, reach = HALVES[0], HALVES[-1]
    place = np.arange(max(at - reach, half), min(at + reach, total.size - 1 - half) + 1)
    before, after = total[place] - total[place - half], total[place + half] - total[place]
    gain = np.abs(before + after * np.exp(-1j * leap)) - np.abs(before + after)
    return int(place[gain.argmax()])


def frames_of_step(step: float, std: float, step_rad: float) -> int:
    """Return the number of frames lost at a small phase step (negative: repeated).

    0 if none fits; clear jumps are for :func:`find_slips`.

    Parameters
    ----------
    step, std : float
        Phase step and its standard error (rad).
    step_rad : float
        Phase advance of the light in a frame period.

    Examples
    --------
    >>> frames_of_step(-0.121, 0.002, 0.06)
    -2
    """
    slips = np.array([s for s in range(-MOST, MOST + 1) if s])
    leap = np.angle(np.exp(1j * slips * step_rad))
    off = np.abs(leap - step)
    small = (np.abs(leap) > LEAST_STEP_RAD) & (np.abs(leap) < LEAST_LEAP_RAD)
    fits = small & (off < OFF_RATIO * np.abs(leap) + OFF_STDS * std)
    return int(slips[fits][off[fits].argmin()]) if fits.any() else 0


def are_equal(columns: Float, noise_var: Float) -> NDArray[np.bool_]:
    """Whether each frame equals the one before, noise included, shape (frames,).

    Parameters
    ----------
    columns : ndarray, shape (frames, columns)
        Reduced profiles.
    noise_var : ndarray, shape (columns,)
        Noise variance of a frame in each column.
    """
    apart = np.sum(np.diff(columns, axis=0) ** 2, axis=1)
    return np.concatenate([[False], apart < EQUAL_RATIO * 2.0 * np.sum(noise_var)])


def late_s(slips: list[tuple[int, int]], frames: int, period_s: float) -> Float:
    """Return how much later frames were taken than their stamps say, shape (frames,).

    A repeated frame is as old as the one before it.

    Parameters
    ----------
    slips : list of tuple of int
        As of :func:`find_slips`.
    frames : int
    period_s : float
        Frame period.

    Examples
    --------
    >>> late_s([(2, 1)], 4, 0.04).tolist()
    [0.0, 0.0, 0.04, 0.04]
    """
    late = np.zeros(frames)
    for at, lost in slips:
        for k in range(abs(lost)):
            late[at + (k if lost < 0 else 0) :] += period_s if lost > 0 else -period_s
    return late


def slip_words(slips: Sequence[FrameSlip], camera_hz: float | None = None) -> list[str]:
    """Describe in words what was corrected.

    Parameters
    ----------
    slips : sequence of FrameSlip
    camera_hz : float, optional
        Original frame rate, if the recording was converted.
    """
    out = []
    if camera_hz:
        out.append(
            f"frames were dropped or doubled to convert the rate from {camera_hz:.6g} frames/s: "
            "what is said is of the original"
        )
    for sign, what in ((1, "lost before"), (-1, "shown again at")):
        of_sign = sorted((s for s in slips if s.frames * sign > 0), key=lambda s: s.frame_number)
        if of_sign:
            places = [
                f"{s.frame_number}" + (f" ({abs(s.frames)})" if abs(s.frames) > 1 else "")
                for s in of_sign[:NAMED]
            ]
            more = ", …" if len(of_sign) > NAMED else ""
            count = sum(abs(s.frames) for s in of_sign)
            out.append(
                f"frames {what} frame {', '.join(places)}{more}, {count} in all, though the time "
                "stamps are silent: by the light's phase; bridged"
            )
    return out

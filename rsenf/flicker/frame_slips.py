"""Frames that were lost or shown twice without their time stamps telling.

``s`` frames lost between two others turn the light's phase by ``s`` frame periods' worth from
there on, and frames that are shown again turn it back: by hundreds of times a frame's own phase
noise at most frame rates. So at every frame the phase of a few frames before is compared with
that of a few after, by a generalised likelihood ratio (A. S. Willsky and H. L. Jones, "A
generalized likelihood ratio approach to the detection and estimation of jumps in linear systems",
IEEE Trans. Automatic Control 21, 1976) of the leap by ``s`` periods against none. Where a period
holds a whole number of the flicker's, nothing leaps, and nothing is lost but the count.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]
Complex = NDArray[np.complex128]

# Frames before and after a place that are compared: few are enough where the flicker is strong.
HALVES = (4, 16)
MOST = 3  # frames lost or shown again at one place
# Natural logarithm of the likelihood ratio that a slip takes. Noise reaches it with a chance of
# e⁻³⁰ at each of a hundred thousand frames, slips and lengths an hour: 1e-8 an hour if Gaussian.
LEAST_LOG_RATIO = 30.0
# A leap by less than this isn't clear: grids make the like in some frames (rad).
LEAST_LEAP_RAD = 0.3
# By which a leap may be off a whole number of periods: standard errors, and rad.
OFF_STDS, OFF_RAD = 4.0, 0.2
# Of small leaps the least (rad), and the share that they may be off: one might be anything's, were
# it not so exactly that size.
LEAST_STEP_RAD, OFF_RATIO = 5e-3, 0.15
LEAST_STEP_LOG_RATIO = 18.0  # there are a hundred places and six sizes in half a minute
# Variance beyond which a single frame says nothing: coding weakly repeats what it likes.
CLEAR_VAR = 0.01
MOST_AT_ONCE = 8  # places in one stretch: more is no accident
# What is left of a frame's distance from its neighbours, once it is taken for a copy of the last.
STALE_RATIO = 0.6
# Size of the flicker on both sides, relative to the stretch's, and share of the stretch in which it
# has to be so: where light comes and goes, its phase is anything.
SIZES, STEADY_RATIO = (0.5, 1.6), 0.8
# Two frames are equal where they differ by so little of the mean square that noise accounts for.
EQUAL_RATIO = 0.2
NAMED = 12  # places that are named in words
LEAST_VAR = 1e-6  # of a frame's phasor: rounding, and what no model of the light says


@dataclass(frozen=True)
class FrameSlip:
    """Frames lost, or shown again, at one place.

    Attributes
    ----------
    frame_number : int
        The first frame after the place, or the first that is shown again.
    frames : int
        How many are lost; negative for those shown again. Where ``k`` periods of the frames hold
        nearly a whole number of the flicker's, it is known up to whole multiples of ``k`` only:
        then frames that equal the one before were shown again, and the fewest are counted.
    """

    frame_number: int
    frames: int


def find_slips(
    light: Complex, step_rad: float, equal: NDArray[np.bool_], first: int = 0, apart: int = 1
) -> list[tuple[int, int]]:
    """Find all places where frames slip and the phase leaps clearly, in order.

    Parameters
    ----------
    light : ndarray of complex, shape (frames,)
        Each frame's flicker relative to a smooth course of its phase, of about the same size.
    step_rad : float
        By how much the light's phase turns in a frame period.
    equal : ndarray of bool, shape (frames,)
        Whether a frame is equal to the one before, noise and all.
    first : int
        First frame at which to look.
    apart : int
        Least number of frames from one place to another.

    Returns
    -------
    list of tuple of int
        The frame, and how many are lost before it; negative for those shown again.
    """
    slips = np.array([s for s in range(-MOST, MOST + 1) if s])
    leap = np.angle(np.exp(1j * slips * step_rad))
    told = np.abs(leap) > LEAST_LEAP_RAD
    slips, leap = slips[told], leap[told]
    if not slips.size or np.abs(np.diff(light)).max(initial=0.0) < LEAST_LEAP_RAD / 2.0:
        return []
    half = HALVES[-1]
    sizes = np.abs(light[: light.size // half * half].reshape(-1, half).mean(axis=1))
    # A fit that leaps have bent takes the flicker for smaller than it is.
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
        beside = max(apart, MOST)  # else frames might be shown again before those they are of
        free[max(one[0] + 1 - beside, 0) : one[0] + beside] = False
    in_place = _in_place(light, step_rad, equal & free) if 1 in slips else []
    if len(found) + len(in_place) > MOST_AT_ONCE:
        return []
    return sorted([*found, *((at + k, (-1, 1)[k]) for at in in_place for k in (0, 1))])


def leaps(left_rad: Float, covariance: Float, step_rad: Float) -> list[tuple[int, int, Float]]:
    """Find where a phase leaps by whole steps, of what is left of it beside a smooth course.

    The same ratio of likelihoods, of phases whose errors are correlated: those of bins of light
    that hardly turns, where a step is less than a frame's own noise. A leap lies within a bin,
    which shows any part of it.

    Parameters
    ----------
    left_rad : ndarray, shape (bins,)
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
    own = weight.diagonal()
    after = np.triu(weight, 1).sum(axis=1)  # of each bin with those after it
    later = np.cumsum(np.cumsum(weight[::-1, ::-1], axis=0), axis=1).diagonal()[::-1]
    known = np.append(later[1:], 0.0) - after**2 / own  # whatever the bin itself shows
    known = np.maximum(known, 1e-12)
    slips = np.array([s for s in range(-MOST, MOST + 1) if s])
    leap = slips[:, None] * step_rad
    found: list[tuple[int, int, Float]] = []
    left_rad, free = left_rad.copy(), np.arange(left_rad.size) > 0
    while len(found) < MOST_AT_ONCE:
        pull = weight @ left_rad
        tail = np.append(np.cumsum(pull[::-1])[::-1][1:], 0.0)
        told = tail - after * pull / own
        at = int(np.argmax(told**2 / known * free))  # whatever its size
        log_ratio = leap[:, at] * told[at] - leap[:, at] ** 2 * known[at] / 2.0
        which = int(np.argmax(log_ratio))
        size = float(leap[which, at])
        off_rad = abs(told[at] / known[at] - size)
        is_whole = off_rad < OFF_STDS / np.sqrt(known[at]) + OFF_RATIO * abs(size)
        if log_ratio[which] < LEAST_LOG_RATIO or not is_whole:
            break
        turned = np.where(np.arange(left_rad.size) > at, size, 0.0)
        turned[at] = size * np.clip((pull[at] - after[at] * size) / own[at] / size, 0.0, 1.0)
        found.append((at, int(slips[which]), turned))
        left_rad = left_rad - turned
        free[max(at - 1, 0) : at + 2] = False
    return sorted(found, key=lambda one: one[0])


def _is_usual(size: Float) -> NDArray[np.bool_]:
    return (size > SIZES[0]) & (size < SIZES[1])


def _in_place(light: Complex, step_rad: float, equal: NDArray[np.bool_]) -> list[int]:
    """Find frames that are shown again in the place of the next: they show the last one's light."""
    if _own_var(light) > CLEAR_VAR:
        return []
    beside = 0.5 * (light[2:] + light[:-2])
    own, again = light[1:-1] - beside, light[1:-1] * np.exp(1j * step_rad) - beside
    stale = (np.abs(again) < STALE_RATIO * np.abs(own)) & _is_usual(np.abs(beside))
    return list((1 + np.flatnonzero(equal[1:-1] & stale)).tolist())


def _likeliest(
    light: Complex,
    slips: NDArray[np.int64],
    leap: Float,
    equal: NDArray[np.bool_],
    free: NDArray[np.bool_],
) -> tuple[int, int] | None:
    """Find the likeliest slip, if any is likely enough."""
    total = np.concatenate([[0.0], np.cumsum(light)])
    own_var = _own_var(light)
    best, at, frames = LEAST_LOG_RATIO, -1, 0
    for half in HALVES:
        place = np.arange(half, light.size - half + 1)
        if place.size == 0:
            continue
        before = (total[place] - total[place - half]) / half
        after = (total[place + half] - total[place]) / half
        apart = np.abs(after - before) ** 2
        var = max(own_var, half * float(np.median(apart)) / (4.0 * np.log(2.0)), LEAST_VAR)
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


def _own_var(light: Complex) -> float:
    """Variance of a frame's real part, or imaginary part, by how it differs from the next."""
    return float(np.median(np.abs(np.diff(light)) ** 2) / (4.0 * np.log(2.0)))


def _placed(total: Complex, at: int, leap: float) -> int:
    """Return where a leap near a place is, by the few frames around."""
    half, reach = HALVES[0], HALVES[-1]
    place = np.arange(max(at - reach, half), min(at + reach, total.size - 1 - half) + 1)
    before, after = total[place] - total[place - half], total[place + half] - total[place]
    gain = np.abs(before + after * np.exp(-1j * leap)) - np.abs(before + after)
    return int(place[gain.argmax()])


def frames_of_step(step: float, std: float, step_rad: float) -> int:
    """How many frames are lost where the phase steps a little (negative: shown again).

    0 where none fits; clear leaps are for :func:`find_slips`.

    Parameters
    ----------
    step, std : float
        The phase's, and its standard error (rad).
    step_rad : float
        By how much the light's phase turns in a frame period.
    """
    slips = np.array([s for s in range(-MOST, MOST + 1) if s])
    leap = np.angle(np.exp(1j * slips * step_rad))
    off = np.abs(leap - step)
    small = (np.abs(leap) > LEAST_STEP_RAD) & (np.abs(leap) < LEAST_LEAP_RAD)
    fits = small & (off < OFF_RATIO * np.abs(leap) + OFF_STDS * std)
    return int(slips[fits][off[fits].argmin()]) if fits.any() else 0


def are_equal(columns: Float, noise_var: Float) -> NDArray[np.bool_]:
    """Whether each frame is equal to the one before, noise and all, shape (frames,).

    Parameters
    ----------
    columns : ndarray, shape (frames, columns)
        Reduced profiles.
    noise_var : ndarray, shape (columns,)
        Of a frame's noise in each.
    """
    apart = np.sum(np.diff(columns, axis=0) ** 2, axis=1)
    return np.concatenate([[False], apart < EQUAL_RATIO * 2.0 * np.sum(noise_var)])


def late_s(slips: list[tuple[int, int]], frames: int, period_s: float) -> Float:
    """By how much frames are later than time stamps say, shape (frames,).

    Frames that are shown again are each as old as the one before them.
    """
    late = np.zeros(frames)
    for at, lost in slips:
        for k in range(abs(lost)):
            late[at + (k if lost < 0 else 0) :] += period_s if lost > 0 else -period_s
    return late


def slip_words(slips: Sequence[FrameSlip], camera_hz: float | None = None) -> list[str]:
    """Say to a reader what was undone.

    Parameters
    ----------
    slips : sequence of FrameSlip
    camera_hz : float, optional
        Rate from which the recording was converted, if it was.
    """
    out = []
    if camera_hz:
        out.append(
            f"frames were dropped or doubled to convert the rate from {camera_hz:.6g} frames/s: "
            "what is said is of the original"
        )
    for sign, what in ((1, "lost before"), (-1, "shown again at")):
        own = sorted((s for s in slips if s.frames * sign > 0), key=lambda s: s.frame_number)
        if own:
            places = [
                f"{s.frame_number}" + (f" ({abs(s.frames)})" if abs(s.frames) > 1 else "")
                for s in own[:NAMED]
            ]
            more = ", …" if len(own) > NAMED else ""
            count = sum(abs(s.frames) for s in own)
            out.append(
                f"frames {what} frame {', '.join(places)}{more}, {count} in all, though the time "
                "stamps are silent: by the light's phase; bridged"
            )
    return out

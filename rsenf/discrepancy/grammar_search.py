"""Searches the grammar for effects that no catalogue has, where the catalogue leaves a rest.

Model: a term multiplies, adds to or delays one place of the capture by ``course(t)·shape(row)``
(:mod:`rsenf.discrepancy.grammar`). Terms are guessed from the residual, ranked by one linear step
less their description length, fitted and judged on held-out rows as effects of the catalogue are
(:mod:`rsenf.discrepancy.forward_selection`).

Statistic: that log likelihood ratio; of terms that do equally well the one of least description
length is taken, ``½·p·log(n) + log(terms)`` for ``p`` numbers beside ``n`` values.

Approximate: guesses cover one or two tones, one step, one band, five events at a time, and
take lines to be read from top to bottom; what counts as equally well is set by hand (64 nats).
Terms count only if, in the end, nothing is left: a wrong term of merely similar shape leaves a
rest.

References
----------
- Schwarz, G. (1978), Estimating the dimension of a model, Annals of Statistics 6.
- Rissanen, J. (1978), Modeling by shortest data description, Automatica 14.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from scipy.optimize import least_squares

from rsenf.discrepancy.candidates import ScoredEffect, candidates, ranked, weighed
from rsenf.discrepancy.effect_file import effect_of
from rsenf.discrepancy.fit import Fit
from rsenf.discrepancy.fit_parameters import series_of
from rsenf.discrepancy.forward_selection import Step
from rsenf.discrepancy.grammar import PLACES, Term, term_of
from rsenf.discrepancy.measured import Float32Array
from rsenf.discrepancy.residual_features import features_of
from rsenf.discrepancy.series import best_step, least
from rsenf.discrepancy.trial import Trial
from rsenf.errors import UsageError
from rsenf.messages.schema import FloatArray
from rsenf.model import Effect
from rsenf.model.parameters import fittings

PADDED = 4  # length of a spectrum over the number of frames
PEAKS, BY_CHANCE = 2, 0.01  # peaks of a spectrum; probability of one in noise alone
SKIRT_BINS = 2.0  # of the resolution
# nats: of two terms that leave as little, the better one if by more. In white noise a wrong term is
# better than the true one by 9 once in 10 000 times; the rest is for what isn't white. Set by hand
# beside the foreign camera's physical programs, seeds 91000 to 91007.
DECISIVE = 64.0
NAMES = len(PLACES) * 6 * 4  # terms: places, courses, rows
LEAST_TURNS = 2.0  # periods in the recording
NARROW, WIDE = 0.03, 0.9  # heights of a band
# Drifting bands that are tried: middles at both ends of the recording, and widths (heights).
ENDS, WIDTHS = np.linspace(-0.4, 1.4, 19), (0.05, 0.1, 0.2, 0.35)
BIN_S = 1.0
# Events: parts of a frame that are looked at, how far from usual they are, and how far apart.
EVENT_PARTS, EVENT_STDS, EVENT_APART_S, MOST_EVENTS = 8, 8.0, 0.3, 5
EVENT_S = 0.002, 10.0  # limits of how long one lasts, and of its time constant


@dataclass(frozen=True, eq=False)
class ShortestStep(Step):
    """One round among terms: the best, unless a shorter description does as well."""

    confused: ClassVar[float] = 0.4  # many look alike, and a linear step is good for a tone's size
    # Overtones and the ends of a band come with convergence.
    near: ClassVar[float] = 0.6
    converge_all: ClassVar[bool] = True
    tolerated_loss: ClassVar[float] = 0.005  # at a band's edge, which may be sharper

    @property
    def chosen(self) -> Trial | None:
        """The trial of least description length among those that do as well as the best."""
        held = [trial for trial in self.trials if self.holds(trial)]
        best = max(held, key=lambda trial: trial.beyond, default=None)
        equal = [trial for trial in held if best and self.equals(trial, best)]
        return min(equal, key=lambda t: _length(t.effect, self.before), default=None)

    def holds(self, trial: Trial) -> bool:
        """Whether the held-out data support a trial, and no number of a term is at its limit."""
        return super().holds(trial) and not (term_of(trial.effect) and _is_at_limit(trial.effect))

    def equals(self, trial: Trial, best: Trial) -> bool:
        """Whether a trial does hardly worse than a better one, by its likelihood, too."""
        return super().equals(trial, best) and best.nats - trial.nats < DECISIVE

    @property
    def equivalents(self) -> tuple[str, ...]:
        """Names of all effects that may do as well, without those that only have more freedom."""
        best = self.chosen
        mine = best and term_of(best.effect)
        wider = {
            t.effect.name
            for t in self.trials
            if mine and (its := term_of(t.effect)) and its.widens(mine)
        }
        return tuple(name for name in super().equivalents if name not in wider)


def _is_at_limit(effect: Effect) -> bool:
    """Whether a fitted number is at an end of its range: it stands for something else then."""
    fitted = [f for f in dataclasses.fields(effect) if f.name in fittings(effect)]
    return any(
        value == f.metadata["high"] or value == f.metadata["low"] != 0.0
        for f in fitted
        for value in np.atleast_1d(getattr(effect, f.name))
    )


def _length(effect: Effect, fit: Fit) -> float:
    """Description length of an effect beside a fit's data, in nats."""
    data, series = fit.data, series_of(effect)
    values = int(data.training.sum()) * data.lines * data.strips
    held = [getattr(effect, f.name) for f in dataclasses.fields(effect)]
    numbers = sum(len(v) if isinstance(v, tuple) else isinstance(v, float | int) for v in held)
    if series and not getattr(effect, series[0]):  # not fitted yet
        numbers += data.lines if series[1].each == "line" else data.frames
    named = 0.0 if term_of(effect) is None else math.log(NAMES)  # a known name is shorter
    return 0.5 * numbers * math.log(values) + named


def terms(fit: Fit) -> list[ScoredEffect]:
    """Return all of :func:`scored` less their description length, best first (Rissanen 1978)."""
    square = float((fit.residual[fit.data.training] ** 2).sum(dtype=np.float64))
    share = 2.0 * fit.noise_var / square  # of a nat
    out = [
        dataclasses.replace(c, explains=c.explains - share * _length(c.effect, fit))
        for c in scored(fit)
    ]
    return sorted(out, key=lambda c: -c.explains)


def scored(fit: Fit) -> list[ScoredEffect]:
    """Return a candidate for each guess of each term, and of each effect of the catalogue."""
    # What can only be fitted was tried before.
    out = [candidate for candidate in candidates(fit) if math.isfinite(candidate.explains)]
    for effect in _guesses(fit):
        with suppress(UsageError):  # a guess out of range
            out = ranked([*out, weighed(fit, effect)])
    return out


def _guesses(fit: Fit) -> Iterator[Effect]:
    """Terms at neutral size, with initial values for the rest from the residual."""
    data, lit, turn = fit.data, fit.jacobian.lit, fit.jacobian.turn
    names = [effect.name for effect in fit.forward.model.effects]

    def term(place: str, course: str, rows: str = "all") -> Term:
        number = 1
        while Term(place, course, rows, number).name in names:
            number += 1
        return Term(place, course, rows, number)

    many = {"depth_ratios": (0.0,), "phases_rad": (0.0,)}
    slow = _tones(fit, lit)
    length_s = float(data.time_s[-1])
    near_hz, line_s = SKIRT_BINS / length_s, _line_s(fit)
    fast = [
        hz for hz in features_of(fit).tones_hz if all(abs(hz - of) > near_hz for of in (0.0, *slow))
    ]
    for hz in slow:
        yield effect_of(term("gain", "tone"), tone_hz=hz, **many)
        shares, phase_rad = _by_row(fit, hz)
        # At half the frame rate what travels down the rows looks as if it stood.
        if fit.data.lines > 1 and abs(hz - 0.5 * float(data.frame_rate)) > near_hz:
            yield effect_of(term("gain", "tone", "own"), tone_hz=hz, phase_rad=phase_rad)
        for rows, held in _over_rows(shares).items():
            yield effect_of(term("gain", "tone", rows), tone_hz=hz, **many, **held)
        for rows, held in _over_rows(_by_row(fit, hz, line_s)[0]).items():
            for place in ("light", "added_light"):
                yield effect_of(term(place, "tone", rows), tone_hz=hz, **many, **held)
    for hz in [*slow, *fast]:
        for place in ("light", "added_light"):
            yield effect_of(term(place, "tone"), tone_hz=hz, **many)
    for hz in fast:
        for rows, held in _over_rows(_by_row(fit, hz, line_s)[0]).items():
            yield effect_of(term("added_light", "tone", rows), tone_hz=hz, **many, **held)
    for hz in _tones(fit, fit.flicker):
        for place in ("flicker", "coding"):
            yield effect_of(term(place, "tone"), tone_hz=hz, **many)
    for hz in slow:
        yield effect_of(term("picture", "tone"), tone_hz=hz, shift_ratios=(0.0,), phases_rad=(0.0,))
    if events := events_of(fit):
        yield effect_of(term("light", "events"), **events)
    late = {"delays_s": (0.0,), "phases_rad": (0.0,)}
    for hz in _tones(fit, turn):
        yield effect_of(term("frame_time", "tone"), tone_hz=hz, **late)
        yield effect_of(term("read_out", "tone"), tone_hz=hz, **many)
    for place in ("flicker", "coding"):
        yield effect_of(term(place, "step"), at_s=_step_at(fit, fit.flicker))
        yield effect_of(term(place, "drift"))
        yield effect_of(term(place, "settling"), time_constant_s=length_s / 4.0)
    yield effect_of(term("gain", "passing"), **_passing(fit))


def _tones(fit: Fit, direction: Float32Array) -> list[float]:
    """Frequencies of the strongest peaks that both halves of the rows share along a direction.

    Each line counts by itself, so that a tone whose phase differs from line to line shows.
    """
    data = fit.data
    first, second = (
        (of * along).sum(axis=2)
        for of, along in zip(data.halves(fit.residual), data.halves(direction), strict=True)
    )
    size = PADDED * data.frames
    spectra = [np.fft.rfft(half, size, axis=0) for half in (first, second)]
    power = (spectra[0] * spectra[1].conj()).real.sum(axis=1)
    hz = np.fft.rfftfreq(size, 1.0 / float(data.frame_rate))
    length_s = data.frames / float(data.frame_rate)
    power[hz < LEAST_TURNS / length_s] = 0.0
    # In noise a line's product of halves has a Laplace distribution; their sum has lighter tails.
    stands_out = math.log(power.size / (2.0 * BY_CHANCE)) / math.log(2.0)
    limit = stands_out * float(np.median(np.abs(power)))
    out: list[float] = []
    for _ in range(PEAKS):
        at = int(np.argmax(power))
        if power[at] <= limit:
            break
        a, b, c = power[at - 1], power[at], power[min(at + 1, power.size - 1)]
        bend = a - 2.0 * b + c
        moved = 0.5 * (a - c) / bend if bend < 0.0 else 0.0
        out.append(float(hz[at] + moved * hz[1]))
        power[np.abs(hz - hz[at]) < SKIRT_BINS / length_s] = 0.0
    return out


def _by_row(fit: Fit, hz: float, line_s: FloatArray | float = 0.0) -> tuple[FloatArray, float]:
    """Share of each line in a tone, and the phase that the shares have in common.

    The tone is that of whole frames, or of the light, given the time of each line.
    """
    data, lit = fit.data, fit.jacobian.lit
    gains = least(lit, fit.residual, (2,))
    wave = np.exp(-2j * np.pi * hz * data.time_s)
    size = 2.0 * (wave @ gains) / data.frames * np.exp(-2j * np.pi * hz * line_s)
    phase_rad = float(np.angle((size * size).sum()) / 2.0)
    return np.asarray((size * np.exp(-1j * phase_rad)).real), phase_rad


def _over_rows(shares: FloatArray) -> dict[str, dict[str, float]]:
    """Initial values of a ramp, and of a band, that the shares of the lines are like."""
    y = (np.arange(shares.size) + 0.5) / shares.size
    slope, middle = np.polyfit(2.0 * y - 1.0, shares, 1)
    out = {"ramp": {"tilt": float(np.clip(slope / (middle or 1e-12), -10.0, 10.0))}}
    summed = np.concatenate([[0.0], np.cumsum(shares)])
    first, end = np.triu_indices(summed.size, 1)
    gained = (summed[end] - summed[first]) ** 2 / (end - first)
    best = int(np.argmax(gained))
    top, bottom = float(first[best]) / shares.size, float(end[best]) / shares.size
    if NARROW < bottom - top < WIDE:
        out["band"] = {"top_ratio": top, "bottom_ratio": bottom}
    return out


def _line_s(fit: Fit) -> FloatArray:
    """Time of each line after its frame's start."""
    return np.arange(fit.data.lines) / fit.data.lines * fit.forward.model.shutter.read_out_time_s


def _step_at(fit: Fit, direction: Float32Array) -> float:
    """Time of the step that explains most of a course along a direction."""
    course = (direction * fit.residual).sum(axis=(1, 2), dtype=np.float64)
    course -= course.mean()
    _, at = best_step(course, course)
    return float(fit.data.time_s[at] - 0.5 / float(fit.data.frame_rate))


def events_of(fit: Fit) -> dict[str, Any]:
    """Initial values of a few short events of all light; their times are from half of the rows."""
    data, lit = fit.data, fit.jacobian.lit
    every_s = np.broadcast_to((data.time_s[:, None] + _line_s(fit))[..., None], lit.shape)
    moved, power = (data.halves(of)[0].sum(axis=2) for of in (lit * fit.residual, lit * lit))
    at_s = data.halves(every_s)[0][..., 0]
    gains = moved / np.maximum(power, 1e-12)
    parts = min(EVENT_PARTS, gains.shape[1])
    coarse, coarse_s = (
        np.stack([part.mean(axis=1) for part in np.array_split(of, parts, axis=1)], axis=1)
        for of in (gains, at_s)
    )
    far = np.abs(coarse) > EVENT_STDS * float(np.median(np.abs(coarse))) / 0.6745
    times = np.sort(coarse_s[far])
    begins = times[np.diff(times, prepend=-np.inf) > EVENT_APART_S]
    if not 0 < begins.size <= MOST_EVENTS:
        return {}
    near = np.any([np.abs(at_s - b - EVENT_APART_S / 3) < EVENT_APART_S for b in begins], axis=0)
    t_s, seen, weight = at_s[near], gains[near], np.sqrt(power[near])

    def shapes(values: FloatArray) -> FloatArray:
        lasts_s, constant_s = np.exp(values[:2])
        since = (t_s - values[2:, None]) / constant_s
        rise = 1.0 - np.exp(-np.clip(since, 0.0, lasts_s / constant_s))
        peak = 1.0 - np.exp(-lasts_s / constant_s)
        return np.asarray(rise / peak * np.exp(-np.clip(since - lasts_s / constant_s, 0.0, 700.0)))

    def sizes(values: FloatArray) -> FloatArray:
        return np.asarray(
            np.linalg.lstsq((shapes(values) * weight).T, seen * weight, rcond=None)[0]
        )

    start = np.concatenate([np.log([0.02, 0.02]), begins - 0.01])
    low, high = (np.where(np.arange(start.size) < 2, np.log(end), sign * np.inf)
                 for end, sign in zip(EVENT_S, (-1, 1), strict=True))  # fmt: skip
    found = least_squares(
        lambda v: (sizes(v) @ shapes(v) - seen) * weight, start, x_scale=0.01, bounds=(low, high)
    )
    each, begins_s = sizes(found.x), found.x[2:]
    if not each.any() or np.abs(begins_s - data.time_s.mean()).max() > data.time_s[-1]:
        return {}
    lasts_s, constant_s = np.exp(found.x[:2]).tolist()
    return {
        "at_s": tuple(begins_s.tolist()),
        "shares": tuple((each / each[np.abs(each).argmax()]).tolist()),
        "lasts_s": lasts_s, "time_constant_s": constant_s,
    }  # fmt: skip


def _passing(fit: Fit) -> dict[str, float]:
    """Initial values of the band of the gain, drifting over the rows, that explains most."""
    data, lit = fit.data, fit.jacobian.lit
    number = (data.time_s // BIN_S).astype(np.intp)
    moved, power = (
        np.stack([of[number == n].sum(axis=(0, 2), dtype=np.float64) for n in np.unique(number)])
        for of in (lit * fit.residual, lit * lit)
    )
    gains = moved / np.maximum(power, 1e-12)
    gains -= gains.mean(axis=0)  # taken by the wall
    y = (np.arange(data.lines) + 0.5) / data.lines
    share = np.linspace(0.0, 1.0, len(gains))[:, None]
    best, out = 0.0, dict[str, float]()
    for first in ENDS:
        for last in ENDS:
            for width in WIDTHS:
                shape = np.exp(-(((y - first - (last - first) * share) / width) ** 2) / 2)
                shape -= shape.mean(axis=0)
                along = float((shape * gains).sum())
                gained = along * along / max(float((shape * shape).sum()), 1e-12)
                if gained > best and first != last:
                    speed = float((last - first) / data.time_s[-1])
                    best = gained
                    out = {"centre_ratio": float(first), "speed_per_s": speed, "width_ratio": width}
    return out

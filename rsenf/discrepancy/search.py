"""The loop: fit, see what is left, try what might explain it, keep what held-out data support.

A candidate enters when it leaves less of the held-out data: of the rows, in blocks of time, that
nothing at all was fitted to. How much likelier it must make them counts how many were tried; it
must take away more than chance makes of data without a discrepancy, and make no block of time
worse, as what is only of the same shape would. A series must be what its effect says it is. Ones
that do it equally well are one class, of which none is named.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from rsenf.discrepancy.candidates import Candidate, candidates, per_power
from rsenf.discrepancy.fit import Fit, fit
from rsenf.discrepancy.gap import by_block
from rsenf.discrepancy.knobs import knobs_of, series_of
from rsenf.discrepancy.residue import residue_of
from rsenf.discrepancy.series import all_as_told, halves, held, summed_up, with_series
from rsenf.discrepancy.start import begun_anew
from rsenf.discrepancy.theory import Theory, plan
from rsenf.discrepancy.usual import NOTHING, Usual
from rsenf.errors import UsageError
from rsenf.messages.schema import FloatArray
from rsenf.model import Effect
from rsenf.model.effects import DeliveryEffect
from rsenf.model.parameters import Fitting

FALSE_ALARMS = 0.01  # of a whole search, by chance
TRIED, STEPS = 3, 5  # of the likeliest are fitted, in so many steps
HOPE = 0.3  # of the least gain that counts, from which on a candidate is worth a fit
RIVAL = 0.1  # of what the best explains, by a linear step, from which on another is its rival
WORST = -4.0  # standard errors by which a block of time may fare worse
MOST_STEPS = 6


@dataclass(frozen=True, eq=False)
class Trial:
    """One candidate fitted.

    Attributes
    ----------
    effect : Effect
        As it was fitted.
    fit : Fit
    gain : float
        By how much less is left of held-out rows, over the power of the flicker.
    nats : float
        Logarithm of the likelihood ratio of those rows, with it and without.
    worst : float
        Gain in the block of time that fares worst, in standard errors.
    usual : float
        What a codec alone may have it gain.
    """

    effect: Effect
    fit: Fit
    gain: float
    nats: float
    worst: float
    usual: float = 0.0

    @property
    def beyond(self) -> float:
        """Gain beyond what is usual."""
        return self.gain - self.usual


@dataclass(frozen=True, eq=False)
class Step:
    """What one round of the search did.

    Attributes
    ----------
    before : Fit
    trials : tuple of Trial
        Those that were fitted, the best first.
    tried : int
        How many candidates were looked at.
    limit : float
        Nats that it must bring.
    least : float
        What a gain must be.
    """

    before: Fit
    trials: tuple[Trial, ...]
    tried: int
    limit: float
    least: float

    @property
    def chosen(self) -> Trial | None:
        """The best trial, if the held-out data support it."""
        best = self.trials[0] if self.trials else None
        if best and best.nats > self.limit and best.beyond > self.least and best.worst > WORST:
            return best
        return None

    @property
    def kin(self) -> tuple[str, ...]:
        """Names of all effects that do as well as the chosen one, it among them."""
        best = self.chosen
        if best is None:
            return ()
        return tuple(dict.fromkeys(
            t.effect.name for t in self.trials if best.beyond - t.beyond <= self.least
        ))  # fmt: skip


def search(first: Fit, least: float, usual: Usual) -> Iterator[Step]:
    """Take step after step from a first fit, until nothing more is supported.

    Parameters
    ----------
    first : Fit
    least : float
        What an effect must take away of held-out rows, over the power of the flicker.
    usual : Usual
        Beyond what a codec alone may have it take away.

    Yields
    ------
    Step
        The last of them chose nothing, unless there are too many.
    """
    now = first
    for _ in range(MOST_STEPS):
        step = next_step(now, least, usual)
        yield step
        if step.chosen is None:
            return
        now = step.chosen.fit


def needed(last: Fit, steps: Sequence[Step]) -> tuple[Fit, list[Step]]:
    """Take out again what later steps have made superfluous.

    An effect stays if the model without it is worse by as much as it would take for it to enter.
    """
    kept = list(steps)
    for step in steps[:-1]:
        chosen = step.chosen
        assert chosen is not None
        name = chosen.effect.name
        without = fit(last.theory.with_model(last.theory.model.without(name)), last.data)
        gain, _, rows = _better(without, last)
        power = float((last.flicker[~last.data.training] ** 2).mean(dtype=np.float64))
        nats = float((gain * rows).sum() / (2.0 * last.noise_var))
        if nats < step.limit or float((gain * rows).sum() / rows.sum()) < step.least * power:
            last = without
            kept.remove(step)
    return last, kept


def next_step(before: Fit, least: float, usual: Usual = NOTHING) -> Step:
    """Look at all candidates, and fit the likeliest."""
    found, scale = candidates(before), per_power(before)
    limit = math.log(max(len(found), 1) / FALSE_ALARMS)
    step = Step(before, (), len(found), limit, least)
    for candidate in _likeliest(found, HOPE * least, scale, usual):
        best = step.chosen
        if best is not None and candidate.explains * scale < RIVAL * best.gain:
            break  # it, and all after it, are far from as good
        trial = tried(before, candidate, usual)
        if trial is not None:
            ordered = sorted((*step.trials, trial), key=lambda t: -t.beyond)
            step = dataclasses.replace(step, trials=tuple(ordered))
    if step.chosen is None:
        return step
    return dataclasses.replace(step, trials=(_settled(step.chosen), *step.trials[1:]))


def tried(before: Fit, candidate: Candidate, usual: Usual) -> Trial | None:
    """Fit a candidate jointly with all there is; None where no fit is found."""
    try:
        begun = _with_effect(before, candidate.effect)
        after = fit(begun, before.data, most=STEPS, slopes=candidate.slopes)
    except (UsageError, np.linalg.LinAlgError):  # steps have led to what can't be
        return None
    effect = next(e for e in after.theory.model.effects if e.name == candidate.effect.name)
    if not all_as_told(after.theory.model.effects):
        return None
    power = float((before.flicker[~before.data.training] ** 2).mean(dtype=np.float64))
    gain, stderr, rows = _better(before, after)
    nats = float((gain * rows).sum() / (2.0 * after.noise_var))
    mean = float((gain * rows).sum() / rows.sum())
    worst = float((gain / stderr).min())
    return Trial(effect, after, mean / power, nats, worst, usual.of(effect.name))


def _settled(trial: Trial) -> Trial:
    """Fit a trial on until it rests, and sum its series up."""
    after = fit(trial.fit.theory, trial.fit.data, slopes=trial.fit.slopes)
    told, model = [], after.theory.model
    for effect in model.effects:
        series = series_of(effect)
        told.append(_in_numbers(after, effect, *series) if series else effect)
    theory = after.theory.with_model(dataclasses.replace(model, effects=tuple(told)))
    effect = next(e for e in told if e.name == trial.effect.name)
    return dataclasses.replace(trial, effect=effect, fit=dataclasses.replace(after, theory=theory))


def _in_numbers(after: Fit, effect: Effect, name: str, how: Fitting) -> Effect:
    """Return an effect with the numbers that its series comes to."""
    direction = after.slopes.series[effect.name]
    moved = halves(direction, after.residual, after.slopes.lit, after.data, how)
    values = np.array(getattr(effect, name))
    if how.each == "frame":  # as they were delivered
        values = values[plan(after.theory.model, after.data).number[after.data.slot]]
    return summed_up(
        effect, values + moved[0], values + moved[1], 1.0 / float(after.data.frame_rate)
    )


def _with_effect(before: Fit, effect: Effect) -> Theory:
    """Return a fit's theory with an effect that does nothing yet."""
    told, model = series_of(effect), before.theory.model.plus(effect)
    if isinstance(effect, DeliveryEffect):
        ahead_rad = residue_of(before).angle_rad
        return before.theory.otherwise_delivered(model, before.data, ahead_rad)
    if told is None and not knobs_of(effect, neutral=True):
        # Without it nothing has fitted: what steps have made of the course is of no use.
        return begun_anew(before.begun.with_model(model), before.data)
    if told is None:
        return before.theory.with_model(model)
    values = held(before.theory, before.data, effect, *told)
    return with_series(before.theory, effect, told[0], values)


def _better(before: Fit, after: Fit) -> tuple[FloatArray, FloatArray, FloatArray]:
    """By how much less is left on average, in each held-out block, on rows nothing was fitted to.

    Its standard error too, of the noise, and how many values each mean is of.
    """
    data, others = before.data, ~before.data.training
    was, now = before.residual[data.second], after.residual[data.second]
    less = (was**2 - now**2).mean(axis=(1, 2), dtype=np.float64)
    moved = ((was - now) ** 2).mean(axis=(1, 2), dtype=np.float64)
    (gain, frames), (change, _) = (by_block(values, data, others) for values in (less, moved))
    rows = frames * float(was[0].size)
    stderr = 2.0 * np.sqrt(after.noise_var * change / rows) + 1e-30
    return gain, stderr, rows


def _likeliest(
    found: Sequence[Candidate], least: float, scale: float, usual: Usual
) -> list[Candidate]:
    """Those worth a fit: of each effect the likeliest, and all that can only be tried.

    ``least`` is what one must seem to gain beyond what is usual, and ``scale`` what all of the
    residual would be.
    """
    certain = [c for c in found if math.isinf(c.explains)]
    best: dict[str, Candidate] = {}
    for c in found:
        if math.isinf(c.explains):
            continue
        if c.explains * scale > least + usual.of(c.effect.name):
            best.setdefault(c.effect.name, c)
    return [*certain, *list(best.values())[:TRIED]]

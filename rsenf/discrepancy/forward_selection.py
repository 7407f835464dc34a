"""Forward selection of effects: fit, look at the residual, add the best effect, repeat.

Model: rows are those of the capture model with its effects (:mod:`rsenf.discrepancy.fit`) plus
noise; the null hypothesis of a round is that no candidate is missing.

Statistic: the log likelihood ratio of held-out rows, which nothing was fitted to, with and without
a candidate, ``(Σ r_0² − Σ r_1²) / 2σ²``; it must pass ``log(candidates / FALSE_ALARMS)``, a
Bonferroni limit. Besides, it must gain more than data without a discrepancy do by chance, make no
block of time, band of rows or strip worse, as an effect of merely similar shape would, and its
series must be of the kind that the effect declares. Effects that do equally well form a class, of
which no single one is named. Afterwards :func:`needed` removes what later steps made superfluous.

Approximate: the noise is white and Gaussian; systematic residuals enter by cluster-robust standard
errors (:mod:`rsenf.discrepancy.trial`). Only the best few by a linear step are fitted. An effect of
similar shape removes part of a discrepancy, here too much and there too little: the residual then
correlates with its own response, by a size that differs between parts (:func:`heterogeneity`).

References
----------
- Miller, A. (2002), Subset Selection in Regression.
- Cochran, W. G. (1954), The combination of estimates from different experiments, Biometrics 10.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from rsenf.discrepancy.candidates import NOTHING, CodecBaseline, ScoredEffect, candidates, per_power
from rsenf.discrepancy.fit import Fit, NoiseFloor, fit, floor_of
from rsenf.discrepancy.fit_parameters import series_of
from rsenf.discrepancy.measured import BANDS, Float32Array
from rsenf.discrepancy.trial import Trial, converged, judged, trial_of
from rsenf.errors import UsageError
from rsenf.messages.schema import FloatArray

MIN_POWER = 1e-12  # share of an effect's power that a part must have to determine a size
SURE = 4.0  # standard deviations of the noise, subtracted from the gain
FALSE_ALARMS = 0.01  # probability of a chance finding, per round
FITTED = 4  # candidates fitted, the best by linear step
HOPE = 0.3  # apparent gain that is worth a fit, over the least gain that counts
RIVAL = 0.1  # apparent gain of a candidate worth a fit, over the gain of the best trial
LIKENESS = 0.1  # share of the unexplained rest that an effect may gain by similar shape
ANY_LIKENESS = 0.5  # the same for an effect with a course of any shape
LOST = 0.05  # largest loss in parts of the data, over the gain in the others
WORST = -4.0  # least gain of a block of time, band of rows or strip, in standard errors
UNEVEN = 0.05  # share of an effect's power that sizes differing between parts may gain
MOST_STEPS = 6
TONE, LINE_BINS = 0.5, 6  # a tone: least share of a course's power; half width in bins


def heterogeneity(fit: Fit, name: str) -> float:
    """Share of an effect's gain if every part of the data had its own size (Cochran 1954).

    Parts are: frames; lines of each strip; and bands of lines of each strip in each block of time.
    The partition with the largest gain counts. Each size is estimated from both of two neighbours,
    whose noise is independent, so that the product of the estimates is free of it.

    Parameters
    ----------
    fit : Fit
        With its arrays.
    name : str
        Of an effect of its model.

    Raises
    ------
    UsageError
        When the model without the effect isn't valid.
    """
    data, others = fit.data, ~fit.data.training
    without = fit.forward.with_model(fit.forward.model.without(name)).rows(data)
    residual = data.halves(fit.residual[others])
    does = data.halves((fit.rows - without)[others])
    moved = [residual_of * of for residual_of, of in zip(residual, does, strict=True)]
    power = [of * of for of in does]
    block = np.unique(data.block[others], return_inverse=True)[1]

    def by_frame(values: Float32Array) -> FloatArray:
        return np.asarray(values.sum(axis=(1, 2), dtype=np.float64))

    def by_line(values: Float32Array) -> FloatArray:
        return np.asarray(values.sum(axis=0, dtype=np.float64))

    def by_part(values: Float32Array) -> FloatArray:
        bands = np.array_split(values, min(BANDS, values.shape[1]), axis=1)
        banded = np.stack([band.sum(axis=1, dtype=np.float64) for band in bands], axis=1)
        out = np.zeros((block[-1] + 1, *banded.shape[1:]))
        np.add.at(out, block, banded)
        return out

    total = max(sum(float(of.sum(dtype=np.float64)) for of in power), 1e-30)
    most = 0.0
    for parts in (by_frame, by_line, by_part):
        (first, second), (one, other) = (list(map(parts, of)) for of in (moved, power))
        sized = (one > MIN_POWER * total) & (other > MIN_POWER * total)
        both = 1.0 / one[sized] + 1.0 / other[sized]
        gained = float((first[sized] * second[sized] * both).sum())
        noise = fit.noise_var * float(np.linalg.norm(np.sqrt(one[sized] * other[sized]) * both))
        most = max(most, (gained - SURE * noise) / total)
    return most


@dataclass(frozen=True, eq=False)
class Step:
    """One round of forward selection."""

    # Apparent gain that is worth a fit, over the best one's, of an effect confused with that.
    confused: ClassVar[float] = 0.02
    # Gain over the best one's, above which a trial is fitted to convergence too; and whether even
    # one that the data don't support before that.
    near: ClassVar[float] = 0.8
    converge_all: ClassVar[bool] = False
    tolerated_loss: ClassVar[float] = -math.inf  # of parts of the data
    before: Fit
    trials: tuple[Trial, ...]  # candidates that were fitted, the best first
    scored: int  # number of candidates
    limit: float  # log likelihood ratio (nats) that one must exceed
    floor: NoiseFloor  # of data that the model before this round explains

    @property
    def least(self) -> float:
        """Least gain that counts: more than chance makes."""
        return self.floor.limit - self.floor.median

    @property
    def chosen(self) -> Trial | None:
        """The best trial that the held-out data support."""
        best = next(filter(self.holds, self.trials), None)
        if best is None or series_of(best.effect) is None:
            return best
        simpler = (
            trial
            for trial in self.trials
            if trial.effect.name == best.effect.name and series_of(trial.effect) is None
            and self.equals(trial, best)
        )  # fmt: skip
        return next(simpler, best)  # prefer few parameters to a series, if they do as well

    @property
    def name(self) -> str:
        """Name of the effect that was chosen."""
        assert self.chosen is not None
        return self.chosen.effect.name

    def holds(self, trial: Trial) -> bool:
        """Whether the held-out data support a trial."""
        series = series_of(trial.effect)
        like = ANY_LIKENESS if series and (series[1].free or series[1].each == "line") else LIKENESS
        least = max(self.least, like * (trial.fit.gap.most - self.floor.median))
        worse = trial.lost > LOST or (trial.worst < WORST and trial.lost > self.tolerated_loss)
        return trial.nats > self.limit and trial.beyond > least and not worse

    def equals(self, trial: Trial, best: Trial) -> bool:
        """Whether the held-out data support a trial, and hardly less than a better one.

        The codec's share isn't subtracted from its gain: it may have favoured the better one only.
        """
        return self.holds(trial) and best.beyond - trial.gain <= self.least

    def released(self, rows: Trial | None = None) -> Step:
        """Return the round without the arrays of its fits, except for the rows of one trial."""
        trials = tuple(_released(trial, rows=trial is rows) for trial in self.trials)
        return dataclasses.replace(self, before=self.before.released(), trials=trials)

    @property
    def equivalents(self) -> tuple[str, ...]:
        """Names of all effects that may do as well as the chosen one, which comes first."""
        best = self.chosen
        if best is None:
            return ()
        return tuple(dict.fromkeys(
            t.effect.name for t in (best, *self.trials) if t is best or self.equals(t, best)
        ) | dict.fromkeys([*_by_course(best), *best.effect.same_as]))  # fmt: skip


def _by_course(best: Trial) -> tuple[str, ...]:
    """Names of effects that look the same as a free course with a tone."""
    series = series_of(best.effect)
    if series is None or not series[1].free or series[1].each != "frame":
        return ()
    values = np.array(getattr(best.effect, series[0]))
    power = np.abs(np.fft.rfft(values - values.mean())) ** 2
    at = int(np.argmax(power))
    line = power[max(at - LINE_BINS, 0) : at + LINE_BINS + 1].sum()
    if at <= LINE_BINS or line < TONE * power.sum():
        return ()
    return tuple(n for n in best.effect.confused_with if n == "interharmonic")


def search(
    first: Fit,
    baseline: CodecBaseline,
    among: Callable[[Fit], list[ScoredEffect]] = candidates,
    kind: type[Step] = Step,
    tried: Callable[[float], None] = lambda share: None,
) -> Iterator[tuple[Step, Fit]]:
    """Add effects to a fit, one a round, until the data support no more (Miller 2002).

    Parameters
    ----------
    first : Fit
    baseline : CodecBaseline
        Gains of effects due to the codec alone.
    among : callable, optional
        Returns the candidates of a round, the best first; by default those of the catalogue.
    kind : type of Step, optional
        Which trial of a round is chosen.
    tried : callable, optional
        Called with the share of a round that is done.

    Yields
    ------
    Step
        The last one chose nothing, unless ``MOST_STEPS`` is reached.
    Fit
        The fit after it, with its large arrays; the generator is the only one to hold them.
    """
    now = first
    for _ in range(MOST_STEPS):
        step = next_step(now, baseline, among, kind, tried)
        if step.chosen is not None:
            now = step.chosen.fit.restored()
        yield step, now
        if step.chosen is None:
            return


def needed(
    last: Fit, steps: Sequence[Step], baseline: CodecBaseline = NOTHING
) -> tuple[Fit, list[Step]]:
    """Backward elimination of effects that later ones made superfluous (Miller 2002, ch. 3).

    An effect stays if it passes, on the final model, the same limits as when it entered, and if one
    size of it fits the whole recording (:func:`rsenf.discrepancy.forward_selection.heterogeneity`).

    Parameters
    ----------
    last : Fit
        After all rounds.
    steps : sequence of Step
        Rounds that added an effect.
    baseline : CodecBaseline, optional

    Returns
    -------
    Fit
    list of Step
        Rounds whose effects stay.
    """
    kept = list(steps)
    for step in steps[:-1]:
        without = _without(last, step)
        if without is None:
            continue
        worth = judged(without, last, step.name, baseline)
        if worth.nats < step.limit or worth.beyond < step.least:
            last = without.restored()
            kept.remove(step)
    while kept:
        uneven, step = max(
            ((heterogeneity(last, step.name), step) for step in kept), key=lambda of: of[0]
        )
        without = _without(last, step) if uneven > UNEVEN else None
        if without is None:
            return last, kept
        last = without.restored()
        kept.remove(step)
    return last, kept


def _without(last: Fit, step: Step) -> Fit | None:
    """Fit the model without the effect of a round; None if that can't be fitted."""
    forward = last.forward.with_model(last.forward.model.without(step.name))
    try:
        return fit(forward, last.data).released(rows=True)
    except (UsageError, np.linalg.LinAlgError):
        return None


def next_step(
    before: Fit,
    baseline: CodecBaseline = NOTHING,
    among: Callable[[Fit], list[ScoredEffect]] = candidates,
    kind: type[Step] = Step,
    tried: Callable[[float], None] = lambda share: None,
) -> Step:
    """Score all candidates and fit the best."""
    found, scale = among(before), per_power(before)
    limit = math.log(max(len(found), 1) / FALSE_ALARMS)
    step = kind(before, (), len(found), limit, floor_of(before))
    likeliest = _likeliest(found, HOPE * step.least, scale, baseline)
    found = [dataclasses.replace(c, jacobian=None) for c in found]
    parts = len(likeliest) + 1  # the last one lets the best converge
    while likeliest:
        candidate = likeliest.pop(0)  # frees its large Jacobian after the trial
        best = step.chosen
        if best is not None and candidate.explains * scale < RIVAL * best.gain:
            break  # this one and all after it are far worse
        step = _with_trial(step, candidate, baseline)
        tried(1.0 - (len(likeliest) + 1) / parts)
    likeliest.clear()
    for candidate in _confusable(found, step, scale):
        step = _with_trial(step, candidate, baseline)
    # A trial that is nearly as good may be as good once it has converged.
    among_all = step.trials if step.converge_all else filter(None, [step.chosen])
    near = step.near * max((trial.gain for trial in among_all), default=math.inf)
    trials = [
        converged(before, t, baseline)
        if t.gain > near and (step.converge_all or step.holds(t))
        else t
        for t in step.trials
    ]
    step = dataclasses.replace(step, trials=tuple(sorted(trials, key=lambda t: -t.beyond)))
    return step.released(rows=step.chosen)


def _with_trial(step: Step, candidate: ScoredEffect, baseline: CodecBaseline) -> Step:
    trial = trial_of(step.before, candidate, baseline)
    trials = sorted((*step.trials, trial) if trial else step.trials, key=lambda t: -t.beyond)
    step = dataclasses.replace(step, trials=tuple(trials))
    best = step.chosen
    least = step.near * best.gain if best else 0.0
    kept = tuple(t if t is best else _released(t, rows=t.gain > least) for t in trials)
    return dataclasses.replace(step, trials=kept)


def _released(trial: Trial, *, rows: bool = False) -> Trial:
    return dataclasses.replace(trial, fit=trial.fit.released(rows=rows))


def _confusable(found: Sequence[ScoredEffect], step: Step, scale: float) -> list[ScoredEffect]:
    """Candidates known to be confused with the best trial; a linear step may underestimate them."""
    best = step.chosen
    if best is None:
        return []
    known = {trial.effect.name for trial in step.trials}
    out: dict[str, ScoredEffect] = {}
    for c in found:
        if c.effect.name in best.effect.confused_with and c.effect.name not in known:
            out.setdefault(c.effect.name, c)
    return [c for c in out.values() if c.explains * scale > step.confused * best.gain]


def _likeliest(
    found: Sequence[ScoredEffect], least: float, scale: float, baseline: CodecBaseline
) -> list[ScoredEffect]:
    """Candidates worth a fit: the best of each effect, and all that have no linear score.

    ``least`` is the apparent gain needed beyond the codec's, and ``scale`` the gain of explaining
    all of the residual.
    """
    certain = [c for c in found if math.isinf(c.explains)]
    best: dict[tuple[str, bool], ScoredEffect] = {}  # a series counts apart
    for c in found:
        if math.isinf(c.explains):
            continue
        if c.explains * scale > least + baseline.of(c.effect.name):
            best.setdefault((c.effect.name, series_of(c.effect) is None), c)
    return [*certain, *list(best.values())[:FITTED]]

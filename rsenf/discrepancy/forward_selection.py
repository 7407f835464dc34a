"""Forward selection of effects: fit, look at the residual, keep what held-out data support.

A candidate enters when it leaves less of the held-out data: of the rows, in blocks of time, that
nothing at all was fitted to. How much likelier it must make them counts how many were tried; it
must take away more than chance makes of data without a discrepancy, and make no block of time, no
band of rows and no strip worse, as what is only of a like shape would. A series must be what its
effect says it is. Ones
that do it equally well are one class, of which none is named.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from rsenf.discrepancy.candidates import Candidate, candidates, per_power
from rsenf.discrepancy.codec_baseline import NOTHING, CodecBaseline
from rsenf.discrepancy.fit import Fit, fit
from rsenf.discrepancy.fit_parameters import series_of
from rsenf.discrepancy.heterogeneity import heterogeneity
from rsenf.discrepancy.noise_floor import NoiseFloor, floor_of
from rsenf.discrepancy.trial import Trial, judged, settled, tried
from rsenf.errors import UsageError

FALSE_ALARMS = 0.01  # of a whole search, by chance
TRIED = 4  # of the likeliest are fitted
HOPE = 0.3  # of the least gain that counts, from which on a candidate is worth a fit
RIVAL = 0.1  # of what the best explains, by a linear step, from which on another is its rival
CONFUSED = 0.02  # the same of an effect that is known to be confused with the best
NEAR = 0.8  # of the best's gain, from which on another is fitted to the end as well
LIKENESS = 0.1  # of what remains unexplained, that an effect may gain by being like it in shape
ANY_LIKENESS = 0.5  # the same of an effect whose course may be of any shape
LOST = 0.05  # of what it gains, that an effect may make worse elsewhere
WORST = -4.0  # standard errors by which a block of time, of rows or a strip may fare worse
UNEVEN = 0.05  # of an effect's power, that other sizes in other parts of a recording may gain
MOST_STEPS = 6
TONE, LINE_BINS = 0.5, 6  # share of a course's power that a line has, and how wide it may be


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
    floor : NoiseFloor
        Of data that the model before it explains.
    """

    before: Fit
    trials: tuple[Trial, ...]
    tried: int
    limit: float
    floor: NoiseFloor

    @property
    def least(self) -> float:
        """What a gain must be: more than chance makes of it."""
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
            and self.holds(trial) and best.beyond - trial.gain <= self.least
        )  # fmt: skip
        return next(simpler, best)  # few parameters do as well as a course of any shape

    def holds(self, trial: Trial) -> bool:
        """Whether held-out data support a trial."""
        told = series_of(trial.effect)
        like = ANY_LIKENESS if told and (told[1].free or told[1].each == "line") else LIKENESS
        least = max(self.least, like * (trial.fit.gap.most - self.floor.median))
        worse = trial.worst < WORST or trial.lost > LOST
        return trial.nats > self.limit and trial.beyond > least and not worse

    def released(self, rows: Trial | None = None) -> Step:
        """Return it without the arrays of its fits, but for the rows of one trial's."""
        trials = tuple(_released(trial, rows=trial is rows) for trial in self.trials)
        return dataclasses.replace(self, before=self.before.released(), trials=trials)

    @property
    def kin(self) -> tuple[str, ...]:
        """Names of all effects that may do as well as the chosen one, it among them.

        What a codec may have given to the one it needn't have given to the other.
        """
        best = self.chosen
        if best is None:
            return ()
        return tuple(dict.fromkeys(
            t.effect.name
            for t in (best, *self.trials)
            if t is best or (self.holds(t) and best.beyond - t.gain <= self.least)
        ) | dict.fromkeys([*_by_course(best), *best.effect.same_as]))  # fmt: skip


def _by_course(best: Trial) -> tuple[str, ...]:
    """Names of effects that are known by a tone, where a course of any shape has one.

    The gain of a frame and a swing of the light slower than that look the same.
    """
    told = series_of(best.effect)
    if told is None or not told[1].free or told[1].each != "frame":
        return ()
    values = np.array(getattr(best.effect, told[0]))
    power = np.abs(np.fft.rfft(values - values.mean())) ** 2
    at = int(np.argmax(power))
    line = power[max(at - LINE_BINS, 0) : at + LINE_BINS + 1].sum()
    if at <= LINE_BINS or line < TONE * power.sum():
        return ()
    return tuple(n for n in best.effect.confused_with if n == "interharmonic")


def search(first: Fit, usual: CodecBaseline) -> Iterator[tuple[Step, Fit]]:
    """Take step after step from a first fit, until nothing more is supported.

    Parameters
    ----------
    first : Fit
    usual : CodecBaseline
        What a codec alone may have effects take away of held-out rows.

    Yields
    ------
    Step
        The last of them chose nothing, unless there are too many.
    Fit
        What it has led to, with its arrays, which are much: nobody else keeps any.
    """
    now = first
    for _ in range(MOST_STEPS):
        step = next_step(now, usual)
        if step.chosen is not None:
            now = step.chosen.fit
            now = now.restored()
        yield step, now
        if step.chosen is None:
            return


def needed(
    last: Fit, steps: Sequence[Step], usual: CodecBaseline = NOTHING
) -> tuple[Fit, list[Step]]:
    """Take out again what later steps have made superfluous, and what is only like what is there.

    An effect stays if the model without it is worse by as much as it would take for it to enter,
    and if one size of it does for the whole recording.
    """
    kept = list(steps)
    for step in steps[:-1]:
        without = _without(last, step)
        if without is None:
            continue
        worth = judged(without, last, _name(step), usual)
        if worth.nats < step.limit or worth.beyond < step.least:
            last = without.restored()
            kept.remove(step)
    while kept:
        uneven, step = max(
            ((heterogeneity(last, _name(step)), step) for step in kept), key=lambda of: of[0]
        )
        without = _without(last, step) if uneven > UNEVEN else None
        if without is None:
            return last, kept
        last = without.restored()
        kept.remove(step)
    return last, kept


def _name(step: Step) -> str:
    assert step.chosen is not None
    return step.chosen.effect.name


def _without(last: Fit, step: Step) -> Fit | None:
    """Fit the model without what a step has added; None where nothing can be fitted without it."""
    theory = last.theory.with_model(last.theory.model.without(_name(step)))
    try:
        return fit(theory, last.data).released(rows=True)
    except (UsageError, np.linalg.LinAlgError):
        return None


def next_step(before: Fit, usual: CodecBaseline = NOTHING) -> Step:
    """Look at all candidates, and fit the likeliest."""
    found, scale = candidates(before), per_power(before)
    limit = math.log(max(len(found), 1) / FALSE_ALARMS)
    step = Step(before, (), len(found), limit, floor_of(before))
    likeliest = _likeliest(found, HOPE * step.least, scale, usual)
    found = [dataclasses.replace(c, slopes=None) for c in found]
    while likeliest:
        candidate = likeliest.pop(0)  # its slopes are much: nobody else has them
        best = step.chosen
        if best is not None and candidate.explains * scale < RIVAL * best.gain:
            break  # it, and all after it, are far from as good
        step = _with_trial(step, candidate, usual)
    likeliest.clear()
    for candidate in _confusable(found, step, scale):
        step = _with_trial(step, candidate, usual)
    if step.chosen is None:
        return step.released()
    # What is nearly as good may be as good, once it rests.
    near = NEAR * step.chosen.gain
    trials = [
        settled(before, t, usual) if t.gain > near and step.holds(t) else t for t in step.trials
    ]
    step = dataclasses.replace(step, trials=tuple(sorted(trials, key=lambda t: -t.beyond)))
    return step.released(rows=step.chosen)


def _with_trial(step: Step, candidate: Candidate, usual: CodecBaseline) -> Step:
    trial = tried(step.before, candidate, usual)
    trials = sorted((*step.trials, trial) if trial else step.trials, key=lambda t: -t.beyond)
    step = dataclasses.replace(step, trials=tuple(trials))
    best = step.chosen
    least = NEAR * best.gain if best else 0.0
    kept = tuple(t if t is best else _released(t, rows=t.gain > least) for t in trials)
    return dataclasses.replace(step, trials=kept)


def _released(trial: Trial, *, rows: bool = False) -> Trial:
    return dataclasses.replace(trial, fit=trial.fit.released(rows=rows))


def _confusable(found: Sequence[Candidate], step: Step, scale: float) -> list[Candidate]:
    """What the best is known to be confused with, though one linear step tells little for it."""
    best = step.chosen
    if best is None:
        return []
    known = {trial.effect.name for trial in step.trials}
    out: dict[str, Candidate] = {}
    for c in found:
        if c.effect.name in best.effect.confused_with and c.effect.name not in known:
            out.setdefault(c.effect.name, c)
    return [c for c in out.values() if c.explains * scale > CONFUSED * best.gain]


def _likeliest(
    found: Sequence[Candidate], least: float, scale: float, usual: CodecBaseline
) -> list[Candidate]:
    """Those worth a fit: of each effect the likeliest, and all that can only be tried.

    ``least`` is what one must seem to gain beyond what is usual, and ``scale`` what all of the
    residual would be.
    """
    certain = [c for c in found if math.isinf(c.explains)]
    best: dict[tuple[str, bool], Candidate] = {}  # of a course by itself, too
    for c in found:
        if math.isinf(c.explains):
            continue
        if c.explains * scale > least + usual.of(c.effect.name):
            best.setdefault((c.effect.name, series_of(c.effect) is None), c)
    return [*certain, *list(best.values())[:TRIED]]

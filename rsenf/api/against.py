"""Compares recordings with each other by their ENF alone: were they made at the same time?"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from rsenf.api.shared import ASIDE, Plain
from rsenf.api.track import TrackResult
from rsenf.errors import InputError
from rsenf.match.against import Against, align, match_against
from rsenf.match.series import Track, track_of, without_jumps
from rsenf.match.settings import MatchSettings
from rsenf.report.verdict import against_json, against_words, aligned_json, aligned_words


def verify_against(
    first: TrackResult, second: TrackResult, *, match: MatchSettings | None = None
) -> AgainstResult:
    """Decide whether two recordings were made at the same time.

    If a source restarted, the epoch with the most usable estimates is compared.

    Parameters
    ----------
    first, second : TrackResult
        Results of :func:`rsenf.track` with the method ``projection``.
    match : MatchSettings, optional

    Raises
    ------
    UsageError
        If the estimates carry no phase.
    InputError
        If one is too short for a single estimate.

    Examples
    --------
    >>> import rsenf
    >>> from rsenf.model import synthetic_grid
    >>> grid_hz = synthetic_grid(seed=5, duration_s=300).freq_hz
    >>> clips = [
    ...     rsenf.simulate(reference=grid_hz, step_s=1.0, start_s=start_s, duration_s=100,
    ...                    size=(64, 48), seed=seed)
    ...     for start_s, seed in ((120, 1), (100, 2))
    ... ]
    >>> a, b = (rsenf.track(clip.rows, frame_time_s=clip.frame_time_s) for clip in clips)
    >>> found = rsenf.verify_against(a, b)
    >>> found.decision, round(found.offset_s)
    ('match', 20)
    """
    warnings = [f"{one.recording}: {line}" for one in (first, second) for line in one.warnings]
    found = match_against(_best_stretch(first), _best_stretch(second), match or MatchSettings())
    return AgainstResult(**against_json(found, warnings), against=found)


def verify_together(
    recordings: Sequence[TrackResult], *, match: MatchSettings | None = None
) -> TogetherResult:
    """Place several recordings of one event on the time axis of the first, by all their pairs.

    Parameters
    ----------
    recordings : sequence of TrackResult
        Two or more, as for :func:`verify_against`.
    match : MatchSettings, optional

    Raises
    ------
    UsageError, InputError
        As :func:`verify_against`.

    Examples
    --------
    >>> import rsenf
    >>> from rsenf.model import synthetic_grid
    >>> grid_hz = synthetic_grid(seed=5, duration_s=300).freq_hz
    >>> clips = [
    ...     rsenf.simulate(reference=grid_hz, step_s=1.0, start_s=start_s, duration_s=100,
    ...                    size=(64, 48), seed=seed)
    ...     for start_s, seed in ((120, 1), (100, 2), (150, 3))
    ... ]
    >>> tracked = [rsenf.track(clip.rows, frame_time_s=clip.frame_time_s) for clip in clips]
    >>> found = rsenf.verify_together(tracked)
    >>> found.decision, [round(one["begin_s"]) for one in found.recordings]
    ('match', [0, -20, 30])
    """
    warnings = [f"{one.recording}: {line}" for one in recordings for line in one.warnings]
    found = align([_best_stretch(one) for one in recordings], match or MatchSettings())
    names = [one.recording for one in recordings]
    return TogetherResult(**aligned_json(names, found, warnings))


def _best_stretch(tracked: TrackResult) -> Track:
    """Estimates of the epoch with the most usable ones."""
    estimates, usable = tracked.analysis.estimates, Counter[int]()
    if not estimates:
        raise InputError("a recording too short for a single estimate", "give a longer one")
    for estimate in estimates:
        usable[estimate.header.epoch] += estimate.usable
    ((best, _),) = usable.most_common(1)
    of_epoch = [e for e in estimates if e.header.epoch == best]
    return without_jumps(track_of(of_epoch))[0]


@dataclass(frozen=True, eq=False, kw_only=True)
class AgainstResult(Plain):
    """Result of comparing two recordings. Unknown values are None.

    Attributes
    ----------
    decision : {'match', 'no_match', 'no_decision'}
        Whether they were made at the same time.
    offset_s, offset_std_s : float or None
        Start of the first less the start of the second, and its standard error.
    log10_lr, log10_lr_other : float or None
        Log10 likelihood ratio of this offset against different times, and against another offset.
    clock_ppm, clock_std_ppm : float or None
        By how much the first one's clock is faster, and its standard error.
    """

    decision: Literal["match", "no_match", "no_decision"]
    reason: str
    offset_s: float | None
    offset_std_s: float | None
    log10_lr: float | None
    log10_lr_other: float | None
    clock_ppm: float | None
    clock_std_ppm: float | None
    verbal: str
    warnings: list[str]
    against: Against = field(metadata=ASIDE)

    def __str__(self) -> str:
        return against_words(self.against)


@dataclass(frozen=True, eq=False, kw_only=True)
class TogetherResult(Plain):
    """Several recordings on one time axis. Unknown values are None.

    Attributes
    ----------
    decision : {'match', 'no_decision'}
        Whether all of them are placed, and the pairs agree.
    recordings : list of dict
        Of each its name, its start ``begin_s`` after the first's with ``begin_std_s``, and by how
        much its clock is faster than the first's, ``clock_ppm`` with ``clock_std_ppm``.
    pairs : list of dict
        Comparison of each two, with the keys of a comparison of two.
    misfit : float or None
        Rms difference of the pairs from the common alignment, in standard errors.
    """

    decision: Literal["match", "no_decision"]
    reason: str
    recordings: list[dict[str, Any]]
    pairs: list[dict[str, Any]]
    misfit: float | None
    warnings: list[str]

    def __str__(self) -> str:
        return aligned_words(self.to_dict())

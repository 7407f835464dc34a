"""Idle period and read-out time of a camera, and the comparison of two recordings."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import Any, Literal

from numpy.typing import ArrayLike

from rsenf.api.shared import ASIDE, Plain, Progress, Recording, Result, opened, row_settings, silent
from rsenf.errors import UsageError
from rsenf.idle import METHODS, IdleSettings
from rsenf.idle.compare import Comparison, compare_readout
from rsenf.report.camera import comparison_json, comparison_words, idle_json, idle_words
from rsenf.rows.settings import RowsSettings
from rsenf.run.inline import analyse


def idle(
    recording: Recording,
    *,
    frame_time_s: ArrayLike | None = None,
    frame_rate_hz: float | None = None,
    camera: str = "",
    begin: str = "rows",
    method: str | None = None,
    nominal_hz: float | None = None,
    rows: RowsSettings | None = None,
    settings: IdleSettings | None = None,
    progress: Progress = silent,
) -> IdleResult:
    """Estimate how long a camera reads no row between two frames.

    Parameters
    ----------
    recording, frame_time_s, frame_rate_hz, camera, progress
        As for :func:`rsenf.track`.
    begin : {'rows', 'frames'}
        What to use of an ``.mcap`` recording: its rows, or its video again.
    method : str, optional
        A name of :data:`rsenf.idle.METHODS`; ``coherent`` by default.
    nominal_hz : float, optional
        50 or 60; found from the data when not given.
    rows : RowsSettings, optional
    settings : IdleSettings, optional
        In place of ``method``.

    Raises
    ------
    UsageError
        If there is no such file or method, or an argument is invalid.
    InputError
        If the recording holds nothing that can be analysed.

    Examples
    --------
    >>> import rsenf
    >>> clip = rsenf.simulate(duration_s=20, seed=3, size=(64, 96), idle_ratio=0.3)
    >>> found = rsenf.idle(clip.rows, frame_time_s=clip.frame_time_s)
    >>> found.verdict, round(found.idle_ratio, 1)
    ('estimated', 0.3)
    """
    asked = idle_settings(settings or IdleSettings(method or IdleSettings.method), nominal_hz)
    source = opened(recording, frame_time_s, frame_rate_hz, camera, begin)
    analysis = analyse(source, rows=row_settings(rows), idle=asked, progress=progress)
    warnings = [*analysis.idle.warnings, *analysis.warnings, *filter(None, [analysis.loss])]
    doc = idle_json(analysis.idle, warnings)
    return IdleResult(recording=source.called, analysis=analysis, **doc)


def idle_settings(settings: IdleSettings, nominal_hz: float | None = None) -> IdleSettings:
    """Return checked settings of the estimator.

    Parameters
    ----------
    settings : IdleSettings
    nominal_hz : float, optional
        Nominal grid frequency, unless the settings give it.

    Raises
    ------
    UsageError
        If there is no such method.
    """
    if settings.method not in METHODS:
        raise UsageError(f"no idle method {settings.method!r}", f"one of {', '.join(METHODS)}")
    return dataclasses.replace(settings, nominal_hz=settings.nominal_hz or nominal_hz)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class IdleResult(Result):
    """A camera's idle period. Unknown values are None.

    Attributes
    ----------
    verdict : {'estimated', 'ambiguous', 'no_signal', 'refused'}
    idle_ratio, idle_ratio_std, idle_ratio_low, idle_ratio_high : float or None
        Share of each frame period in which no row is read, its standard error and 95 % interval.
    read_out_time_s, read_out_time_std_s : float or None
    direction : {'forward', 'reverse'} or None
    converted : bool
        Whether frames were dropped or repeated to give another rate than ``frame_rate_hz``.
    slips : int
        Number of places with lost or repeated frames that the time stamps don't show.
    reason : str or None
        Why no value is given.
    warnings : list of str
        All that a reader should know, including what could not be read.
    rate_hypotheses : list of dict
        Frame rates that fit the light, each with ``frame_rate_hz``, ``nominal_hz``,
        ``idle_ratio``, ``read_out_s``, ``direction`` and ``is_common``, the likeliest first; empty
        if the rate is known.
    """

    verdict: Literal["estimated", "ambiguous", "no_signal", "refused"]
    method: str
    idle_ratio: float | None
    idle_ratio_std: float | None
    idle_ratio_low: float | None
    idle_ratio_high: float | None
    read_out_time_s: float | None
    read_out_time_std_s: float | None
    direction: Literal["forward", "reverse"] | None
    frame_rate_hz: float | None
    nominal_hz: float | None
    converted: bool
    slips: int
    reason: str | None
    warnings: list[str]
    rate_hypotheses: list[dict[str, Any]]

    def __str__(self) -> str:
        return idle_words(self.analysis.idle)


def compare_idle(first: IdleResult, second: IdleResult) -> IdleComparison:
    """Compare the read-out times of two recordings.

    Read-out times that differ beyond their errors come from different cameras, or modes of one;
    equal ones prove nothing.

    Parameters
    ----------
    first, second : IdleResult
        Results of :func:`rsenf.idle`.

    Examples
    --------
    >>> import rsenf
    >>> clips = [rsenf.simulate(duration_s=20, size=(64, 96), idle_ratio=r) for r in (0.1, 0.4)]
    >>> a, b = (rsenf.idle(clip.rows, frame_time_s=clip.frame_time_s) for clip in clips)
    >>> rsenf.compare_idle(a, b).verdict
    'different'
    """
    found = compare_readout(first.analysis.idle, second.analysis.idle)
    return IdleComparison(
        **comparison_json(found),
        recordings=[first.recording, second.recording],
        warnings=[*first.warnings, *second.warnings],
        comparison=found,
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class IdleComparison(Plain):
    """Two read-out times compared.

    Attributes
    ----------
    verdict : {'different', 'compatible', 'undecidable'}
    log10_lr_same_readout : float or None
        Log10 likelihood ratio of one read-out time against two cameras.
    caveats : list of str
        What it doesn't prove.
    """

    recordings: list[str]
    log10_lr_same_readout: float | None
    verdict: Literal["different", "compatible", "undecidable"]
    caveats: list[str]
    warnings: list[str]
    comparison: Comparison = field(metadata=ASIDE)

    def __str__(self) -> str:
        return comparison_words(self.comparison)

"""A camera's idle period and read-out time, and those of two recordings compared."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import Any, Literal

from numpy.typing import ArrayLike

from rsenf.api.shared import (
    ASIDE,
    Progress,
    Recording,
    Result,
    json_fields,
    opened,
    row_settings,
    silent,
)
from rsenf.errors import UsageError
from rsenf.idle import METHODS, IdleSettings
from rsenf.idle.compare import Comparison, compare_readout
from rsenf.report.idle import comparison_json, comparison_words, idle_json, idle_words
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
    """Estimate how long a camera reads nothing between two frames.

    Parameters
    ----------
    recording, frame_time_s, frame_rate_hz, camera, progress
        As :func:`rsenf.track` takes them.
    begin : {'rows', 'frames'}
        What to take of an ``.mcap`` recording: its rows, or its video again.
    method : str, optional
        A name of :data:`rsenf.idle.METHODS`; ``coherent`` unless given.
    nominal_hz : float, optional
        50 or 60; found from the data when not given.
    rows : RowsSettings, optional
    settings : IdleSettings, optional
        In place of ``method``.

    Raises
    ------
    UsageError
        When there is no such file or method, or an argument can't be meant so.
    InputError
        When the recording holds nothing that can be analysed.

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
    told = idle_json(analysis.idle, warnings)
    return IdleResult(recording=source.called, analysis=analysis, **told)


def idle_settings(settings: IdleSettings, nominal_hz: float | None = None) -> IdleSettings:
    """Return settings of the estimator, checked.

    Raises
    ------
    UsageError
        When there is no such method.
    """
    if settings.method not in METHODS:
        raise UsageError(f"no idle method {settings.method!r}", f"one of {', '.join(METHODS)}")
    return dataclasses.replace(settings, nominal_hz=settings.nominal_hz or nominal_hz)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class IdleResult(Result):
    """A camera's idle period. What isn't known is None.

    Attributes
    ----------
    verdict : {'estimated', 'ambiguous', 'no_signal', 'refused'}
    idle_ratio, idle_ratio_std, idle_ratio_low, idle_ratio_high : float or None
        Share of each frame in which nothing is read, its standard error and 95 % interval.
    read_out_time_s, read_out_time_std_s : float or None
    direction : {'forward', 'reverse'} or None
    converted : bool
        Whether frames were dropped or doubled to give another rate than ``frame_rate_hz``.
    slips : int
        Places where frames are lost or shown again while the time stamps are silent.
    reason : str or None
        Why no value is given.
    warnings : list of str
        All that a reader should know, what could not be read among it.
    rate_hypotheses : list of dict
        Frame rates that the light goes with, each with ``frame_rate_hz``, ``nominal_hz``,
        ``idle_ratio``, ``read_out_s``, ``direction`` and ``is_common``, the likeliest first; empty
        where the rate is known.
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
    """Tell whether two recordings were read out in the same time.

    Read-out times that differ beyond their errors come from different cameras, or modes of one;
    equal ones prove nothing.

    Parameters
    ----------
    first, second : IdleResult
        What :func:`rsenf.idle` returned.

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
class IdleComparison:
    """Two read-out times compared.

    Attributes
    ----------
    verdict : {'different', 'compatible', 'undecidable'}
    log10_lr_same_readout : float or None
        For one read-out time, against two cameras.
    caveats : list of str
        What it doesn't prove.
    """

    recordings: list[str]
    log10_lr_same_readout: float | None
    verdict: Literal["different", "compatible", "undecidable"]
    caveats: list[str]
    warnings: list[str]
    comparison: Comparison = field(metadata=ASIDE)

    def to_dict(self) -> dict[str, Any]:
        """Return plain values: what the command line prints with ``--json``."""
        return {f.name: getattr(self, f.name) for f in json_fields(type(self))}

    def __str__(self) -> str:
        return comparison_words(self.comparison)

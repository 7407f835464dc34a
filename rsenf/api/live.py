"""Judges whether a feed was live: its flicker against the grid's frequency, second by second."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import TYPE_CHECKING, Any

from numpy.typing import ArrayLike

from rsenf.api.shared import (
    PathLike,
    Progress,
    Recording,
    References,
    Result,
    open_references,
    opened,
    row_settings,
    silent,
    table,
    track_settings,
)
from rsenf.errors import UsageError
from rsenf.idle import IdleSettings
from rsenf.live import Live, LiveSettings
from rsenf.messages import Liveness, ReferenceBlock
from rsenf.record import open_recording
from rsenf.reference import reference_blocks
from rsenf.reference.live import CameraReference
from rsenf.reference.open import utc_ns
from rsenf.report.verdict import alarm_json, live_json
from rsenf.rows.settings import RowsSettings
from rsenf.run.inline import Analysis, analyse
from rsenf.run.inputs import Input
from rsenf.timebase import seconds
from rsenf.track import TrackSettings

if TYPE_CHECKING:
    import pandas


def live(
    recording: Recording,
    reference: References | None = None,
    *,
    reference_camera: str = "",
    frame_time_s: ArrayLike | None = None,
    frame_rate_hz: float | None = None,
    camera: str = "",
    begin: str = "rows",
    reference_start: str | None = None,
    store: PathLike | None = None,
    start: str | None = None,
    nominal_hz: float | None = None,
    rows: RowsSettings | None = None,
    track: TrackSettings | None = None,
    settings: LiveSettings | None = None,
    progress: Progress = silent,
    **reading: Any,
) -> LiveResult:
    """Judge whether a recorded feed was live, as the node ``live`` does: from past data only.

    Parameters
    ----------
    recording, frame_time_s, frame_rate_hz, camera, begin, progress
        As for :func:`rsenf.track`.
    reference, reference_start, store, **reading
        As for :func:`rsenf.verify`; a single reference, with times of day.
    reference_camera : str
        Another camera of an ``.mcap`` recording, in place of a reference.
    start : str, optional
        When the first picture was taken, ISO 8601, in UTC unless it has a zone; by default the
        arrival times of the pictures are used, if they were recorded.
    nominal_hz : float, optional
        50 or 60; the reference's by default.
    rows, track, settings : RowsSettings, TrackSettings, LiveSettings, optional

    Raises
    ------
    UsageError
        If there is no such file, grid or camera, if the time of day is unknown, or if an argument
        is invalid.
    InputError
        If the recording holds nothing that can be analysed.

    Examples
    --------
    >>> import rsenf
    >>> from rsenf.model import synthetic_grid
    >>> grid_hz = synthetic_grid(seed=5, duration_s=600).freq_hz
    >>> clip = rsenf.simulate(
    ...     reference=grid_hz, step_s=1.0, start_s=200.0, duration_s=100, size=(64, 48)
    ... )
    >>> found = rsenf.live(
    ...     clip.rows, grid_hz, frame_time_s=clip.frame_time_s, start="2026-01-15T10:03:20Z",
    ...     step_s=1.0, reference_start="2026-01-15T10:00:00Z",
    ... )
    >>> found.verdict
    'live'
    """
    start_ns = utc_ns(start, "start") if start is not None else 0
    source = opened(recording, frame_time_s, frame_rate_hz, camera, begin)
    _check_input(source, reference_camera, start)
    notes: Sequence[str] = ()
    if reference_camera:
        blocks = _of_camera(source, reference_camera)
    elif reference is None:
        raise UsageError("nothing to compare with", "give a reference, or another camera")
    else:
        (one,) = open_references(
            reference, start=reference_start, store=store, assumed_hz=nominal_hz, **reading
        )
        if not one.t0_ns:
            raise UsageError(
                f"{one.name} has no times of day", "a live feed needs a reference that has"
            )
        blocks, notes = list(reference_blocks(one, source=f"reference/{one.grid}")), one.notes
    grid_hz = blocks[0].nominal_hz if blocks else None
    tracked = track_settings(track, nominal_hz=nominal_hz or grid_hz)
    analysis = analyse(
        source,
        rows=row_settings(rows, tracked),
        track=tracked,
        idle=IdleSettings(nominal_hz=nominal_hz),
        make_live=lambda: Live(settings, start_utc_ns=start_ns),
        reference=blocks,
        progress=progress,
    )
    return live_result(source.called, analysis, notes)


def _check_input(source: Input, reference_camera: str, start: str | None) -> None:
    """Refuse an input without arrival times or a start, or without the other camera."""
    if source.tells_arrival:
        return
    if reference_camera:
        raise UsageError(
            f"{source.called} has no other camera",
            "a camera for a reference needs an .mcap recording of several",
        )
    if not start:
        raise UsageError(
            f"{source.called} doesn't tell when its pictures arrived",
            "say when the first was taken, such as --start 2026-11-22T10:00:00Z",
        )


def _of_camera(source: Input, camera: str) -> list[ReferenceBlock]:
    """Return the reference derived from another camera of the recording."""
    recording = open_recording(source.called)
    topics = [t for t in recording.topics if t.endswith((f"/{camera}/rows", f"/{camera}/track"))]
    if len(topics) != 2:
        raise UsageError(f"{source.called} has no rows and track of camera {camera!r}")
    stage = CameraReference(camera)
    messages = (m for _, m, _ in recording.messages(topics, tolerant=True))
    return [block for m in messages if not m.header.is_end for block in stage.update(m)]


def live_result(name: str, analysis: Analysis, notes: Sequence[str] = ()) -> LiveResult:
    """Return the verdicts and alarms of an analysis as a result; ``notes``: on its reference."""
    verdicts = analysis.verdicts
    return LiveResult(
        recording=name,
        analysis=analysis,
        verdict=verdicts[-1].verdict if verdicts else "undecided",
        verdicts=[live_json(verdict) for verdict in _changes(verdicts)],
        last=live_json(verdicts[-1]) if verdicts else None,
        alarms=[alarm_json(alarm) for alarm in analysis.alarms],
        warnings=[*notes, *analysis.warnings, *filter(None, [analysis.loss])],
    )


def _changes(verdicts: Sequence[Liveness]) -> list[Liveness]:
    """Drop verdicts that repeat the one before."""
    return [next(alike) for _, alike in groupby(verdicts, stands_for)]


def stands_for(verdict: Liveness) -> tuple[Any, ...]:
    """Return what makes a verdict another one than that before it."""
    return verdict.verdict, verdict.header.run_id, verdict.header.epoch


def verdict_line(verdict: Liveness, when: str = "") -> str:
    """Return a verdict in one line, with the time of its pictures."""
    return f"{seconds(verdict.header.pts_ns):9.1f} s  {when}{verdict.in_short}"


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class LiveResult(Result):
    """Whether a feed was live.

    Attributes
    ----------
    verdict : {'live', 'stale', 'frozen', 'no_signal', 'undecided'}
        The last one.
    verdicts : list of dict
        Each that differs from the one before: ``t_s``, ``verdict``, ``lag_s``, ``evidence`` …
    last : dict or None
        The last of all, with the same keys.
    alarms : list of dict
    warnings : list of str
        All that a reader should know, including what could not be read.
    """

    verdict: str
    verdicts: list[dict[str, Any]]
    last: dict[str, Any] | None
    alarms: list[dict[str, Any]]
    warnings: list[str]

    def to_pandas(self) -> pandas.DataFrame:
        """Return a row for every verdict, one a second, indexed by ``t_s``."""
        rows = [live_json(verdict) for verdict in self.analysis.verdicts]
        names = live_json(Liveness()) if not rows else rows[0]
        return table({name: [one[name] for one in rows] for name in names}, "t_s")

    def __str__(self) -> str:
        verdicts = self.analysis.verdicts
        lines = [verdict_line(verdict) for verdict in _changes(verdicts)]
        lines += [verdict_line(verdicts[-1], "at the end ")] if verdicts else []
        return "\n".join([*lines, *(alarm.in_short for alarm in self.analysis.alarms)])

    def __repr__(self) -> str:
        return f"<LiveResult of {self.recording}: {self.verdict}>"

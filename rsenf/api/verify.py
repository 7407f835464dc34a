"""Finds the time of a recording by a grid reference."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from numpy.typing import ArrayLike

from rsenf.api.shared import (
    ASIDE,
    PathLike,
    Progress,
    Recording,
    References,
    Result,
    grids_of,
    nominal_of,
    open_references,
    opened,
    row_settings,
    silent,
    table,
    track_settings,
)
from rsenf.api.track import TrackResult, track_result
from rsenf.api.unknown_rate import UntimedRows, find_rate
from rsenf.errors import UsageError
from rsenf.flicker.frame_slips import slip_words
from rsenf.idle import IdleSettings
from rsenf.match.settings import MatchSettings
from rsenf.match.stage import Match
from rsenf.messages import RowBlock
from rsenf.reference import Reference, reference_blocks
from rsenf.reference.open import utc_ns
from rsenf.report.picture import ThinRows, draw
from rsenf.report.verdict import CandidateJson, EditJson, SegmentJson, verdict_json, verdict_words
from rsenf.rows.settings import RowsSettings
from rsenf.run.inline import Analysis, Tap, analyse
from rsenf.run.inputs import Input
from rsenf.track import TrackSettings

if TYPE_CHECKING:
    import pandas


def verify(
    recording: Recording,
    reference: References,
    *,
    frame_time_s: ArrayLike | None = None,
    frame_rate_hz: float | None = None,
    camera: str = "",
    begin: str = "rows",
    reference_start: str | None = None,
    store: PathLike | None = None,
    start: str | None = None,
    method: str = "phase",
    nominal_hz: float | None = None,
    rows: RowsSettings | None = None,
    track: TrackSettings | None = None,
    match: MatchSettings | None = None,
    picture: PathLike | None = None,
    report: PathLike | None = None,
    case: PathLike | None = None,
    command: str = "",
    progress: Progress = silent,
    **reading: Any,
) -> VerifyResult:
    """Compare a recording's ENF with a grid reference at every lag.

    Parameters
    ----------
    recording, frame_time_s, frame_rate_hz, camera, begin, progress
        As for :func:`rsenf.track`.
    reference : path, ``store:GRID``, Reference, array_like, or sequence of the first three
        A file, a grid of the store, or an array of frequencies in Hz; several for several grids.
    reference_start : str, optional
        Start of an array, ISO 8601, in UTC unless it has a zone.
    store : path, optional
        Folder of ``store:GRID``.
    start : str, optional
        Claimed start of the recording, ISO 8601, in UTC unless it has a zone.
    method : str
        A name of :data:`rsenf.match.METHODS`.
    nominal_hz : float, optional
        50 or 60; the reference's by default.
    rows, track, match : RowsSettings, TrackSettings, MatchSettings, optional
    picture : path, optional
        PNG file for a picture of the comparison.
    report : path, optional
        Folder for a report: HTML, JSON and pictures.
    case : path, optional
        YAML file of the case: case, exhibit, examiner, laboratory, received.
    command : str, optional
        Command that makes the same report, for its readers.
    **reading
        How a file is read, as for :class:`rsenf.reference.readings.ReadOptions`: ``timezone``,
        ``time_format``, ``column`` …; and ``step_s``, between the values of an array.

    Raises
    ------
    UsageError
        If there is no such file, grid or method, if the reference is shorter than the recording,
        or if an argument is invalid.
    InputError
        If the recording holds nothing that can be analysed.

    Examples
    --------
    >>> import rsenf
    >>> from rsenf.model import synthetic_grid
    >>> grid_hz = synthetic_grid(seed=5, duration_s=600).freq_hz
    >>> clip = rsenf.simulate(
    ...     reference=grid_hz, step_s=1.0, start_s=200.0, duration_s=60, size=(64, 48)
    ... )
    >>> found = rsenf.verify(clip.rows, grid_hz, frame_time_s=clip.frame_time_s, step_s=1.0)
    >>> found.decision, round(found.lag_s)
    ('match', 200)
    """
    picture, report = (Path(path) if path else None for path in (picture, report))
    claimed_ns = utc_ns(start, "start") if start is not None else 0
    if begin == "track" and (picture or report):
        raise UsageError("estimates hold no rows to draw", "begin with rows or frames")
    if picture and picture.is_dir():
        raise UsageError(f"picture {picture}: this is a folder", "name a file in it")
    if picture and not picture.absolute().parent.is_dir():
        raise UsageError(f"picture {picture}: no such folder", "make it first")
    settings, made_utc = match or MatchSettings(), ""
    of_case = None
    if case:
        from rsenf.config.schemas import load_case

        of_case = load_case(Path(case)).model_dump()
    if report:
        from rsenf.report.recording_time import check_folder, moment_of_report

        check_folder(report)
        made_utc = moment_of_report()
    references = open_references(
        reference, start=reference_start, store=store, assumed_hz=nominal_hz, **reading
    )
    source = opened(recording, frame_time_s, frame_rate_hz, camera, begin)
    if report and not source.path:
        raise UsageError("a report tells of a file", "write the arrays to an .npz, and name it")
    check_verify(method, track)
    grids, grid_hz = grids_of(references), nominal_of(references)
    tracked = track_settings(track, matcher=method, nominal_hz=nominal_hz or grid_hz)
    rows = row_settings(rows, tracked)
    spectra: dict[int, ThinRows] = defaultdict(ThinRows)  # by epoch

    untimed = UntimedRows()

    def draw_later(message: Any) -> None:
        if (picture or report) and isinstance(message, RowBlock):
            spectra[message.header.epoch].add(message)

    def tap(topic: str, message: Any) -> None:
        untimed.listen(message)
        draw_later(message)

    def compare(
        what: Input, settings: MatchSettings, alternatives: int = 1, edits: bool = True,
        tap: Tap = tap,
    ) -> Analysis:  # fmt: skip
        return analyse(
            what,
            rows=rows,
            track=tracked,
            idle=IdleSettings(nominal_hz=nominal_hz) if report else None,
            make_match=lambda: Match(
                method=method, grids=grids, claimed_utc_ns=claimed_ns, settings=settings,
                alternatives=alternatives, edits=edits,
            ),
            progress=progress,
            tap=tap,
        )  # fmt: skip

    _check_lengths(source, source.duration_s or 0.0, references)
    analysis = compare(source, settings)
    _check_lengths(source, max(analysis.stretches_s, default=0.0), references)
    said = []
    if untimed.rates and untimed.blocks:
        one = find_rate(untimed, nominal_hz or grid_hz, settings, compare)
        said = [one.said]
        if one.analysis and one.rows:
            analysis = one.analysis
            spectra.clear()
            for block in one.rows.messages():
                draw_later(block)
    found = analysis.result
    warnings = [*said, *_warnings(analysis, references)]
    unsure = found.decision == "no_match" or not any(e.usable for e in analysis.estimates)
    if len(analysis.stretches_s) > 1:
        warnings.append("the time is of the stretch with most usable seconds, maybe not the first")
    if grid_hz and unsure and not (nominal_hz or (track and track.nominal_hz)):
        warnings.append(f"looked for a {grid_hz:.0f} Hz grid, as the reference's is")
    doc = verdict_json(found, [*warnings, *filter(None, [analysis.loss])])
    result = VerifyResult(
        recording=source.called,
        analysis=analysis,
        reference=next((r for r in references if r.grid == found.grid), references[0]),
        case=of_case,
        **doc,
    )
    if picture:
        _draw(picture, result, spectra[found.header.epoch])
    if report:
        from rsenf.api.verify_report import write_verify_report

        write_verify_report(
            report,
            result,
            spectra[found.header.epoch],
            references,
            made_utc,
            {"rows": rows, "ENF": tracked, "match": settings},
            {
                "begin": begin, "camera": camera, "input": source.name,
                "reference": [r.name for r in references], "start": start, "method": method,
                "nominal_hz": nominal_hz, **reading,
            },
            command,
        )  # fmt: skip
    return result


def check_verify(method: str, track: TrackSettings | None) -> None:
    """Refuse settings with which no recording can be verified.

    Raises
    ------
    UsageError
        If there is no such matcher or tracker, or they don't suit each other.
    """
    track_settings(track, matcher=method)
    Match(method=method)


def _warnings(analysis: Analysis, references: Sequence[Reference]) -> list[str]:
    notes = [
        f"{r.grid}: {line}" if len(references) > 1 else line for r in references for line in r.notes
    ]
    enf = track_result("", analysis)
    slipped = slip_words(enf.slips, enf.camera_hz)
    return [*analysis.result.warnings, *analysis.warnings, *slipped, *notes]


def _check_lengths(source: Input, clip_s: float, references: Sequence[Reference]) -> None:
    """Refuse references that are all shorter than the clip."""
    longest = max(references, key=lambda r: r.duration_s)
    if clip_s > longest.duration_s:
        raise UsageError(
            f"{longest.name} covers {longest.duration_s:.1f} s, less than the {clip_s:.1f} s "
            f"of {source.called}",
            "give a reference that covers all of the time in question",
        )


def _draw(path: Path, found: VerifyResult, spectrum: ThinRows) -> None:
    result = found.analysis.result
    blocks = list(reference_blocks(found.reference, source="reference/file"))
    epoch = result.header.epoch
    estimates = [e for e in found.analysis.estimates if e.header.epoch == epoch]
    draw(path, spectrum, estimates, blocks, result)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class VerifyResult(Result):
    """Time of a recording. Unknown values are None.

    Attributes
    ----------
    reference : Reference
        The one that the verdict is about.
    decision : {'match', 'no_match', 'no_decision'}
    grid : str
        Name of the reference.
    reason : str
    lag_s, lag_std_s : float or None
        The recording's start less the reference's first sample, and its standard error.
    start_utc : str or None
        The recording's start as a time of day, ISO 8601.
    correlation : float or None
    log10_lr, log10_lr_absent : float or None
        Log10 likelihood ratio of this time against another time in the reference, and against a
        time outside it.
    claim : {'supported', 'refuted', 'undecidable'} or None
        Result for a claimed start.
    clock_ppm, clock_std_ppm : float or None
        Error of the camera's clock; positive is fast.
    search_size : int
        Number of lags compared.
    zone_unknown : bool
        Whether the reference's times had no zone: every time is by whole hours uncertain.
    candidates : list of dict
        Ranked, the best first.
    segments, edits : list of dict
        Of an edited recording: the parts that fit separately, each with its own time, and the edits
        between them. Empty for a whole one.
    warnings : list of str
        All that a reader should know, including what could not be read.
    case : dict or None
        The case that it belongs to, as the case file has it.
    """

    reference: Reference = field(metadata=ASIDE)
    decision: Literal["match", "no_match", "no_decision"]
    grid: str
    reason: str
    lag_s: float | None
    lag_std_s: float | None
    start_utc: str | None
    correlation: float | None
    log10_lr: float | None
    log10_lr_absent: float | None
    claim: Literal["supported", "refuted", "undecidable"] | None
    claim_log10_lr: float | None
    claim_log10_lr_other: float | None
    verbal: str
    clock_ppm: float | None
    clock_std_ppm: float | None
    residual_std_hz: float | None
    expected_std_hz: float | None
    search_size: int
    seconds_used: float
    idle_ratio: float | None
    method: str
    zone_unknown: bool
    candidates: list[CandidateJson]
    segments: list[SegmentJson]
    edits: list[EditJson]
    warnings: list[str]
    case: dict[str, str] | None

    @property
    def enf(self) -> TrackResult:
        """The ENF that was compared."""
        return track_result(self.recording, self.analysis)

    def to_pandas(self) -> pandas.DataFrame:
        """Return the candidates, a row for each, indexed by ``lag_s``."""
        names = ("lag_s", "grid", "start_utc", "correlation", "clock_ppm", "log10_lr")
        return table({name: [dict(c)[name] for c in self.candidates] for name in names}, "lag_s")

    def __str__(self) -> str:
        return verdict_words(self.analysis.result)

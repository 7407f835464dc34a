"""When was this recording made? Its ENF is compared with a grid reference at every lag.

The answer is a decision (match, no_match or no_decision), the lag with its standard error, the
likelihood ratio behind it, and how many lags were searched. With --start it also says whether a
claimed time is supported, refuted or undecidable.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from rsenf.cli.references import Opened
    from rsenf.report.spectrum import ThinRows
    from rsenf.run.inline import Analysis
    from rsenf.run.inputs import Input


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.add_argument("input", metavar="IN", help="video, .mcap recording or .npz luminance")
    what = parser.add_mutually_exclusive_group(required=True)
    add_reference(what)
    what.add_argument("--against", metavar="OTHER", help="another recording: made together?")
    parser.add_argument("--picture", type=Path, metavar="FILE.png", help="draw what was compared")
    parser.add_argument(
        "--report", type=Path, metavar="DIR", help="report to read: HTML, JSON and pictures"
    )
    parser.add_argument("--json", action="store_true", help="the verdict as JSON")
    add_settings(parser)


def add_reference(to: Any, **more: Any) -> None:
    """Argument that names references, added to a parser or a group of one."""
    to.add_argument(
        "--reference", action="append", metavar="REF", **more,
        help="CSV, Parquet, WAV of the mains, or store:GRID; several for several grids",
    )  # fmt: skip


def add_settings(parser: argparse.ArgumentParser) -> None:
    """Arguments that say how a recording is verified."""
    from rsenf.cli import options
    from rsenf.cli.console import (
        add_begin_argument,
        add_reference_arguments,
        add_row_arguments,
        add_track_arguments,
    )
    from rsenf.match.settings import MatchSettings

    parser.add_argument(
        "--start", metavar="TIME", help="claimed start, ISO 8601 (UTC unless it says)"
    )
    options.add_names(parser, "--method", "rsenf.match:METHODS", "matcher", "phase")
    options.add_settings(parser, "match", MatchSettings)
    parser.add_argument("--store", metavar="DIR", help="where store:GRID is looked for")
    add_reference_arguments(parser)
    add_begin_argument(parser, "frames", "rows", "track")
    add_row_arguments(parser)
    add_track_arguments(parser, "--enf-method")


def run(args: argparse.Namespace) -> int:
    """Verify a recording's time."""
    from rsenf.cli.console import note, print_json, progress_bar, say
    from rsenf.cli.references import open_references
    from rsenf.cli.track import summary
    from rsenf.cli.verify_report import begin_report, finish_report
    from rsenf.errors import EXIT_DONE, EXIT_LOSS
    from rsenf.report.spectrum import ThinRows
    from rsenf.report.verdict import verdict_words
    from rsenf.run.inputs import open_input_file

    if args.against:
        from rsenf.cli import verify_against

        return verify_against.run(args)
    claimed_ns_of(args)
    _check_pictures(args)
    made_utc = begin_report(args.report) if args.report else ""
    references = open_references(args)
    recording = open_input_file(args.input, camera=args.camera, begin=args.begin)
    spectra: dict[int, ThinRows] = defaultdict(ThinRows)  # by epoch

    def tap(topic: str, message: Any) -> None:
        if (args.picture or args.report) and topic == "rows":
            spectra[message.header.epoch].add(message)

    with progress_bar("verifying", recording.duration_s) as progress:
        analysis = verified(args, recording, references, progress, tap, idle=bool(args.report))
    if args.picture:
        _draw(args.picture, analysis, spectra, references)
    verdict = verdict_of(args, analysis, references)
    if args.json:
        print_json(verdict)
    else:
        print(verdict_words(analysis.result))
        for line in verdict["warnings"]:
            if line != analysis.loss:  # which is said below
                note(line)
    if not any(e.usable for e in analysis.estimates):
        say(f"{args.input}: {summary(analysis)}")
    if analysis.loss:
        say(f"{args.input}: {analysis.loss}")
    if args.report:
        finish_report(args, references, analysis, spectra, verdict, made_utc)
    return EXIT_LOSS if analysis.loss else EXIT_DONE


def claimed_ns_of(args: argparse.Namespace) -> int:
    """Return the claimed start, UTC since 1970; 0 for none."""
    from rsenf.reference.moments import utc_ns

    return utc_ns(args.start, "--start") if args.start else 0


def verified(
    args: argparse.Namespace,
    recording: Input,
    references: list[Opened],
    progress: Callable[[float], None] = lambda seconds: None,
    tap: Callable[[str, Any], None] = lambda topic, message: None,
    *,
    idle: bool = False,
) -> Analysis:
    """Compare a recording's ENF with references; its idle period is estimated on request."""
    from rsenf.cli import options
    from rsenf.cli.console import row_settings, track_settings
    from rsenf.cli.references import grids_of, nominal_of
    from rsenf.idle import IdleSettings
    from rsenf.match.settings import MatchSettings
    from rsenf.match.stage import Match
    from rsenf.run.inline import analyse

    _check_lengths(args, recording.duration_s or 0.0, references)
    grids, claimed_ns = grids_of(references), claimed_ns_of(args)
    settings = options.settings_of(args, MatchSettings)

    def make_match() -> Match:
        return Match(method=args.method, grids=grids, claimed_utc_ns=claimed_ns, settings=settings)

    analysis = analyse(
        recording,
        rows=row_settings(args),
        track=track_settings(args, nominal_of(references)),
        idle=IdleSettings(nominal_hz=args.nominal_hz) if idle else None,
        make_match=make_match,
        progress=progress,
        tap=tap,
    )
    _check_lengths(args, max(analysis.stretches_s, default=0.0), references)
    return analysis


def verdict_of(
    args: argparse.Namespace, analysis: Analysis, references: list[Opened]
) -> dict[str, Any]:
    """Return what ``--json`` prints of an analysis."""
    from rsenf.cli.references import nominal_of
    from rsenf.report.verdict import verdict_json

    result = analysis.result
    notes = [
        f"{r.grid}: {line}" if len(references) > 1 else line for r in references for line in r.notes
    ]
    warnings = [*result.warnings, *analysis.warnings, *notes]
    usable = any(e.usable for e in analysis.estimates)
    nominal_hz = nominal_of(references)
    if nominal_hz and not args.nominal_hz and (result.decision == "no_match" or not usable):
        warnings.append(f"looked for a {nominal_hz:.0f} Hz grid, as the reference's is")
    return verdict_json(result, [*warnings, *filter(None, [analysis.loss])])


def _draw(
    path: Path,
    analysis: Analysis,
    spectra: Mapping[int, ThinRows],
    references: list[Opened],
) -> None:
    from rsenf.cli.console import note
    from rsenf.cli.references import found_in
    from rsenf.reference import reference_blocks
    from rsenf.report.picture import draw

    result = analysis.result
    blocks = list(reference_blocks(found_in(result, references), source="reference/file"))
    epoch = result.header.epoch
    estimates = [e for e in analysis.estimates if e.header.epoch == epoch]
    draw(path, spectra[epoch], estimates, blocks, result)
    note(f"picture: {path}")


def _check_pictures(args: argparse.Namespace) -> None:
    """Refuse early what would fail at the end."""
    from rsenf.errors import UsageError

    path: Path | None = args.picture
    if args.begin == "track" and (path or args.report):
        raise UsageError("estimates hold no rows to draw", "leave --from track out")
    if path is not None and not path.absolute().parent.is_dir():
        raise UsageError(f"--picture {path}: no such folder", "make it first")


def _check_lengths(args: argparse.Namespace, clip_s: float, references: list[Opened]) -> None:
    """Refuse references none of which can hold the clip."""
    from rsenf.errors import UsageError

    longest = max(references, key=lambda r: r.duration_s)
    if clip_s > longest.duration_s:
        raise UsageError(
            f"{longest.name} covers {longest.duration_s:.1f} s, less than the {clip_s:.1f} s "
            f"of {args.input}",
            "give a reference that covers all of the time in question",
        )

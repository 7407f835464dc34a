"""Was this feed live? Its flicker against the grid's frequency, second by second, as it came.

For each stretch of time: live, stale (looped, replayed or delayed, and where it can be found from
when), frozen, no_signal or undecided; and the alarms. It is what the node 'live' says of a running
feed, of a recording of one: nothing is used before its time.
"""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rsenf.messages import Liveness, ReferenceBlock
    from rsenf.run.inline import Analysis


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    from rsenf.cli.console import (
        add_begin_argument,
        add_reference_arguments,
        add_row_arguments,
        add_track_arguments,
    )
    from rsenf.cli.options import add_settings
    from rsenf.live import LiveSettings

    parser.add_argument("input", metavar="IN", help="video, .mcap recording or .npz luminance")
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument(
        "--reference", nargs=1, metavar="REF",
        help="CSV, Parquet, WAV of the mains, or store:GRID, with times of day",
    )  # fmt: skip
    what.add_argument("--reference-camera", metavar="CAM", help="another camera of the recording")
    parser.add_argument(
        "--start", metavar="TIME",
        help="when the first picture was taken; without, when pictures arrived, if recorded",
    )  # fmt: skip
    parser.add_argument("--json", action="store_true", help="all verdicts and alarms as JSON")
    parser.add_argument("--store", metavar="DIR", help="where store:GRID is looked for")
    add_reference_arguments(parser)
    add_begin_argument(parser, "frames", "rows")
    add_row_arguments(parser)
    add_track_arguments(parser, "--enf-method")
    add_settings(parser, "live", LiveSettings)


def run(args: argparse.Namespace) -> int:
    """Judge a recording."""
    from rsenf.cli.console import note, print_json, say
    from rsenf.errors import EXIT_DONE, EXIT_LOSS
    from rsenf.report.liveness import alarm_json, live_json

    analysis, warnings = _analyse(args)
    warnings += analysis.warnings
    if args.json:
        print_json(
            {
                "verdict": analysis.verdicts[-1].verdict if analysis.verdicts else "undecided",
                "verdicts": [live_json(told) for told in _changes(analysis.verdicts)],
                "last": live_json(analysis.verdicts[-1]) if analysis.verdicts else None,
                "alarms": [alarm_json(alarm) for alarm in analysis.alarms],
                "warnings": [*warnings, *filter(None, [analysis.loss])],
            }
        )
    else:
        _print(analysis)
        for line in warnings:
            note(line)
    if analysis.loss:
        say(f"{args.input}: {analysis.loss}")
    return EXIT_LOSS if analysis.loss else EXIT_DONE


def _analyse(args: argparse.Namespace) -> tuple[Analysis, list[str]]:
    from rsenf.cli.console import progress_bar, row_settings, track_settings
    from rsenf.cli.options import settings_of
    from rsenf.idle import IdleSettings
    from rsenf.live import Live, LiveSettings
    from rsenf.reference.moments import utc_ns
    from rsenf.run.inline import analyse
    from rsenf.run.inputs import open_input_file

    start_ns = utc_ns(args.start, "--start") if args.start else 0
    settings = settings_of(args, LiveSettings)
    recording = open_input_file(args.input, camera=args.camera, begin=args.begin)
    _check_input(args)
    blocks, notes = _reference(args)
    with progress_bar("judging", recording.duration_s) as progress:
        analysis = analyse(
            recording,
            rows=row_settings(args),
            track=track_settings(args, blocks[0].nominal_hz if blocks else None),
            idle=IdleSettings(nominal_hz=args.nominal_hz),
            make_live=lambda: Live(settings, start_utc_ns=start_ns),
            reference=blocks,
            progress=progress,
        )
    return analysis, notes


def _check_input(args: argparse.Namespace) -> None:
    """Refuse what doesn't tell when its pictures came, or has no other camera."""
    from rsenf.errors import UsageError

    if args.input.lower().endswith(".mcap"):
        return
    if args.reference_camera:
        raise UsageError(
            f"{args.input} has no other camera",
            "--reference-camera needs an .mcap recording of several cameras",
        )
    if not args.start:
        raise UsageError(
            f"{args.input} doesn't tell when its pictures arrived",
            "say when the first was taken: --start 2026-11-22T10:00:00Z",
        )


def _reference(args: argparse.Namespace) -> tuple[list[ReferenceBlock], list[str]]:
    from rsenf.cli.references import open_references
    from rsenf.errors import UsageError
    from rsenf.reference import reference_blocks

    if args.reference_camera:
        return _of_camera(args), []
    (reference,) = open_references(args)
    if not reference.t0_ns:
        raise UsageError(
            f"{reference.name} has no times of day", "a live feed needs a reference that has"
        )
    source = f"reference/{reference.grid}"
    return list(reference_blocks(reference, source=source)), list(reference.notes)


def _of_camera(args: argparse.Namespace) -> list[ReferenceBlock]:
    """Return the reference that another camera of the recording makes."""
    from rsenf.errors import UsageError
    from rsenf.record import open_recording
    from rsenf.reference.live import CameraReference

    recording, camera = open_recording(args.input), args.reference_camera
    topics = [t for t in recording.topics if t.endswith((f"/{camera}/rows", f"/{camera}/track"))]
    if len(topics) != 2:
        raise UsageError(f"{args.input} has no rows and track of camera {camera!r}")
    stage = CameraReference(camera)
    messages = (m for _, m, _ in recording.messages(topics, tolerant=True))
    return [block for m in messages if not m.header.is_end for block in stage.update(m)]


def _changes(verdicts: list[Liveness]) -> list[Liveness]:
    """Leave out verdicts that only say again what the one before said."""

    def said(told: Liveness) -> tuple[Any, ...]:
        return told.verdict, told.header.run_id, told.header.epoch

    return [v for i, v in enumerate(verdicts) if i == 0 or said(v) != said(verdicts[i - 1])]


def _print(analysis: Analysis) -> None:
    from rsenf.timebase import seconds

    for told in _changes(analysis.verdicts):
        print(f"{seconds(told.header.pts_ns):9.1f} s  {told.in_short}")
    if analysis.verdicts:
        last = analysis.verdicts[-1]
        print(f"{seconds(last.header.pts_ns):9.1f} s  at the end {last.in_short}")
    for alarm in analysis.alarms:
        print(alarm.in_short)

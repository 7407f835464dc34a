"""When was this recording made? Compare its ENF with a grid reference at every lag.

The result is a decision (match, no_match or no_decision), the lag with its standard error, the
likelihood ratio, and the number of lags searched. With --start it also states whether a claimed
time is supported, refuted or undecidable.
"""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rsenf.cli import console, options
from rsenf.cli.options import settings_of
from rsenf.errors import UsageError

if TYPE_CHECKING:
    from rsenf.api.track import TrackResult

# Options that don't change the report.
ELSEWHERE = ("json", "picture", "report", "debug")


def add_verify(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.add_argument("input", metavar="IN", help="video, .mcap recording or .npz luminance")
    what = parser.add_mutually_exclusive_group(required=True)
    add_reference(what)
    what.add_argument(
        "--against", action="append", metavar="OTHER",
        help="another recording: made together? several are placed on one time",
    )  # fmt: skip
    parser.add_argument("--picture", type=Path, metavar="FILE.png", help="draw what was compared")
    parser.add_argument(
        "--report", type=Path, metavar="DIR", help="report to read: HTML, JSON and pictures"
    )
    parser.add_argument(
        "--case", type=Path, metavar="FILE",
        help="YAML for the report: case, exhibit, examiner, laboratory, received",
    )  # fmt: skip
    parser.add_argument("--json", action="store_true", help="the verdict as JSON")
    add_settings(parser)


def add_reference(to: Any, **more: Any) -> None:
    """Add the argument that names references to a parser or an argument group."""
    to.add_argument(
        "--reference", action="append", metavar="REF", **more,
        help="CSV, Parquet, WAV of the mains, or store:GRID; several for several grids",
    )  # fmt: skip


def add_settings(parser: argparse.ArgumentParser) -> None:
    """Add the arguments that say how a recording is verified."""
    from rsenf.match import METHODS
    from rsenf.match.settings import MatchSettings

    parser.add_argument(
        "--start", metavar="TIME", help="claimed start, ISO 8601 (UTC unless it says)"
    )
    names = tuple(METHODS)
    parser.add_argument(
        "--method", metavar="NAME", choices=names, default="phase",
        help=f"matcher: {', '.join(names)} (phase)",
    )  # fmt: skip
    options.add_settings(parser, "match", MatchSettings)
    console.add_reference_arguments(parser)
    console.add_recording_arguments(parser, "frames", "rows", "track")
    console.add_track_arguments(parser)


def run_verify(args: argparse.Namespace) -> int:
    """Verify the time of a recording."""
    from rsenf.api.verify import verify
    from rsenf.report.recording_time import check_folder

    if args.against:
        return _against(args)
    if args.report:
        check_folder(args.report)  # before anything is opened
    references, options = console.references_of(args), options_of(args)
    recording = console.open_recording(args, args.input)
    with console.progress_bar("verifying", recording.duration_s) as progress:
        found = verify(
            recording, references, **options, picture=args.picture, report=args.report,
            case=args.case, command=command_again(args), progress=progress,
        )  # fmt: skip
    if args.picture:
        console.note(f"picture: {args.picture}")
    console.tell(args, found.to_dict(), found, found.remarks)
    if not found.enf.usable.any():
        console.say(f"{args.input}: {found.enf.summary}")
    code = console.say_loss(args.input, found)
    if args.report:
        console.note(f"report: {args.report / 'report.html'}")
    return code


def options_of(args: argparse.Namespace) -> dict[str, Any]:
    """Return the keyword arguments of :func:`rsenf.api.verify.verify` for the verification."""
    from rsenf.match.settings import MatchSettings

    return {
        "start": args.start,
        "method": args.method,
        "nominal_hz": args.nominal_hz,
        "rows": console.row_settings(args),
        "track": console.track_settings(args, args.method),
        "match": settings_of(args, MatchSettings),
    }


def command_again(args: argparse.Namespace) -> str:
    """Return the command line that reproduces the report, with file names instead of paths."""
    from rsenf.cli import verb_parser

    words = ["rsenf", "verify", _name(args.input)]
    for action in verb_parser("verify")._actions:
        value = getattr(args, action.dest, None)
        if not action.option_strings or action.dest in ELSEWHERE or value in (None, action.default):
            continue
        if isinstance(action, argparse.BooleanOptionalAction):
            words.append(action.option_strings[not value])
            continue
        for one in value if isinstance(value, list) else [value]:
            words += [action.option_strings[0], _name(one)]
    return shlex.join([*words, "--report", "report"])


def _name(value: object) -> str:
    """Return an argument as text; only the name of an existing file."""
    if isinstance(value, str | Path) and Path(value).exists():
        return Path(value).name
    return str(value)


def _against(args: argparse.Namespace) -> int:
    from rsenf.api.against import verify_against, verify_together
    from rsenf.match.settings import MatchSettings

    refused = (
        "reference", "start", "picture", "report", "case", "min_overlap", "reference_noise_hz",
        "store", "timezone", "step_s", "column", "time_column", "time_format", "stamp",
    )  # fmt: skip
    for name in (*refused, *(["method"] if args.method != "phase" else [])):
        if getattr(args, name) is not None:
            option = name.replace("_", "-")
            raise UsageError(f"--against with --{option}", "the other recording is the reference")
    paths, match = [args.input, *args.against], settings_of(args, MatchSettings)
    tracked = [_tracked(args, path) for path in paths]
    two = len(tracked) == 2
    found = verify_against(*tracked, match=match) if two else verify_together(tracked, match=match)
    console.tell(args, found.to_dict(), found, found.warnings)
    for path, one in zip(paths, tracked, strict=True):
        if not one.usable.any():
            console.say(f"{path}: {one.summary}")
    return max(map(console.say_loss, paths, tracked))


def _tracked(args: argparse.Namespace, path: str) -> TrackResult:
    from rsenf.api.track import track

    settings = console.track_settings(args, args.method)
    recording = console.open_recording(args, path)
    with console.progress_bar(f"tracking {path}", recording.duration_s) as progress:
        rows = console.row_settings(args)
        return track(recording, rows=rows, settings=settings, progress=progress)

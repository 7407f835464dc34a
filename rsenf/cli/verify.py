"""When was this recording made? Its ENF is compared with a grid reference at every lag.

The answer is a decision (match, no_match or no_decision), the lag with its standard error, the
likelihood ratio behind it, and how many lags were searched. With --start it also says whether a
claimed time is supported, refuted or undecidable.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rsenf.messages import MatchResult
    from rsenf.reference import Reference
    from rsenf.run.inline import Analysis


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    from rsenf.cli.console import add_reference_arguments, add_signal_arguments

    parser.add_argument("input", metavar="IN", help="video, .mcap recording or .npz luminance")
    parser.add_argument(
        "--reference", required=True, metavar="REF", help="CSV, or WAV of the mains"
    )
    parser.add_argument(
        "--start", metavar="TIME", help="claimed start, ISO 8601 (UTC unless it says)"
    )
    parser.add_argument("--method", default="ncc", metavar="NAME", help="matcher (ncc)")
    parser.add_argument("--picture", type=Path, metavar="FILE.png", help="draw what was compared")
    parser.add_argument("--json", action="store_true")
    add_reference_arguments(parser)
    add_signal_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Verify a recording's time."""
    from rsenf.cli.console import note, print_json, progress_bar, signal_settings
    from rsenf.errors import EXIT_DONE, EXIT_LOSS
    from rsenf.match.matcher import check_lengths
    from rsenf.match.stage import Match
    from rsenf.reference import read_reference, reference_blocks
    from rsenf.report.spectrum import ThinRows
    from rsenf.run.inline import analyse
    from rsenf.run.inputs import open_input_file

    claimed_ns = _claimed_ns(args.start)
    recording = open_input_file(args.input, camera=args.camera)
    reference = read_reference(
        args.reference,
        timezone=args.timezone,
        step_s=args.step_s,
        column=args.column,
        stamp=args.stamp,
    )
    if recording.duration_s:
        check_lengths(recording.duration_s, reference.duration_s)
    blocks = list(reference_blocks(reference, source="reference/file", run_id=""))
    rows, track = signal_settings(args, reference.nominal_hz)
    spectrum = ThinRows()

    def tap(topic: str, message: Any) -> None:
        if args.picture and topic == "rows" and not message.header.is_end:
            spectrum.add(message)

    with progress_bar("verifying", recording.duration_s) as progress:
        analysis = analyse(
            recording,
            rows=rows,
            track=track,
            make_match=lambda: Match(method=args.method, claimed_utc_ns=claimed_ns),
            reference=blocks,
            progress=progress,
            tap=tap,
        )
    check_lengths(analysis.seconds, reference.duration_s)
    assert analysis.result is not None
    if args.picture:
        from rsenf.report.picture import draw

        draw(args.picture, spectrum, analysis.estimates, blocks, analysis.result)
    warnings = [*analysis.result.warnings, *analysis.warnings, *reference.notes]
    if analysis.loss:
        warnings.append(analysis.loss)
    if args.json:
        print_json(as_json(analysis.result, warnings))
    else:
        print(in_words(analysis, reference))
        for line in warnings:
            note(line)
        if args.picture:
            note(f"picture: {args.picture}")
    return EXIT_LOSS if analysis.loss else EXIT_DONE


def _claimed_ns(text: str | None) -> int:
    from datetime import UTC, datetime

    from rsenf.errors import UsageError

    if text is None:
        return 0
    try:
        moment = datetime.fromisoformat(text)
    except ValueError as exc:
        raise UsageError(f"--start {text!r} is not a time", "e.g. 2022-09-17T14:05:00Z") from exc
    moment = moment if moment.tzinfo else moment.replace(tzinfo=UTC)
    return int(moment.timestamp()) * 10**9 + moment.microsecond * 1000


def as_json(result: MatchResult, warnings: list[str]) -> dict[str, Any]:
    """Return the stable keys of a verdict."""
    from rsenf.cli.console import number, utc_text

    return {
        "decision": result.decision,
        "reason": result.reason,
        "lag_s": number(result.lag_s),
        "lag_std_s": number(result.lag_std_s),
        "start_utc": utc_text(result.start_utc_ns),
        "correlation": number(result.correlation),
        "log10_lr": number(result.log10_lr),
        "log10_lr_absent": number(result.log10_lr_absent),
        "claim": result.claim or None,
        "verbal": result.verbal,
        "clock_ppm": number(result.clock_ppm),
        "clock_std_ppm": number(result.clock_std_ppm),
        "residual_std_hz": number(result.residual_std_hz),
        "expected_std_hz": number(result.expected_std_hz),
        "search_size": result.search_size,
        "seconds_used": result.seconds_used,
        "idle_ratio": number(result.idle_ratio),
        "method": result.method,
        "candidates": [
            {
                "lag_s": number(c.lag_s),
                "start_utc": utc_text(c.start_utc_ns),
                "correlation": number(c.correlation),
                "clock_ppm": number(c.clock_ppm),
                "log10_lr": number(c.log10_lr),
                "seconds_used": c.seconds_used,
            }
            for c in result.candidates
        ],
        "warnings": warnings,
    }


def in_words(analysis: Analysis, reference: Reference) -> str:
    """Say the verdict to a person."""
    from rsenf.cli.console import utc_text

    result = analysis.result
    assert result is not None
    lines = [f"{result.decision}: {result.reason}" if result.reason else result.decision]
    if result.decision == "match":
        when = utc_text(result.start_utc_ns)
        place = f"lag {result.lag_s:.2f} ± {result.lag_std_s:.2f} s"
        lines = [
            f"match: the recording starts at {when} ({place})" if when else f"match: {place}",
            f"  correlation {result.correlation:.4f} over {result.seconds_used:.0f} s, "
            f"{result.search_size} lags searched",
            f"  likelihood ratio 10^{result.log10_lr:.1f} against any other time in the reference,",
            f"  10^{result.log10_lr_absent:.1f} against a time that is not in it: {result.verbal}",
            f"  camera's clock {result.clock_ppm:+.1f} ± {result.clock_std_ppm:.1f} ppm",
        ]
    if result.claim:
        lines.append(f"  claimed start {utc_text(result.claimed_utc_ns)}: {result.claim}")
    return "\n".join(lines)

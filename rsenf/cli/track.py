"""Print the ENF of a recording, one value a second.

Without --json a table goes to stdout; with it JSON Lines, one object for each second, t_s counted
from the first frame to the centre of what the value covers: a second (0.5, 1.5, …) by
projection, a window of 20 s (10, 11, …) by stft and its kin. A second without a usable signal is a
line too: its enf_hz is null.
"""

from __future__ import annotations

import argparse
import math
from collections import Counter
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from rsenf.messages import EnfEstimate
    from rsenf.run.inline import Analysis
    from rsenf.run.inputs import Input


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.add_argument("input", metavar="IN", help="video, .mcap recording or .npz luminance")
    parser.add_argument("--json", action="store_true", help="JSON Lines")
    add_settings(parser)


def add_settings(parser: argparse.ArgumentParser) -> None:
    """Arguments that say how a recording is tracked."""
    from rsenf.cli.console import add_begin_argument, add_row_arguments, add_track_arguments

    add_begin_argument(parser, "frames", "rows", "track")
    add_row_arguments(parser)
    add_track_arguments(parser, "--method", "--enf-method")


def run(args: argparse.Namespace) -> int:
    """Track a recording."""
    from rsenf.cli.console import (
        note,
        print_json,
        progress_bar,
        say,
        track_settings,
    )
    from rsenf.errors import EXIT_DONE, EXIT_LOSS
    from rsenf.run.inputs import open_input_file

    track_settings(args, None)
    recording = open_input_file(args.input, camera=args.camera, begin=args.begin)
    with progress_bar("tracking", recording.duration_s) as progress:
        analysis = tracked(args, recording, progress)
    if args.json:
        for estimate in analysis.estimates:
            print_json(as_json(estimate), indent=None)
    else:
        _print_table(analysis.estimates)
    for line in analysis.warnings:
        note(line)
    if any(e.usable for e in analysis.estimates):
        note(summary(analysis))
    else:
        say(f"{args.input}: {summary(analysis)}")
    if analysis.loss:
        say(f"{args.input}: {analysis.loss}")
    return EXIT_LOSS if analysis.loss else EXIT_DONE


def tracked(
    args: argparse.Namespace,
    recording: Input,
    progress: Callable[[float], None] = lambda seconds: None,
) -> Analysis:
    """Track a recording."""
    from rsenf.cli.console import row_settings, track_settings
    from rsenf.run.inline import analyse

    rows, track = row_settings(args), track_settings(args, None)
    return analyse(recording, rows=rows, track=track, progress=progress)


def as_json(estimate: EnfEstimate) -> dict[str, Any]:
    """Return the stable keys of one second, and a few more."""
    from rsenf.report.verdict import number

    std_hz = math.sqrt(estimate.enf_var_hz2) if estimate.enf_var_hz2 >= 0 else math.nan
    return {
        "t_s": round(estimate.t_s, 6),
        "enf_hz": number(estimate.enf_hz),
        "enf_std_hz": number(std_hz),
        "snr_db": number(estimate.snr_db),
        "usable": estimate.usable,
        "reason": estimate.reason,
        "epoch": estimate.header.epoch,
    }


def _print_table(estimates: Sequence[EnfEstimate]) -> None:
    if estimates:
        print(" t (s)   ENF (Hz)   ± mHz  SNR (dB)")
    for estimate in estimates:
        if estimate.usable:
            std_mhz = 1e3 * math.sqrt(estimate.enf_var_hz2)
            values = f"{estimate.enf_hz:10.5f} {std_mhz:7.2f} {estimate.snr_db:9.1f}"
        else:
            values = f"         –       –         –   {estimate.reason}"
        print(f"{estimate.t_s:6.1f} {values}")


def summary(analysis: Analysis) -> str:
    """One line on what was found of the ENF."""
    estimates = analysis.estimates
    if not estimates:
        return f"too short to tell: {analysis.seconds:.1f} s of video"
    usable = [e for e in estimates if e.usable]
    if not usable:
        # What is wrong with the rows themselves explains best why no window of them is of use.
        (rows, _), *_ = analysis.row_reasons.most_common(1)
        (reason, _), *_ = Counter(e.reason for e in estimates).most_common(1)
        return f"no usable signal in {analysis.seconds:.0f} s of video: {rows or reason}"
    last = usable[-1]
    return (
        f"{len(usable)} of {len(estimates)} values usable; {last.nominal_hz:.0f} Hz grid, "
        f"harmonic {last.harmonic} on the line at {last.line_hz:.1f} Hz, "
        f"{last.frame_rate_hz:.3f} frames/s"
    )

"""How long does the camera read nothing? Its idle period and read-out time, from the flicker.

The verdict is 'estimated', or says why no value is given: 'ambiguous' (more than one fits),
'no_signal' (no flicker of mains light), 'refused' (this recording can't bear an answer).

With two recordings: were they read out in the same time? Read-out times that differ beyond their
errors come from different cameras, or modes of one; equal ones prove nothing.
"""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from rsenf.idle import IdleSettings
    from rsenf.run.inline import Analysis
    from rsenf.run.inputs import Input


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.add_argument("input", metavar="IN", help="video, .mcap recording or .npz luminance")
    parser.add_argument("other", nargs="?", metavar="OTHER", help="another, to compare it with")
    parser.add_argument("--json", action="store_true", help="the estimate as JSON")
    add_settings(parser)


def add_settings(parser: argparse.ArgumentParser) -> None:
    """Arguments that say how the idle period is estimated."""
    from rsenf.cli import options
    from rsenf.cli.console import add_begin_argument, add_row_arguments
    from rsenf.idle import IdleSettings

    add_begin_argument(parser, "frames", "rows")
    add_row_arguments(parser)
    options.add_settings(parser, "idle", IdleSettings, also={"method": "method"})


def run(args: argparse.Namespace) -> int:
    """Estimate a recording's idle period, or compare two recordings."""
    from rsenf.cli.console import note, print_json, say
    from rsenf.errors import EXIT_DONE, EXIT_LOSS
    from rsenf.report.idle import idle_words

    paths = [path for path in (args.input, args.other) if path is not None]
    analyses = [_analyse(args, path) for path in paths]
    if args.json and len(paths) == 1:
        (analysis,) = analyses
        print_json(estimate_of(analysis))
    elif args.json:
        print_json(_compared(paths, analyses))
    else:
        for path, analysis in zip(paths, analyses, strict=True):
            print(f"{path}: " * (len(paths) > 1) + idle_words(analysis.idle))
            for line in _warnings(analysis):
                note(line)
        if len(paths) > 1:
            print(_compared_in_words(analyses))
    for path, analysis in zip(paths, analyses, strict=True):
        for line in _losses(analysis):
            say(f"{path}: {line}")
    return EXIT_LOSS if any(analysis.loss for analysis in analyses) else EXIT_DONE


def _analyse(args: argparse.Namespace, path: str) -> Analysis:
    from rsenf.cli.console import progress_bar
    from rsenf.run.inputs import open_input_file

    idle_settings(args)
    recording = open_input_file(path, camera=args.camera, begin=args.begin)
    with progress_bar("estimating", recording.duration_s) as progress:
        return estimated(args, recording, progress)


def idle_settings(args: argparse.Namespace) -> IdleSettings:
    """Return the settings that the arguments ask for."""
    from rsenf.cli.options import settings_of
    from rsenf.idle import IdleSettings

    return settings_of(args, IdleSettings)


def estimated(
    args: argparse.Namespace,
    recording: Input,
    progress: Callable[[float], None] = lambda seconds: None,
) -> Analysis:
    """Estimate a recording's idle period."""
    from rsenf.cli.console import row_settings
    from rsenf.run.inline import analyse

    return analyse(recording, rows=row_settings(args), idle=idle_settings(args), progress=progress)


def estimate_of(analysis: Analysis) -> dict[str, Any]:
    """Return what ``--json`` prints of an analysis."""
    from rsenf.report.idle import idle_json

    return idle_json(analysis.idle, [*_warnings(analysis), *_losses(analysis)])


def _warnings(analysis: Analysis) -> list[str]:
    return [*analysis.idle.warnings, *analysis.warnings]


def _losses(analysis: Analysis) -> list[str]:
    return [analysis.loss] if analysis.loss else []


def _compared(paths: Sequence[str], analyses: Sequence[Analysis]) -> dict[str, Any]:
    from rsenf.idle.compare import compare_readout
    from rsenf.report.idle import comparison_json

    a, b = (analysis.idle for analysis in analyses)
    return {
        "recordings": list(paths),
        **comparison_json(compare_readout(a, b)),
        "warnings": [line for x in analyses for line in (*_warnings(x), *_losses(x))],
    }


def _compared_in_words(analyses: Sequence[Analysis]) -> str:
    from rsenf.idle.compare import compare_readout
    from rsenf.report.idle import comparison_words

    a, b = (analysis.idle for analysis in analyses)
    return comparison_words(compare_readout(a, b))

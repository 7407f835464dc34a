"""``rsenf verify A --against B``: two recordings against each other."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rsenf.match.series import Track
    from rsenf.run.inline import Analysis


def run(args: argparse.Namespace) -> int:
    """Compare two recordings; the stretch of each that tells most."""
    from rsenf.cli.console import note, print_json, say
    from rsenf.cli.track import summary
    from rsenf.errors import EXIT_DONE, EXIT_LOSS, UsageError
    from rsenf.match.against import match_against
    from rsenf.match.settings import MatchSettings
    from rsenf.report.against import against_json, against_words

    for name in ("reference", "start", "picture", "report"):
        if getattr(args, name):
            raise UsageError(f"--against with --{name}", "the other recording is the reference")
    both = [_analysed(args, path) for path in (args.input, args.against)]
    names = (args.input, args.against)
    first, second = (_track(analysis) for analysis in both)
    warnings = [
        f"{name}: {line}"
        for name, analysis in zip(names, both, strict=True)
        for line in analysis.warnings
    ]
    found = match_against(first, second, MatchSettings())
    if args.json:
        print_json(against_json(found, warnings))
    else:
        print(against_words(found))
        for line in warnings:
            note(line)
    for name, analysis in zip(names, both, strict=True):
        if not any(e.usable for e in analysis.estimates):
            say(f"{name}: {summary(analysis)}")
        if analysis.loss:
            say(f"{name}: {analysis.loss}")
    return EXIT_LOSS if any(analysis.loss for analysis in both) else EXIT_DONE


def _analysed(args: argparse.Namespace, path: str) -> Analysis:
    from rsenf.cli.console import progress_bar
    from rsenf.cli.track import tracked
    from rsenf.run.inputs import open_input_file

    recording = open_input_file(path, camera=args.camera, begin=args.begin)
    with progress_bar(f"tracking {path}", recording.duration_s) as progress:
        return tracked(args, recording, progress)


def _track(analysis: Analysis) -> Track:
    """Estimates of the stretch with the most usable ones."""
    from rsenf.errors import InputError
    from rsenf.match.jumps import without_jumps
    from rsenf.match.series import track_of

    by_epoch: dict[int, int] = {}
    for estimate in analysis.estimates:
        epoch = estimate.header.epoch
        by_epoch[epoch] = by_epoch.get(epoch, 0) + estimate.usable
    if not by_epoch:
        raise InputError("a recording too short for a single estimate", "give a longer one")
    best = max(by_epoch, key=lambda epoch: by_epoch[epoch])
    return without_jumps(track_of([e for e in analysis.estimates if e.header.epoch == best]))[0]

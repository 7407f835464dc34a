"""``rsenf bench match``: what a blind search of a long reference takes, in time and memory."""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rsenf.bench.match_stream import Stream
    from rsenf.bench.match_trial import Trial

_CLIP_S = 600
_STREAMS_S = (600, 3600, 3 * 3600, 10 * 3600)
_REPEATS = 5
_QUICK_DAYS, _QUICK_REPEATS = 7, 1
_RECORDS = "match.jsonl"


def run(args: argparse.Namespace) -> int:
    """Time what is missing, and print the table.

    Raises
    ------
    UsageError
        For a clip that doesn't fit a day.
    """
    from rsenf.bench.match_stream import timed_stream
    from rsenf.bench.match_table import page, tabulate, text
    from rsenf.bench.match_trial import measure_trials
    from rsenf.bench.session import measure_missing
    from rsenf.cli.console import print_json, say
    from rsenf.errors import EXIT_DONE

    trials = _trials(args)
    with tempfile.TemporaryDirectory() as temporary:
        out = (args.out or Path(temporary)) / _RECORDS
        records = measure_trials(trials, out, lambda trial: say(f"searching: {trial.key}"))
        streams = measure_missing(_streams(args), timed_stream, out, 1)
    document = tabulate(records, streams)
    if args.json:
        print_json(document)
    else:
        print(page(document) if args.markdown else text(document))
    return EXIT_DONE


def _trials(args: argparse.Namespace) -> list[Trial]:
    from rsenf.bench.match_days import LONGEST_CLIP_S, Haystack
    from rsenf.bench.match_table import SPANS
    from rsenf.bench.match_trial import Trial
    from rsenf.cli.bench import grids_of
    from rsenf.errors import UsageError

    clip_s = round(args.duration_s or _CLIP_S)
    if clip_s > LONGEST_CLIP_S:
        raise UsageError(f"a clip of {clip_s} s", f"at most {LONGEST_CLIP_S} s fit a day")
    folder, seed = grids_of(args), args.first_seed or 0
    repeats = args.repeat or (_QUICK_REPEATS if args.quick else _REPEATS)
    return [
        Trial(Haystack(days, gaps, clip_s, seed, folder), repeats)
        for days in SPANS
        for gaps in (False, True)
        if not (args.quick and days > _QUICK_DAYS)
    ]


def _streams(args: argparse.Namespace) -> list[Stream]:
    from rsenf.bench.match_stream import Stream
    from rsenf.cli.bench import grids_of

    folder, seed = grids_of(args), args.first_seed or 0
    return [Stream(s, seed, folder) for s in _STREAMS_S if not args.quick or s <= _CLIP_S]

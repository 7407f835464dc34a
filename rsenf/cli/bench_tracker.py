"""``rsenf bench tracker``: what an hour of video costs after its frames are decoded."""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

_PARTS, _PART_S = 5, 30.0
_QUICK_PARTS, _QUICK_PART_S = 2, 5.0


def run(args: argparse.Namespace) -> int:
    """Measure what is missing, and print the tables."""
    from rsenf.bench.tracker.table import tabulate, text
    from rsenf.bench.tracker.trials import measure_trials, trials
    from rsenf.cli.console import print_json, say
    from rsenf.errors import EXIT_DONE

    parts = args.repeat or (_QUICK_PARTS if args.quick else _PARTS)
    part_s = args.duration_s or (_QUICK_PART_S if args.quick else _PART_S)
    every = trials(parts, part_s, quick=args.quick)
    with tempfile.TemporaryDirectory() as temporary:
        folder, seed = args.out or Path(temporary), args.first_seed or 0
        records = measure_trials(every, folder, seed, lambda key: say(f"measuring: {key}"))
    document = tabulate(records)
    if args.json:
        print_json(document)
    else:
        print(text(document, on_page=args.markdown))
    return EXIT_DONE

"""``rsenf bench feeds``: how many feeds this machine carries."""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

_FIRST = {"480p": 20, "720p": 12, "1080p": 8, "2160p": 1}
_SECONDS, _QUICK_SECONDS = 60.0, 10.0


def run(args: argparse.Namespace) -> int:
    """Add feeds until one falls behind, and print the table.

    Raises
    ------
    UsageError
        For a size or codec that there are no films of.
    """
    from rsenf.batch.journal import read_records
    from rsenf.bench.pipeline.feeds import RESULTS, measure_feeds, tabulate, text
    from rsenf.cli.bench_pipeline import films_of
    from rsenf.cli.console import print_json, say
    from rsenf.errors import EXIT_DONE

    if args.table_only:
        records = list(read_records(args.out / RESULTS).values())
    else:
        seconds = args.duration_s or (_QUICK_SECONDS if args.quick else _SECONDS)
        with tempfile.TemporaryDirectory() as temporary:
            folder = args.out or Path(temporary)
            records = [
                record
                for film in films_of(args, ("1080p",), ("h264",), lambda size: round(seconds * 30))
                for record in measure_feeds(film, args.feeds or _FIRST[film.size], folder, say)
            ]
    document = tabulate(records)
    if args.json:
        print_json(document)
    else:
        print(text(document, on_page=args.markdown))
    return EXIT_DONE

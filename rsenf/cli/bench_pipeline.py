"""``rsenf bench pipeline``: how fast frames go through, beside a bare decoder."""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rsenf.bench.pipeline.films import Film

_ROUNDS = 5
# So many that each takes some seconds to decode.
_FRAMES = {"480p": 6000, "720p": 3600, "1080p": 1800, "2160p": 600}
_QUICK_SIZE, _QUICK_FRAMES = "480p", 300


def run(args: argparse.Namespace) -> int:
    """Time what is missing, and print the tables.

    Raises
    ------
    UsageError
        For a size or codec that there are no films of.
    """
    from rsenf.batch.journal import read_records
    from rsenf.bench.pipeline.contestants import has_ffmpeg
    from rsenf.bench.pipeline.films import CODECS, SIZES
    from rsenf.bench.pipeline.table import tabulate, text
    from rsenf.bench.pipeline.trial import RESULTS, measure_turns, turns
    from rsenf.cli.console import note, print_json, say
    from rsenf.errors import EXIT_DONE

    if args.table_only:
        records = list(read_records(args.out / RESULTS).values())
    else:
        if not has_ffmpeg():
            note("there is no ffmpeg on this machine: everything is compared with PyAV's decoder")
        rounds = args.repeat or (1 if args.quick else _ROUNDS)
        if args.quick:
            films = films_of(args, (_QUICK_SIZE,), CODECS[:1], lambda size: _QUICK_FRAMES)
        else:
            frames = round(30 * args.duration_s) if args.duration_s else 0
            films = films_of(args, tuple(SIZES), CODECS, lambda size: frames or _FRAMES[size])
        with tempfile.TemporaryDirectory() as temporary:
            records = measure_turns(
                turns(films, rounds),
                args.out or Path(temporary),
                lambda key, done, total: say(f"{done + 1}/{total}: {key}"),
            )
    document = tabulate(records)
    if args.json:
        print_json(document)
    else:
        print(text(document, on_page=args.markdown))
    return EXIT_DONE


def films_of(
    args: argparse.Namespace,
    sizes: tuple[str, ...],
    codecs: tuple[str, ...],
    frames: Callable[[str], int],
) -> list[Film]:
    """Return the films that the arguments mean.

    Parameters
    ----------
    args : Namespace
    sizes, codecs : tuple of str
        Unless they are given.
    frames : callable
        How many a film of a size has.

    Raises
    ------
    UsageError
        For a size or codec that there are no films of.
    """
    from rsenf.bench.pipeline.films import CODECS, FILMED, SIZES, Film
    from rsenf.errors import UsageError

    sizes, codecs = args.sizes or sizes, args.codings or codecs
    for given, known, what in ((sizes, SIZES, "size"), (codecs, CODECS, "codec")):
        if unknown := set(given) - set(known):
            raise UsageError(f"no {what} {min(unknown)!r}", f"one of {', '.join(known)}")
    return [
        Film(size, codec, max(frames(size) // FILMED, 1) * FILMED, seed=args.first_seed or 0)
        for size in sizes
        for codec in codecs
    ]

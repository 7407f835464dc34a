"""Tell what an archive has, and where the gaps are.

    rsenf archive recordings
    rsenf archive recordings --camera cam3 --from 10:00 --to 11:00
    rsenf archive recordings --camera cam3 --from 2026-01-15T22:00 --to 2026-01-16T02:00 --json

Times are UTC unless they tell their zone; one without a date is of --day, or of the last day that
there is something of. What has been found out of a file is kept in the archive's index.json.
"""

from __future__ import annotations

import argparse
import re
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rsenf.record.archive.index import Entry
    from rsenf.record.archive.layout import Camera
    from rsenf.record.stretches import Stretch


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.add_argument("archive", type=Path, metavar="DIR")
    parser.add_argument("--site", metavar="NAME", help="(all)")
    parser.add_argument("--camera", metavar="NAME", help="(all)")
    parser.add_argument("--from", dest="from_", metavar="TIME", help="(the first message)")
    parser.add_argument("--to", metavar="TIME", help="(the last message)")
    parser.add_argument("--day", metavar="DATE", help="of times without a date")
    parser.add_argument("--json", action="store_true")


def run(args: argparse.Namespace) -> int:
    """Look into an archive."""
    from rsenf.cli.archive_text import document, words
    from rsenf.cli.console import note, print_json
    from rsenf.record.archive.holdings import holding
    from rsenf.record.archive.index import read_archive

    entries = read_archive(args.archive)
    asked = {camera: _asked(args, entries, camera) for camera in _cameras(args, entries)}
    found = [holding(entries, camera, when) for camera, when in asked.items()]
    if args.json:
        cameras = [document(each, args.archive) for each in found]
        print_json({"archive": str(args.archive), "cameras": cameras})
    elif found:
        print("\n\n".join(words(each, args.archive) for each in found))
    else:
        note(f"{args.archive} holds no recordings; rsenf record --archive makes some")
    return 0


def _cameras(args: argparse.Namespace, entries: list[Entry]) -> list[Camera]:
    from rsenf.errors import UsageError

    every = sorted({entry.file.camera for entry in entries})
    chosen = [c for c in every if args.site in (None, c.site) and args.camera in (None, c.name)]
    if not chosen and (args.site or args.camera):
        wanted = "/".join(filter(None, (args.site, args.camera)))
        there = ", ".join(map(str, every)) or "none"
        raise UsageError(f"{args.archive}: nothing of {wanted!r}", f"its cameras: {there}")
    return chosen


def _asked(args: argparse.Namespace, entries: list[Entry], camera: Camera) -> Stretch:
    """From when to when; where it isn't said, all that there is."""
    from rsenf.errors import UsageError
    from rsenf.record.archive.holdings import extent_of
    from rsenf.record.stretches import Stretch

    starts = [entry.file.start_ns for entry in entries if entry.file.camera == camera]
    all_of_it = extent_of(entries, camera) or Stretch(starts[0], starts[-1])
    first_ns = _time_ns(args, "from_", all_of_it) if args.from_ else all_of_it.first_ns
    last_ns = _time_ns(args, "to", all_of_it) if args.to else all_of_it.last_ns
    if (args.from_ or args.to) and first_ns >= last_ns:
        raise UsageError(f"{camera}: nothing lies between --from and --to", "see 'rsenf archive'")
    return Stretch(first_ns, last_ns)


def _time_ns(args: argparse.Namespace, name: str, all_of_it: Stretch) -> int:
    from rsenf.record.archive.layout import day_of
    from rsenf.reference.moments import utc_ns

    text = getattr(args, name)
    if re.match(r"\d\d:\d\d", text):
        text = f"{args.day or day_of(all_of_it.last_ns)}T{text}"
    return utc_ns(text, f"--{name.rstrip('_')}")

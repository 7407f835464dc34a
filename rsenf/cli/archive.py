"""Tell what an archive has, and where the gaps are.

    rsenf archive recordings
    rsenf archive recordings --camera cam3 --from 10:00 --to 11:00
    rsenf archive recordings --camera cam3 --from 2026-01-15T22:00 --to 2026-01-16T02:00 --json

Times are UTC unless they tell their zone; one without a date is of --day, or of the last day that
there is something of. --from 23:50 --to 00:10 goes past midnight; --day alone is the whole day.

What has been found out of a file is kept in the archive's index.json. Of a file that has its end,
that is believed: damage before it shows with --check, which reads each file once, or to doctor.
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
    parser.add_argument("--check", action="store_true", help="read all of each file, once")
    parser.add_argument("--json", action="store_true")


def run(args: argparse.Namespace) -> int:
    """Look into an archive."""
    from rsenf.cli.archive_text import document, words
    from rsenf.cli.console import note, print_json
    from rsenf.record.archive.holdings import holding
    from rsenf.record.archive.index import read_archive

    entries = read_archive(args.archive, check=args.check)
    cameras = _cameras(args, entries)
    extents = {camera: _all_of(entries, camera) for camera in cameras}
    limits = _limits(args, max((each.last_ns for each in extents.values()), default=0))
    asked = {camera: _asked(limits, extents[camera]) for camera in cameras}
    found = [holding(entries, camera, when) for camera, when in asked.items()]
    if args.json:
        documents = [document(each, args.archive) for each in found]
        print_json({"archive": str(args.archive), "cameras": documents})
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


def _all_of(entries: list[Entry], camera: Camera) -> Stretch:
    """All that there is of a camera; its files' names tell where they can't be read."""
    from rsenf.record.archive.holdings import extent_of
    from rsenf.record.stretches import Stretch

    starts = [entry.file.start_ns for entry in entries if entry.file.camera == camera]
    return extent_of(entries, camera) or Stretch(starts[0], starts[-1])


def _limits(args: argparse.Namespace, latest_ns: int) -> tuple[int | None, int | None]:
    """From when to when, as far as that is said; by the day of the latest message."""
    from rsenf.errors import UsageError
    from rsenf.record.archive.layout import day_of
    from rsenf.reference.moments import utc_ns

    day, day_ns = args.day or day_of(latest_ns), 86_400 * 10**9
    first_ns = last_ns = None
    if args.day:
        if not re.fullmatch(r"\d{4}-\d\d-\d\d", args.day):
            raise UsageError(f"--day {args.day!r} is not a date", "e.g. 2026-01-15")
        first_ns = utc_ns(args.day, "--day")
        last_ns = first_ns + day_ns
    if args.from_:
        first_ns = utc_ns(_dated(args.from_, day), "--from")
    if args.to:
        last_ns = utc_ns(_dated(args.to, day), "--to")
    if first_ns is None or last_ns is None or first_ns < last_ns:
        return first_ns, last_ns
    if first_ns == last_ns or not (_lacks_date(args.from_) and _lacks_date(args.to)):
        raise UsageError("nothing lies between --from and --to", "see 'rsenf archive --help'")
    if args.day or first_ns <= latest_ns:
        return first_ns, last_ns + day_ns
    return first_ns - day_ns, last_ns


def _asked(limits: tuple[int | None, int | None], all_of_it: Stretch) -> Stretch:
    """From when to when; where it isn't said, all that there is of a camera."""
    from rsenf.record.stretches import Stretch

    first_ns, last_ns = limits
    if first_ns is None:
        first_ns = all_of_it.first_ns if last_ns is None else min(all_of_it.first_ns, last_ns)
    if last_ns is None:
        last_ns = max(all_of_it.last_ns, first_ns)
    return Stretch(first_ns, last_ns)


def _lacks_date(text: str | None) -> bool:
    return text is not None and re.match(r"\d\d:\d\d", text) is not None


def _dated(text: str, day: str) -> str:
    return f"{day}T{text}" if _lacks_date(text) else text

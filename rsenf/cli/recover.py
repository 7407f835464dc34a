"""Recover all intact messages of a damaged recording: unfinished, truncated or overwritten.

Damage costs only the chunk that it hit, and the new file lists what was lost. The old one is not
changed; with --in-place it is kept beside the new one, as FILE.damaged. Exit code 0: nothing was
lost; 3: something was, and is listed.
"""

from __future__ import annotations

import argparse


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.add_argument("file", metavar="FILE", help=".mcap recording")
    where = parser.add_mutually_exclusive_group(required=True)
    where.add_argument("--out", metavar="NEW", help="the file to write")
    where.add_argument("--in-place", action="store_true", help="replace FILE, keep FILE.damaged")
    parser.add_argument("--overwrite", action="store_true", help="replace NEW")
    parser.add_argument("--json", action="store_true")


def run(args: argparse.Namespace) -> int:
    """Recover a recording."""
    from rsenf.cli.console import print_json, say
    from rsenf.cli.doctor import lost_words, recording_json
    from rsenf.errors import EXIT_DONE, EXIT_LOSS
    from rsenf.record.recover import recover, recover_in_place

    if args.in_place:
        found, backup = recover_in_place(args.file)
        out = args.file
        say(f"the damaged file is {backup} now")
    else:
        found, out = recover(args.file, args.out, overwrite=args.overwrite), args.out
    lost = lost_words(found)
    if args.json:
        print_json({"out": out, "messages": found.messages, "lost": lost,
                    "found": recording_json(found)})  # fmt: skip
    else:
        print(f"{out}: {found.messages} messages of {len(found.topics)} topics saved")
        for topic, words in lost.items():
            print(f"  {topic}: {words}")
    return EXIT_LOSS if lost else EXIT_DONE

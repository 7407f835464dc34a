"""What is in a recording, is it whole, and if not: what is wrong, what was lost, what to do.

Each file is read from end to end. Exit code 0: all are whole; 3: something is damaged but can be
used; 1: at least one is of no use. One that is being recorded is whole as far as it goes. Numbers
that a topic lacks are lost where the file is damaged; elsewhere they are missing: they never came
to be recorded, or were lost before the file was recovered, and it is whole without them.
"""

from __future__ import annotations

import argparse
from typing import Any


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.add_argument("files", nargs="+", metavar="FILE", help=".mcap recordings")
    parser.add_argument("--json", action="store_true", help="a list with an object for each file")


def run(args: argparse.Namespace) -> int:
    """Examine recordings."""
    from rsenf.cli.console import print_json, say
    from rsenf.cli.recording_text import recording_json, recording_words, unusable_json, verdict
    from rsenf.errors import EXIT_DONE, EXIT_LOSS, InputError, UsageError
    from rsenf.record.examine import examine

    failed = EXIT_DONE
    verdicts: list[str] = []
    shown: list[Any] = []
    for path in args.files:
        try:
            found = examine(path)
        except (InputError, UsageError) as exc:
            failed = max(failed, exc.exit_code)
            shown.append(unusable_json(path, exc))
            say(str(exc))
            continue
        verdicts.append(verdict(found))
        shown.append(recording_json(found))
        if not args.json:
            print(recording_words(found))
    if args.json:
        print_json(shown)
    if "unusable" in verdicts:
        failed = max(failed, InputError.exit_code)
    loss = EXIT_LOSS if "damaged" in verdicts else EXIT_DONE
    return failed or loss

"""Regression test: run every stage on its recorded input, and compare with its recorded output.

Each stage gets the recorded outputs of the stages before it, with the settings in the recording, so
that a difference is located. With the versions and the kind of processor that made the recording,
every bit must agree. With others, differences below a hundredth of the value's standard error, or
from rounding, are tolerated: 'rsenf regress --tolerances' lists the limits. Exit code 1: some
recording differs or can't be compared; all others are still compared.
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
from typing import TYPE_CHECKING

from rsenf.cli.console import print_json, say
from rsenf.errors import EXIT_DONE, EXIT_FAILED, EXIT_LOSS, RsenfError, UsageError

if TYPE_CHECKING:
    from rsenf.regress import Regression, TopicVerdict

MOST_FIELDS = 4  # limit of fields printed for a topic; --json has them all


def add_regress(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.add_argument("recordings", nargs="*", metavar="RECORDING.mcap")
    parser.add_argument(
        "--accept", action="store_true",
        help="record the outputs of those that moved anew, in their place",
    )  # fmt: skip
    parser.add_argument("--reason", metavar="TEXT", help="why they may move; kept in the recording")
    parser.add_argument("--tolerances", action="store_true", help="how far each field may move")
    parser.add_argument("--json", action="store_true", help="what moved, as JSON")


def run_regress(args: argparse.Namespace) -> int:
    """Compare recordings with the stages' present outputs."""
    from rsenf.regress import Regression, accept, regress
    from rsenf.regress.verdict import as_json

    if args.tolerances:
        _print_tolerances()
        return EXIT_DONE
    if not args.recordings:
        raise UsageError("no recording is named", "rsenf regress RECORDING.mcap …")
    if args.accept != bool(args.reason and args.reason.strip()):
        raise UsageError("--accept and --reason go together", "say why the outputs may move")
    results, errors = [], []
    for path in args.recordings:
        result = Regression(path, {}, [], {})
        try:
            result = regress(path)
            if not args.json:
                _print(result)
            if result.loss:
                say(f"{path}: {result.loss}")
            if args.accept and not result.passed:
                accept(result, args.reason)
                say(f"{path}: recorded anew")
        except RsenfError as exc:  # go on with the other recordings
            result = dataclasses.replace(result, error=str(exc))
            errors.append(exc)
        results.append(result)
    if args.json:
        print_json(as_json(results))
    if errors:
        for error in errors[:-1]:
            say(str(error))
        raise errors[-1]
    if not args.accept and not all(result.passed for result in results):
        return EXIT_FAILED
    return EXIT_DONE if all(result.whole for result in results) else EXIT_LOSS


def _print(result: Regression) -> None:
    how = "bit for bit" if result.exact else "within tolerances"
    first = result.first
    outcome = f"moved, and first in {first.stage}" if first else f"as it was, {how}"
    print(f"{result.recording}: {outcome}")
    if result.changed:
        changes = (f"{n} {then} → {now}" for n, (then, now) in result.changed.items())
        print(f"  not the same: {', '.join(changes)}")
    for topic in result.topics:
        _print_topic(topic)
    for name, why in result.left_out.items():
        print(f"  {name}: not run again, {why}")
    sys.stdout.flush()


def _print_topic(topic: TopicVerdict) -> None:
    print(f"  {topic.topic}: {topic.differing} of {topic.messages} messages differ")
    if topic.since:
        when = f", {topic.since.utc}" if topic.since.utc else ""
        frame = f"frame {topic.since.frame}, " if topic.since.frame >= 0 else ""
        print(f"    since message {topic.since.message}: {frame}{topic.since.time_s:.3f} s{when}")
    for name, of in list(topic.fields.items())[:MOST_FIELDS]:
        print(f"    {name} by up to {of.by:.6g} in {of.messages} (allowed: {of.allowed:.3g})")
    if len(topic.fields) > MOST_FIELDS:
        print(f"    and {len(topic.fields) - MOST_FIELDS} more fields")
    if topic.missing or topic.extra:
        print(f"    {topic.missing} did not come again, {topic.extra} had not been there")
    if topic.unjudged:
        print(f"    not judged to its end: {topic.unjudged}")


def _print_tolerances() -> None:
    from rsenf.regress.tolerance import TOLERANCES

    for message, fields in TOLERANCES.items():
        for field, tolerance in fields.items():
            limits = (("", tolerance.absolute), (" of the value", tolerance.relative))
            texts = [f"{value:g}{of}" for of, value in limits if value]
            print(f"{message}.{field}: {' + '.join(texts) or '0'}; {tolerance.why}")
    print("anything else: equal; in words, numbers by one in their last digit")

"""Verbs for who writes programs: regression test, a node of one's own, its contract, completion."""

from __future__ import annotations

import argparse
import dataclasses
import keyword
import sys
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rsenf.cli.console import print_json, say, tell
from rsenf.errors import EXIT_DONE, EXIT_FAILED, EXIT_LOSS, RsenfError, UsageError

if TYPE_CHECKING:
    from rsenf.regress import Regression, TopicVerdict

REGRESS = """\
Regression test: run every stage on its recorded input, and compare with its recorded output.

Each stage gets the recorded outputs of the stages before it, with the settings in the recording, so
that a difference is located. With the versions and the kind of processor that made the recording,
every bit must agree. With others, differences below a hundredth of the value's standard error, or
from rounding, are tolerated: 'rsenf regress --tolerances' lists the limits. Exit code 1: some
recording differs or can't be compared; all others are still compared."""


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
                _print_regression(result)
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


def _print_regression(result: Regression) -> None:
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


NEW_NODE = """\
Write a template of an external node, NAME.py, which runs unchanged.

It reads a camera's estimates and raises alarms; change its stage, and keep the rest."""


TEMPLATE, ITS_NAME = "node_template.py", "own_node.py"
# A script's folder comes first in the module search path: such a file would hide these packages.
TAKEN = ("rsenf", "rsenf_nodes", "zenoh")


def add_new_node(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.add_argument("name", metavar="NAME", help="of the node, and of its file")
    parser.add_argument("--dir", type=Path, default=Path(), metavar="DIR", help="where to (here)")


def run_new_node(args: argparse.Namespace) -> int:
    """Write the file, and print what to do next."""
    name, path = args.name, args.dir / f"{args.name}.py"
    if not name.isidentifier() or keyword.iskeyword(name) or name in TAKEN:
        raise UsageError(f"{name!r} can't be the name of a module", "such as my_band")
    text = files("rsenf.run").joinpath(TEMPLATE).read_text(encoding="utf-8")
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(text.replace(ITS_NAME, path.name))
    except FileExistsError as exc:
        raise UsageError(f"{path} exists already", "choose another name") from exc
    except OSError as exc:
        raise UsageError(f"{path} can't be written: {exc.strerror}", "another --dir") from exc
    print(
        f"{path}: written. It runs as it is:\n"
        f"  rsenf contract --reads cam1/track --sends cam1/alarm -- python {path}\n"
        f"In a graph, under 'nodes':\n"
        f"  {name}: {{kind: external, command: [python, {path}],\n"
        f"    reads: [cam1/track], sends: [cam1/alarm]}}\n"
        f"What nodes owe each other: rsenf explain contract"
    )
    return EXIT_DONE


CONTRACT = """\
Check that a program fulfils the contract of nodes ('rsenf explain contract').

    rsenf contract --reads cam/track --sends cam/alarm -- python my_node.py

The program is started on a private bus (its address is in RSENF_CONNECT), gets valid, broken,
foreign and oversized messages, and is stopped. Exit code 1 if it violates a point."""


def add_contract(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.add_argument("--reads", action="append", default=[], metavar="CAMERA/TOPIC")
    parser.add_argument("--sends", action="append", default=[], metavar="CAMERA/TOPIC")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("command", nargs="+", metavar="COMMAND")


def run_contract(args: argparse.Namespace) -> int:
    """Check a program."""
    from rsenf.run.own_node import check_contract

    checks = check_contract(args.command, args.reads, args.sends)
    lines = [
        f"{'kept  ' if c.passed else 'BROKEN'}  {c.name}"
        + (f": {c.detail}" if c.detail and not c.passed else "")
        for c in checks
    ]
    document = [{"check": c.name, "passed": c.passed, "detail": c.detail} for c in checks]
    tell(args, document, "\n".join(lines))
    return EXIT_DONE if all(check.passed for check in checks) else EXIT_FAILED


COMPLETION = """\
Print a script for shell completion of verbs, options and their values.

eval "$(rsenf completion bash)"                        in ~/.bashrc
rsenf completion zsh > "${fpath[1]}/_rsenf"            once
rsenf completion fish > ~/.config/fish/completions/rsenf.fish"""


def add_completion(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.add_argument("shell", choices=("bash", "zsh", "fish"))


def run_completion(args: argparse.Namespace) -> int:
    """Print the script."""
    import shtab

    from rsenf.cli import VERBS, top_parser, verb_parser

    parser = top_parser()
    verbs = parser.add_subparsers(metavar="VERB")
    for verb in VERBS:
        _complete_files(verb_parser(verb, verbs), shtab.FILE)
    print(shtab.complete(parser, args.shell))
    return EXIT_DONE


def _complete_files(parser: argparse.ArgumentParser, how: Any) -> None:
    """Complete file names for all arguments that are neither choices nor numbers."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for below in action.choices.values():
                _complete_files(below, how)
        elif action.nargs != 0 and not action.choices and action.type in (None, Path):
            action.complete = how  # type: ignore[attr-defined]

"""Verbs for who writes programs: a node of one's own, its contract, and shell completion."""

from __future__ import annotations

import argparse
import keyword
from importlib.resources import files
from pathlib import Path
from typing import Any

from rsenf.cli.console import tell
from rsenf.errors import EXIT_DONE, EXIT_FAILED, UsageError

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

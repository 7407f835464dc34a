"""Print a script for shell completion of verbs, options and their values.

eval "$(rsenf completion bash)"                        in ~/.bashrc
rsenf completion zsh > "${fpath[1]}/_rsenf"            once
rsenf completion fish > ~/.config/fish/completions/rsenf.fish
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.add_argument("shell", choices=("bash", "zsh", "fish"))


def run(args: argparse.Namespace) -> int:
    """Print the script."""
    import shtab

    from rsenf.cli import VERBS, top_parser, verb_parser
    from rsenf.errors import EXIT_DONE

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

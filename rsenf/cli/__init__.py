"""The command line: parses arguments, calls :mod:`rsenf.api` or :mod:`rsenf.run`, prints results.

A verb is two functions: ``add_VERB(parser)`` adds its arguments, and ``run_VERB(args)`` returns the
exit code. They are in the module of its name, or with related verbs in a module of :data:`MODULES`.
Its help text is the text ``VERB`` of that module, or else the module's docstring. A module is
imported only when its verb is called: ``--help`` of all must stay fast. Data go to stdout,
everything else to stderr.

Read this file first, then ``options`` (options generated from settings classes) and ``console``
(arguments, progress bars and output that verbs share); ``track`` is a verb to start with.
"""

from __future__ import annotations

import argparse
import importlib
import io
import itertools
import os
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from types import FrameType
from typing import Any, NoReturn

from rsenf.errors import (
    EXIT_DONE,
    EXIT_FAILED,
    EXIT_INTERRUPTED,
    EXIT_USAGE,
    RsenfError,
    did_you_mean,
)

# Verbs in the order in which a newcomer needs them. Their help lines are here so that
# `rsenf --help` imports none of their modules.
GROUPS = {
    "analyse": {
        "demo": "simulate a clip, run the graph of processes on it, show what comes out",
        "verify": "when was this video taken? Compare its ENF with a grid reference",
        "track": "print the ENF of a video, one value a second",
        "idle": "estimate a camera's idle period and read-out time, or compare two recordings'",
        "camera": "keep the read-out times of known cameras, and weigh which took a recording",
        "discover": "find what a model of the capture lacks of a recording, and add it",
        "batch": "verify, idle, track or discover for folders of recordings, into one table",
        "reference": "keep years of grid frequency in a store: import, list, info, export",
        "simulate": "film a lamp on a known grid with a simulated rolling-shutter camera",
        "tables": "the paper's idle tables and line figures, with its errata and a simulation",
    },
    "live": {
        "live": "was this feed live? Its flicker against the grid, second by second",
        "init": "write a graph that watches your cameras, from their addresses",
        "probe": "look at a camera: what it sends, is its light seen, what to change on it",
        "run": "start the processes of a graph, show their state, stop them cleanly",
        "reload": "have a running graph take its changed file; cameras that stay go on",
        "validate": "check a graph file, and name every problem with its line",
        "dashboard": "show all feeds of a bus on a web page, live",
        "nodes": "tell which nodes are on a bus, and how each is doing",
        "topic": "list the topics of a bus, print their messages, measure their rates",
    },
    "recordings": {
        "record": "write what is on a bus to an MCAP file, or to an archive of them",
        "replay": "play a recording to a bus: any topics, at any speed, from any moment",
        "archive": "tell what an archive of recordings has, and where the gaps are",
        "doctor": "what is in a recording, is it whole, and if not: what was lost, what to do",
        "recover": "save all that is whole in a damaged recording",
        "export": "write a recording's topic as CSV, Parquet, or the light as a sound (WAV)",
        "import": "make a recording of the pictures in another program's MCAP (ROS 2, Foxglove)",
    },
    "develop": {
        "regress": "run recorded stages again, and say what isn't as it was",
        "bench": "measure every estimator on the same simulated clips",
        "new-node": "write a node of your own to begin with",
        "contract": "check that a program keeps to what nodes owe each other",
        "explain": "explain a message, an error or an exit code; write the schemas",
        "completion": "print what makes a shell complete verbs, options and names",
    },
}
VERBS = {verb: line for verbs in GROUPS.values() for verb, line in verbs.items()}
# Modules of verbs that stand with others; any other verb has the module of its own name.
MODULES = {
    "demo": "simulate",
    **dict.fromkeys(("camera", "tables"), "idle"),
    "live": "track",
    "replay": "record",
    "recover": "doctor",
    "import": "export",
    "probe": "init",
    "validate": "run",
    "reload": "run",
    **dict.fromkeys(("topic", "dashboard"), "nodes"),
    **dict.fromkeys(("regress", "new-node", "contract", "completion"), "develop"),
}
HELP = "help"
DEBUG = "--debug"


class _Formatter(argparse.RawDescriptionHelpFormatter):
    """Shows only required arguments in the usage line; all options are listed below it."""

    def _format_usage(self, usage: Any, actions: Any, groups: Any, prefix: Any) -> str:
        one_of = {id(a) for group in groups if group.required for a in group._group_actions}
        must = [a for a in actions if not a.option_strings or a.required or id(a) in one_of]
        text = super()._format_usage(usage, must, groups, prefix)
        if usage or prefix == "":
            return text
        return text.replace(self._prog, f"{self._prog} [OPTION …]", 1)


class Parser(argparse.ArgumentParser):
    """An argument parser whose errors are one line with a hint, and exit code 2."""

    def __init__(self, **how: Any) -> None:
        super().__init__(formatter_class=_Formatter, **how)

    def error(self, message: str) -> NoReturn:
        """Print an error of the arguments, and exit."""
        print(f"rsenf: {message} (see '{self.prog} --help')", file=sys.stderr)
        raise SystemExit(EXIT_USAGE)

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse; report a misspelt option first, rather than arguments missing because of it."""
        if self._subparsers is None:
            for word in itertools.takewhile(lambda word: word != "--", args):
                option, known = word.partition("=")[0], self._option_string_actions
                if option.startswith("--") and not any(o.startswith(option) for o in known):
                    self.error(f"no option {option}{did_you_mean(option, known, after=': ')}")
        return super().parse_known_args(args, namespace)

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is not None and value not in action.choices:
            known = list(map(str, action.choices))
            near = did_you_mean(value, known, after=": ") if isinstance(value, str) else ""
            raise argparse.ArgumentError(action, f"no {value!r}{near} (one of {', '.join(known)})")


def verb_parser(verb: str, to: Any = None) -> Parser:
    """Return the parser of a verb.

    Parameters
    ----------
    verb : str
    to : subparsers action, optional
        What ``add_subparsers`` returned; the parser is added to it.
    """
    module = _module(verb)
    description = getattr(module, verb.replace("-", "_").upper(), module.__doc__)
    parser: Parser = (
        Parser(prog=f"rsenf {verb}", description=description)
        if to is None
        else to.add_parser(verb, help=VERBS[verb], description=description)
    )
    _function("add", verb)(parser)
    # For the help only: main() removes it from the arguments before they are parsed.
    parser.add_argument(DEBUG, action="store_true", help="show the traceback of an error")
    return parser


def _module(verb: str) -> Any:
    return importlib.import_module(f"rsenf.cli.{MODULES.get(verb, verb)}")


def _function(what: str, verb: str) -> Any:
    return getattr(_module(verb), f"{what}_{verb.replace('-', '_')}")


def top_parser() -> Parser:
    """Return the parser of the options before a verb."""
    parser = Parser(
        prog="rsenf",
        usage="rsenf [--version] [--help] [--debug] VERB",
        description="Reads the electric network frequency out of rolling-shutter video.",
        epilog="'rsenf help VERB' tells more.   New here? Start with: rsenf demo",
    )
    parser.add_argument("--version", action="store_true", help="show version and commit")
    parser.add_argument(DEBUG, action="store_true", help="show the traceback of an error")
    return parser


def _print_help() -> None:
    parser = top_parser()
    for heading, verbs in GROUPS.items():
        group = parser.add_argument_group(heading)
        for verb, line in verbs.items():
            group.add_argument(f"_{verb}", nargs="?", metavar=verb, help=line)
    parser.print_help()


def command() -> NoReturn:
    """Run the command ``rsenf``, and end the process."""
    code = main()
    if "zenoh" in sys.modules:
        from rsenf.run.process import end_process

        end_process(code)
    sys.exit(code)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    words = list(sys.argv[1:] if argv is None else argv)
    debug = DEBUG in words
    try:
        with _surroundings():
            code = _call([word for word in words if word != DEBUG])
            sys.stdout.flush()
            return code
    except RsenfError as exc:
        if debug:
            raise
        for line in str(exc).splitlines():
            print(f"rsenf: {line}", file=sys.stderr)
        return exc.exit_code
    except KeyboardInterrupt:
        print("rsenf: interrupted", file=sys.stderr)
        return EXIT_INTERRUPTED
    except BrokenPipeError:
        # The reader of our output has exited ('rsenf track … | head'): nothing to report.
        _forget_stdout()
        return EXIT_FAILED
    except OSError as exc:
        if exc.filename is None:  # probably writing the output failed
            _forget_stdout()
        if debug:
            raise
        where = f"{exc.filename}: " if exc.filename else ""
        print(f"rsenf: {where}{exc.strerror or exc}", file=sys.stderr)
        return EXIT_FAILED


def _call(words: list[str]) -> int:
    try:
        if words and words[0] == HELP:
            words = [*words[1:], "--help"]
        if not words or words[0] in ("-h", "--help"):
            _print_help()
            return EXIT_DONE
        if words[0] == "--version":
            from rsenf.version import version_text

            print(version_text())
            return EXIT_DONE
        verb, *rest = words
        if verb.startswith("-"):
            top_parser().parse_args(words)
        if verb not in VERBS:
            hint = did_you_mean(verb, VERBS, after=": ") or ": see 'rsenf --help'"
            print(f"rsenf: no verb {verb!r}{hint}", file=sys.stderr)
            return EXIT_USAGE
        return int(_function("run", verb)(verb_parser(verb).parse_args(rest)))
    except SystemExit as exc:  # raised by argparse after --help and after an error
        return int(exc.code or 0)


@contextmanager
def _surroundings() -> Iterator[None]:
    """Set up the process for a verb; SIGTERM ends it as Ctrl-C does."""
    # Before NumPy is imported: its threads compete with the decoder's and cost far more than they
    # gain.
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # for terminals without ± and –
    before = signal.signal(signal.SIGTERM, _interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _interrupt(_number: int, _frame: FrameType | None) -> None:
    raise KeyboardInterrupt


def _forget_stdout() -> None:
    """Discard unwritten output; Python would otherwise try again at exit, and print an error."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, sys.stdout.fileno())
    os.close(nowhere)

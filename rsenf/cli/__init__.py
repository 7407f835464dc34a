"""The command line: one verb per file, imported only when it is called."""

from __future__ import annotations

import argparse
import difflib
import importlib
import io
import os
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from types import FrameType
from typing import NoReturn

from rsenf.errors import EXIT_FAILED, EXIT_INTERRUPTED, EXIT_USAGE, RsenfError
from rsenf.version import version_text

# Verbs in the order a newcomer meets them. The module `rsenf.cli.<verb>` does the work; its help
# line stands here so that `rsenf --help` imports none of them.
VERBS = {
    "demo": "simulate a clip, run the graph of processes on it, show what comes out",
    "verify": "when was this video taken? Compare its ENF with a grid reference",
    "track": "print the ENF of a video, one value a second",
    "idle": "estimate a camera's idle period and read-out time, or compare two recordings'",
    "live": "was this feed live? Its flicker against the grid, second by second",
    "tables": "print the paper's idle tables and line figures, with its errata and a simulation",
    "reference": "keep years of grid frequency in a store: import, list, info, export",
    "discover": "find what a model of the capture lacks of a recording, and add it",
    "batch": "verify, idle, track or discover for folders of recordings, into one table",
    "simulate": "film a lamp on a known grid with a simulated rolling-shutter camera",
    "bench": "measure every estimator on the same simulated clips",
    "run": "start the processes of a graph, show their state, stop them cleanly",
    "dashboard": "show all feeds of a bus on a web page, live",
    "nodes": "tell which nodes are on a bus, and how each is doing",
    "topic": "list the topics of a bus, print their messages, measure their rates",
    "validate": "check a graph file, and name every problem with its line",
    "record": "write what is on a bus to an MCAP file, or to an archive of them",
    "doctor": "what is in a recording, is it whole, and if not: what was lost, what to do",
    "recover": "save all that is whole in a damaged recording",
    "archive": "tell what an archive of recordings has, and where the gaps are",
    "replay": "play a recording to a bus: any topics, at any speed, from any moment",
    "regress": "run recorded stages again, and say what isn't as it was",
    "export": "write a recording's topic as CSV, Parquet, or the light as a sound (WAV)",
    "import": "make a recording of the pictures in another program's MCAP (ROS 2, Foxglove)",
    "new-node": "write a node of your own to begin with",
    "contract": "check that a program keeps to what nodes owe each other",
    "explain": "explain a message, an error or an exit code; write the schemas",
}
DEBUG = "--debug"


class _Parser(argparse.ArgumentParser):
    """Errors in one line with a way out, and exit code 2."""

    def error(self, message: str) -> None:  # type: ignore[override]  # it does not return
        print(f"rsenf: {message} (see '{self.prog} --help')", file=sys.stderr)
        raise SystemExit(EXIT_USAGE)


def _parser(prog: str, description: str | None, epilog: str = "") -> _Parser:
    parser = _Parser(
        prog=prog,
        description=description,
        epilog=epilog,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    # Shown only: it is taken out of the words before they are parsed, wherever it stands.
    parser.add_argument(DEBUG, action="store_true", help="show the traceback of an error")
    return parser


def _top_parser() -> _Parser:
    parser = _parser(
        "rsenf",
        "Reads the electric network frequency out of rolling-shutter video.",
        "'rsenf VERB --help' tells more.   New here? Start with: rsenf demo",
    )
    parser.add_argument("--version", action="version", version=version_text())
    verbs = parser.add_argument_group("verbs")
    for verb, line in VERBS.items():
        # Shown only: the verb itself is looked up below, so that a typing error gets a hint.
        verbs.add_argument(f"_{verb}", nargs="?", metavar=verb, help=line, default=None)
    parser.usage = "rsenf [--version] [--help] [--debug] VERB …"
    return parser


def _unknown(verb: str) -> int:
    close = difflib.get_close_matches(verb, VERBS, n=1, cutoff=0.5)
    hint = f"did you mean '{close[0]}'?" if close else "see 'rsenf --help'"
    print(f"rsenf: no verb {verb!r}: {hint}", file=sys.stderr)
    return EXIT_USAGE


def command() -> NoReturn:
    """Run the command ``rsenf``, and end the process."""
    code = main()
    if "zenoh" in sys.modules:
        from rsenf.run.at_end import end_process

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
        # Whoever read our output has gone ('rsenf track … | head'): nothing to say, nobody to hear.
        _forget_stdout()
        return EXIT_FAILED
    except OSError as exc:
        if exc.filename is None:  # as likely as not it was the output that failed
            _forget_stdout()
        if debug:
            raise
        where = f"{exc.filename}: " if exc.filename else ""
        print(f"rsenf: {where}{exc.strerror or exc}", file=sys.stderr)
        return EXIT_FAILED


def _call(words: list[str]) -> int:
    """Call the verb with its arguments."""
    try:
        if not words or words[0].startswith("-"):
            _top_parser().parse_args(words or ["--help"])
            return EXIT_USAGE
        if words[0] not in VERBS:
            return _unknown(words[0])
        module = importlib.import_module(f"rsenf.cli.{words[0].replace('-', '_')}")
        parser = _parser(f"rsenf {words[0]}", module.__doc__)
        module.add_arguments(parser)
        return int(module.run(parser.parse_args(words[1:])))
    except SystemExit as exc:  # argparse's way to end, after --help and after an error
        return int(exc.code or 0)


@contextmanager
def _surroundings() -> Iterator[None]:
    """Set up what every verb needs of its process; a SIGTERM ends a verb as Ctrl-C does."""
    # Set before NumPy is imported: its threads fight the decoder's, and cost many times their gain.
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
    """Let what can't be written go; Python would try again at exit, and complain."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, sys.stdout.fileno())
    os.close(nowhere)

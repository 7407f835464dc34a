"""The command line: one verb per file, imported only when it is called."""

from __future__ import annotations

import argparse
import difflib
import importlib
import os
import sys
from collections.abc import Sequence

from rsenf import __version__
from rsenf.errors import EXIT_FAILED, EXIT_INTERRUPTED, EXIT_USAGE, RsenfError

# Verbs in the order a newcomer meets them. The module `rsenf.cli.<verb>` does the work; its help
# line stands here so that `rsenf --help` imports none of them.
VERBS = {
    "demo": "simulate a clip, run the graph of processes on it, show what comes out",
    "verify": "when was this video taken? Compare its ENF with a grid reference",
    "track": "print the ENF of a video, one value a second",
    "simulate": "film a lamp on a known grid with a simulated rolling-shutter camera",
    "run": "start the processes of a graph, show their state, stop them cleanly",
    "validate": "check a graph file, and name every problem with its line",
    "record": "write what is on a bus to an MCAP file",
    "explain": "explain a message, an error or an exit code; write the schemas",
}


class _Parser(argparse.ArgumentParser):
    """Errors in one line with a way out, and exit code 2."""

    def error(self, message: str) -> None:  # type: ignore[override]  # it does not return
        print(f"rsenf: {message} (see '{self.prog} --help')", file=sys.stderr)
        raise SystemExit(EXIT_USAGE)


def _top_parser() -> _Parser:
    parser = _Parser(
        prog="rsenf",
        description="Reads the electric network frequency out of rolling-shutter video.",
        epilog="'rsenf VERB --help' tells more.   New here? Start with: rsenf demo",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"rsenf {__version__}")
    parser.add_argument("--debug", action="store_true", help="show the traceback of an error")
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


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    words = list(sys.argv[1:] if argv is None else argv)
    debug = bool(words) and words[0] == "--debug"
    if debug:
        words = words[1:]
    if not words or words[0].startswith("-"):
        _top_parser().parse_args(words or ["--help"])
        return EXIT_USAGE
    if words[0] not in VERBS:
        return _unknown(words[0])
    # Set before NumPy is imported: its threads fight the decoder's, and cost many times their gain.
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    module = importlib.import_module(f"rsenf.cli.{words[0]}")
    parser = _Parser(prog=f"rsenf {words[0]}", description=module.__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    module.add_arguments(parser)
    try:
        return int(module.run(parser.parse_args(words[1:])))
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
        sys.stderr.close()
        return EXIT_FAILED


if __name__ == "__main__":
    sys.exit(main())

"""Shared by the verbs: messages on stderr, progress bars, JSON output, common arguments."""

from __future__ import annotations

import argparse
import json
import os
import shlex
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rsenf.cli.options import add_settings, given_by, positive, settings_of
from rsenf.errors import EXIT_DONE, EXIT_LOSS, UsageError

if TYPE_CHECKING:
    from rsenf.api.discover import DiscoverResult
    from rsenf.api.shared import Result
    from rsenf.bus.zenoh_bus import BusSettings
    from rsenf.config import Graph
    from rsenf.reference import Reference
    from rsenf.rows.settings import RowsSettings
    from rsenf.run.inputs import Input
    from rsenf.track import TrackSettings

# The read-out axis is detected from the data, as a camera may be rotated.
EITHER_WAY: dict[str, Any] = {"read_out_axis": "auto"}
# Fields of ReadOptions that are no options here: a reference may be of another grid than the
# nominal frequency given for the recording.
OF_IMPORT = ("nominal_hz", "assumed_hz", "start_utc_ns")
# Environment variable that a run sets for external programs; also useful in a shell.
CONNECT = "RSENF_CONNECT"


@contextmanager
def progress_bar(
    what: str, total: float | None, unit: str = "s of video", *, printing: bool = False
) -> Iterator[Callable[[float], None]]:
    """Show a progress bar on stderr if it is a terminal.

    Parameters
    ----------
    what : str
        Label.
    total : float or None
        Amount to do; None if unknown.
    unit : str
        Its unit.
    printing : bool
        Whether results are printed meanwhile: if they go to a terminal, there is no bar.

    Yields
    ------
    callable
        To be called with the amount done.
    """
    if not sys.stderr.isatty() or (printing and sys.stdout.isatty()):
        yield lambda done: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TimeRemainingColumn

    done = f"{{task.completed:.0f}} {unit}"
    columns = ("{task.description}", BarColumn(), done, TimeRemainingColumn())
    shown_on = Console(stderr=True)  # redirected, what is printed to a file would go there, too
    with Progress(*columns, console=shown_on, transient=True, redirect_stdout=False) as bar:
        task = bar.add_task(what, total=total)
        yield lambda done: bar.update(task, completed=done)


@contextmanager
def stages(first: str) -> Iterator[tuple[Callable[[str], None], Callable[[float], None]]]:
    """Show the present step of a computation; elsewhere than on a terminal a line for each.

    Yields a callable for the description of the next step, and one for the share that is done.
    """
    if not sys.stderr.isatty():
        yield note, lambda share: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TimeElapsedColumn, TimeRemainingColumn

    times = TimeElapsedColumn(), "left:", TimeRemainingColumn()
    columns = (BarColumn(20), *times, "{task.description}")
    with Progress(*columns, console=Console(stderr=True), transient=True) as shown:
        task = shown.add_task(first, total=1.0)
        yield (
            lambda doing: shown.reset(task, total=1.0, description=doing),
            lambda share: shown.update(task, completed=share),
        )


def say(text: str) -> None:
    """Print an error or a status message to stderr."""
    print(f"rsenf: {text}", file=sys.stderr, flush=True)


def say_loss(path: str, found: Result | DiscoverResult) -> int:
    """Print what could not be read of a recording, if anything; return the exit code."""
    if found.loss:
        say(f"{path}: {found.loss}")
    return EXIT_LOSS if found.loss else EXIT_DONE


def note(text: str) -> None:
    """Print a remark to stderr."""
    print(f"note: {text}", file=sys.stderr)


def tell(
    args: argparse.Namespace, document: Any, text: object, remarks: Iterable[str] = ()
) -> None:
    """Print a result: the document as JSON if asked for, else the text and remarks."""
    if args.json:
        print_json(document)
        return
    print(text)
    for line in remarks:
        note(line)


def print_json(value: Any, *, indent: int | None = 2) -> None:
    """Print JSON; raise ValueError for a NaN, which is no valid JSON."""
    print(json.dumps(value, indent=indent, allow_nan=False), flush=True)


def aligned(lines: Sequence[Sequence[str]]) -> str:
    """Return lines of cells with aligned columns; a line may have fewer cells than the first.

    >>> print(aligned([("node", "state"), ("decode", "running"), ("x",)]))
    node    state
    decode  running
    x
    """
    rows = [[*line, *[""] * (len(lines[0]) - len(line))] for line in lines]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    padded = ["  ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)) for row in rows]
    return "\n".join(line.rstrip() for line in padded)


def add_store_verb(verbs: Any, what: str, help_line: str) -> argparse.ArgumentParser:
    """Add what can be done to a store to ``verbs``, of ``add_subparsers``; return its parser."""
    parser: argparse.ArgumentParser = verbs.add_parser(what, help=help_line, description=help_line)
    parser.add_argument("--store", type=Path, metavar="DIR", help="of the store")
    parser.add_argument("--json", action="store_true")
    return parser


def add_recording_arguments(
    parser: argparse.ArgumentParser, *topics: str, leave_out: Sequence[str] = ()
) -> None:
    """Add the arguments of all verbs that read a recording.

    Parameters
    ----------
    parser : ArgumentParser
    *topics : str
        Topics that the verb can begin from; without, rows alone.
    leave_out : sequence of str
        Fields of RowsSettings that become no options.
    """
    if topics:
        parser.add_argument(
            "--from", dest="begin", choices=topics, default="rows",
            help="what to take of an MCAP recording; frames: its video, decoded again (rows)",
        )  # fmt: skip

    parser.add_argument(
        "--frame-rate", dest="frame_rate_hz", type=positive, metavar="HZ",
        help="at which frames are counted, in place of times that are missing or wrong",
    )  # fmt: skip
    parser.add_argument(
        "--effort", choices=("full", "fast", "auto"), default="auto",
        help="of decoding; fast leaves out the codec's loop filter, auto does so while a camera "
        "sends faster than that (auto)",
    )  # fmt: skip
    add_row_arguments(parser, leave_out)


def open_recording(args: argparse.Namespace, path: str) -> Input:
    """Open a recording with the options of the arguments."""
    from rsenf.run.inputs import open_input_file

    begin = getattr(args, "begin", "rows")
    return open_input_file(
        path, camera=args.camera, begin=begin, frame_rate_hz=args.frame_rate_hz, effort=args.effort
    )


def refuse_choice(args: argparse.Namespace) -> None:
    """Raise UsageError for an option that chooses among the streams of a recording."""
    for option, given in (("--camera", args.camera), ("--from", args.begin != "rows")):
        if given:
            raise UsageError(f"{option} is for recordings", "leave it out for a camera's address")


def add_row_arguments(parser: argparse.ArgumentParser, leave_out: Sequence[str] = ()) -> None:
    """Add the arguments of all verbs that sample rows, except for some fields of RowsSettings."""
    from rsenf.rows.settings import RowsSettings

    parser.add_argument("--camera", default="", metavar="NAME", help="of a recording with several")
    parser.add_argument(
        "--nominal-hz", type=float, choices=(50.0, 60.0), help="grid; found from the data otherwise"
    )
    add_settings(parser, "rows", RowsSettings, leave_out=leave_out, **EITHER_WAY)


def row_settings(args: argparse.Namespace) -> RowsSettings:
    """Return the rows settings of the arguments."""
    from rsenf.rows.settings import RowsSettings

    return settings_of(args, RowsSettings, **EITHER_WAY)


def add_track_arguments(
    parser: argparse.ArgumentParser, also: Mapping[str, str] | None = None
) -> None:
    """Add the arguments of all verbs that track ENF; ``also``: further spellings, by field."""
    from rsenf.track import TrackSettings

    add_settings(parser, "ENF", TrackSettings, also=also)


def track_settings(args: argparse.Namespace, matcher: str = "") -> TrackSettings:
    """Return the track settings of the arguments; ``matcher``: the matcher they must suit."""
    from rsenf.api.shared import track_settings
    from rsenf.track import TrackSettings

    return track_settings(given_by(args, TrackSettings), matcher=matcher)


def add_reference_arguments(parser: argparse.ArgumentParser, *, store: bool = True) -> None:
    """Add the arguments of all verbs that read a grid reference; ``store``: or one of a store."""
    from rsenf.reference.readings import ReadOptions

    if store:
        parser.add_argument("--store", metavar="DIR", help="where store:GRID is looked for")
    add_settings(parser, "reference", ReadOptions, leave_out=OF_IMPORT)


def references_of(args: argparse.Namespace) -> list[Reference]:
    """Open the references of ``--reference``."""
    from rsenf.api.shared import open_references

    store = getattr(args, "store", None)
    return open_references(args.reference, store=store, **read_options(args))


def read_options(args: argparse.Namespace) -> dict[str, Any]:
    """Return the options of reading a reference, as keyword arguments."""
    from rsenf.reference.readings import ReadOptions

    given = given_by(args, ReadOptions).items()
    return {
        **{name: value for name, value in given if name not in OF_IMPORT},
        "assumed_hz": getattr(args, "nominal_hz", None),
    }


def add_env(parser: argparse.ArgumentParser) -> None:
    """Add the argument of the verbs that fill a graph's variables from a file."""
    parser.add_argument("--env", type=Path, metavar="FILE",
                        help="with the graph's variables, as lines of NAME=VALUE")  # fmt: skip


def fill_env(args: argparse.Namespace) -> None:
    """Set the environment variables of the ``--env`` file.

    Those that it has no more since the call before are as they were before it.

    Raises
    ------
    UsageError
        When it can't be read, or a line sets no variable; nothing has changed then.
    """
    if args.env is None:
        return
    said: dict[str, str] = {}
    try:
        text = args.env.read_text(encoding="utf-8")
        for number, line in enumerate(text.splitlines(), 1):
            words = shlex.split(line, comments=True)
            if not words:
                continue
            name, equals, value = words[0].partition("=")
            if not (equals and name.isidentifier() and len(words) == 1):
                raise UsageError(f"{args.env}:{number}: no variable", "write NAME='value'")
            said[name] = value
    except (OSError, ValueError) as exc:
        raise UsageError(f"{args.env} can't be read ({exc})") from exc
    before: dict[str, str | None] = vars(args).setdefault("before_env", {})
    for name in before.keys() - said.keys():
        if (value_before := before.pop(name)) is None:
            os.environ.pop(name, None)
        else:
            os.environ[name] = value_before
    for name, value in said.items():
        before.setdefault(name, os.environ.get(name))
        os.environ[name] = value


def add_bus_arguments(parser: argparse.ArgumentParser, *graph: str) -> None:
    """Add the arguments that identify a bus; ``graph``: spellings of the graph file's argument."""
    optional = {} if graph[0].startswith("-") else {"nargs": "?"}
    parser.add_argument(*graph, metavar="GRAPH.yaml", default=None, **optional,  # type: ignore[arg-type]
                        help="whose bus it is, with its certificates")  # fmt: skip
    add_env(parser)
    parser.add_argument("--as", dest="by", metavar="NAME",
                        help="whose certificate to show, where the graph has 'tls'")  # fmt: skip
    parser.add_argument("--connect", action="append", default=[], metavar="ENDPOINT",
                        help=f"of the bus, which 'rsenf run' tells (${CONNECT})")  # fmt: skip
    parser.add_argument("--site", default="*", help="to look at (any)")


def bus_of(args: argparse.Namespace) -> tuple[BusSettings, str, Graph | None]:
    """Return how to connect to the bus, the site to look at, and the graph, if one is named.

    Raises
    ------
    UsageError
        When the arguments don't determine an endpoint, or a certificate is needed and not named.
    """
    from rsenf.bus.zenoh_bus import BusSettings
    from rsenf.config import load_graph
    from rsenf.run.access import certificates
    from rsenf.run.node import bus_settings

    fill_env(args)
    connect = tuple(args.connect or filter(None, [os.environ.get(CONNECT)]))
    if args.graph is None:
        if not connect:
            raise UsageError("which bus?", "--connect ENDPOINT, as 'rsenf run' tells it")
        return BusSettings(connect=connect), args.site, None
    graph = load_graph(args.graph)
    routers = tuple(filter(None, (host.address for host in graph.hosts.values())))
    endpoints = connect or graph.bus.listen or routers
    if not (endpoints or graph.bus.is_elsewhere):
        raise UsageError(
            f"{args.graph} has a bus of its own, wherever a port was free",
            "--connect what 'rsenf run' tells, or give the graph 'bus: {listen: [...]}'",
        )
    settings = bus_settings(graph, endpoints)
    if graph.tls is None or all(endpoint.startswith("tcp/") for endpoint in endpoints):
        return settings, graph.site, graph
    if args.by is None:
        raise UsageError(
            "the hosts of this graph ask for a certificate", "--as NAME: whose to show"
        )
    shown = {**certificates(graph.tls, args.by), **settings.zenoh}
    return replace(settings, zenoh=shown), graph.site, graph

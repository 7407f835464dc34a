"""Verbs on a graph file: run its processes, and check it."""

from __future__ import annotations

import argparse
import contextlib
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rsenf.cli.console import add_env, fill_env, note, print_json, say
from rsenf.cli.options import named
from rsenf.errors import EXIT_DONE, EXIT_LOSS, EXIT_USAGE, NodeFailed, RsenfError, UsageError

if TYPE_CHECKING:
    from rsenf.config import Graph
    from rsenf.run.supervisor import GraphRun


RUN = """\
Start the processes of a graph, show their state, and stop them cleanly.

Ctrl-C stops the sources, lets the other nodes finish their streams, closes the recording and ends
within two seconds; a second Ctrl-C ends everything at once. SIGHUP, or 'rsenf reload', takes a
changed graph file: only nodes whose settings have changed are started again."""


def add_run(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.add_argument("graph", type=Path, metavar="GRAPH.yaml")
    parser.add_argument("--replay", action="append", default=[], type=named, metavar="NODE=FILE",
                        help="play a node's recorded output in its place")  # fmt: skip
    parser.add_argument("--host", default="", metavar="NAME",
                        help="which of the hosts that the graph is split over")  # fmt: skip
    parser.add_argument("--metrics", metavar="HOST:PORT",
                        help="serve /metrics, /healthz, /readyz, as at 127.0.0.1:9464")  # fmt: skip
    add_env(parser)
    parser.add_argument("--log", choices=("auto", "text", "json"), default="auto",
                        help="form of the words on stderr; auto: RSENF_LOG, or text")  # fmt: skip
    parser.add_argument("--json", action="store_true", help="end state and results as JSON")
    parser.add_argument("--quiet", action="store_true", help="say only what goes wrong")


def run_run(args: argparse.Namespace) -> int:
    """Run a graph until it ends or is interrupted."""
    from rsenf.config import load_graph
    from rsenf.report.camera import idle_words
    from rsenf.report.verdict import verdict_words
    from rsenf.run import log
    from rsenf.run.access import telling_refusals
    from rsenf.run.graph_changes import check_exchange, in_words
    from rsenf.run.process import ReloadRequests, hangups, interruptible
    from rsenf.run.supervisor import check_ended, start_graph
    from rsenf.run.view import alarm_line, view_of

    log.ask_for(args.log)

    def tell(text: str) -> None:
        if log.is_json():
            print(log.line("warning", text), file=sys.stderr, flush=True)
        else:
            say(text)

    replayed = dict(args.replay)
    fill_env(args)
    graph = load_graph(args.graph, replayed)
    failure: NodeFailed | None = None
    refusals = telling_refusals(tell) if graph.tls else contextlib.nullcontext()
    with (
        refusals,
        ReloadRequests(args.graph) as requests,
        view_of(graph, quiet=args.quiet) as view,
        hangups() as asked,
        start_graph(graph, args.graph, view.update, args.host) as running,
        _metrics(running, args.metrics),
        interruptible(running.kill) as stop,
    ):

        def exchanged() -> Graph | None:
            if not (requests.pending() or asked.is_set()):
                return None
            asked.clear()
            new = None
            try:
                fill_env(args)
                read = load_graph(args.graph, replayed)
                check_exchange(running.graph, read, args.host)
                new, text = read, f"reloaded: {in_words(running.graph, read)}"
            except RsenfError as exc:
                text = f"not reloaded: {'; '.join(str(exc).splitlines())}"
            tell(text)
            requests.answer(text, accepted=new is not None)
            return new

        view.started(running)
        running.wait(stop, exchanged)
        try:
            code = check_ended(running)
        except NodeFailed as exc:
            failure, code = exc, exc.exit_code
        interrupted = stop.is_set()
    if args.json:
        print_json(_as_json(running))
    else:
        for source, result in running.latest["match"].items():
            print(f"{source}: {verdict_words(result)}")
            for line in result.warnings:
                note(line)
        for source, estimate in running.latest["idle"].items():
            print(f"{source}: {idle_words(estimate)}")
        for source, verdict in running.latest["live"].items():
            print(f"{source}: {verdict.in_short}")
        for source, alarms in running.alarms.items():
            for alarm in alarms:
                print(f"{source}: {alarm_line(running.graph, alarm)}")
        for source, found in running.latest["discover"].items():
            print(f"{source}: {found.in_short}")
    for node in running.nodes.values():
        if node.exit_code == EXIT_LOSS and view.reported.get(node.name) != node.detail:
            tell(f"{node.name}: {node.detail}")
    if failure:
        raise failure
    if interrupted:
        tell("stopped")
    return code


RELOAD = """\
Have a running graph take its changed file, without a stop of the cameras that stay.

The file is checked first. The run then stops the nodes that went, starts the new ones, and starts
those again whose settings have changed. 'site', 'bus', 'hosts', 'tls' and 'access' take a new
start. Its answer is shown; the exit code is 2 if it refuses the file. SIGHUP to the run does the
same, with the answer on its stderr alone."""


def add_reload(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.add_argument("graph", type=Path, metavar="GRAPH.yaml")
    add_env(parser)


def run_reload(args: argparse.Namespace) -> int:
    """Have the runs of a graph on this host take its file; show their answers."""
    from rsenf.config import load_graph
    from rsenf.run.process import ask_to_reload

    fill_env(args)
    load_graph(args.graph)
    answers = ask_to_reload(args.graph)
    if not answers:
        raise UsageError(f"nothing runs {args.graph} on this host", "start it by 'rsenf run'")
    for pid, (accepted, text) in answers.items():
        (print if accepted else say)(f"process {pid}: {text}")
    return EXIT_DONE if all(accepted for accepted, _ in answers.values()) else EXIT_USAGE


def _metrics(running: GraphRun, where: str | None) -> contextlib.AbstractContextManager[object]:
    if where is None:
        return contextlib.nullcontext()
    from rsenf.run.metrics import serving_metrics

    return serving_metrics(running, where)


def _as_json(running: GraphRun) -> dict[str, Any]:
    from rsenf.report.camera import idle_json
    from rsenf.report.discovery import watch_json
    from rsenf.report.verdict import alarm_json, live_json, verdict_json

    def latest(topic: str, as_json: Callable[[Any], dict[str, Any]]) -> dict[str, Any]:
        return {source: as_json(result) for source, result in running.latest[topic].items()}

    return {
        "run_id": running.run_id,
        "nodes": {
            n.name: {"kind": n.kind, "state": n.state, "detail": n.detail, "exit_code": n.exit_code}
            for n in running.nodes.values()
        },
        "results": latest("match", verdict_json),
        "idle": latest("idle", idle_json),
        "live": latest("live", live_json),
        "alarms": {
            source: [alarm_json(alarm) for alarm in alarms]
            for source, alarms in running.alarms.items()
        },
        "discover": latest("discover", watch_json),
    }


VALIDATE = """\
Check a graph file: unknown keys, wrong values, inputs without a sender, replayed recordings."""


def add_validate(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.add_argument("graph", metavar="GRAPH.yaml")
    add_env(parser)
    parser.add_argument("--json", action="store_true", help="the graph as read, as JSON")


def run_validate(args: argparse.Namespace) -> int:
    """Check a graph."""
    from rsenf.config import load_graph, redact
    from rsenf.config.graph import host_of

    fill_env(args)
    graph = load_graph(args.graph)
    for name, node in graph.nodes.items():
        if node.plays and not Path(node.plays).exists():  # it may still be made later
            note(f"node {name!r} plays {node.plays}, which isn't there: not checked")
        else:
            node.check_ready(name, graph.site)
    if args.json:
        print(redact(json.dumps(graph.model_dump(mode="json"), indent=2)))
        return 0
    print(f"{args.graph}: fine. Site {graph.site!r}, {len(graph.nodes)} nodes:")
    for name, node in graph.nodes.items():
        sent = ", ".join(f"{topic} of {of}" for topic, of in node.outputs()) or "nothing"
        where = f"on {host_of(graph, name)}: " if graph.hosts else ""
        print(f"  {name:12} {node.kind:10} {where}sends {sent}")
    return 0

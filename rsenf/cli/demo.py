"""Demonstrate rsenf: simulate a clip, run the graph of processes on it, compare with the truth.

Needs no network, camera, display or router. All files stay in --out: the clip and its truth, the
reference, the graph, the MCAP recording and a picture.
"""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path
from typing import Any

SHORTEST_S, LONGEST_S = 60, 3600


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    from rsenf.cli.options import count, positive

    parser.add_argument("--out", type=Path, default=Path("demo"), metavar="DIR", help="(demo)")
    parser.add_argument("--seed", type=count, default=1, metavar="N",
                        help="of the grid, the camera, the time (1)")  # fmt: skip
    parser.add_argument("--duration-s", type=positive, default=90.0, metavar="S",
                        help="of the clip (90)")  # fmt: skip
    parser.add_argument("--json", action="store_true", help="what came out, as JSON")


def run(args: argparse.Namespace) -> int:
    """Run the demo."""
    from rsenf.api.demo import FILES, compare, make_clip, write_graph
    from rsenf.cli.console import print_json, progress_bar, say
    from rsenf.config import load_graph
    from rsenf.errors import EXIT_DONE, EXIT_FAILED, UsageError
    from rsenf.run.signals import interruptible
    from rsenf.run.supervisor import check_ended, start_graph
    from rsenf.run.view import view_of

    if not SHORTEST_S <= args.duration_s <= LONGEST_S:
        raise UsageError(
            f"--duration-s {args.duration_s:g} suits no demo", f"{SHORTEST_S} to {LONGEST_S}"
        )
    out: Path = args.out
    out.mkdir(parents=True, exist_ok=True)
    paths = {name: out / file for name, file in FILES.items()}
    say("1/3 simulating a clip of a wall under a lamp, on a grid of its own")
    with progress_bar("filming", args.duration_s) as progress:
        start_s = make_clip(paths, args.seed, args.duration_s, progress)
    write_graph(paths)
    say("2/3 running the graph: decode, rows, track, idle, reference, match, record")
    graph = load_graph(paths["graph"])
    with (
        view_of(graph, quiet=args.json) as view,
        start_graph(graph, paths["graph"], view.update) as running,
        interruptible(running.kill) as stop,
    ):
        view.started(running)
        running.wait(stop)
        if stop.is_set():
            raise KeyboardInterrupt
        check_ended(running)
    say("3/3 comparing with the truth")
    summary = compare(paths, start_s)
    if args.json:
        print_json(summary)
    else:
        _tell(summary, paths)
    wrong = summary["verdict"]["decision"] == "match" and not summary["right"]
    return EXIT_FAILED if wrong else EXIT_DONE


def _tell(summary: dict[str, Any], paths: dict[str, Path]) -> None:
    verdict = summary["verdict"]
    rms_mhz, worst_mhz = summary["enf_error_rms_mhz"], summary["enf_error_max_mhz"]
    print(
        f"ENF        {summary['usable']} values, one a second; error against the truth "
        f"{rms_mhz:.2f} mHz rms, {worst_mhz:.2f} mHz at most"
        if rms_mhz is not None
        else "ENF        no usable signal"
    )
    if verdict["decision"] == "match":
        print(
            f"Time       {verdict['start_utc']} ± {verdict['lag_std_s']:.2f} s, found among "
            f"{verdict['search_size']} lags; the truth is {summary['lag_error_s']:+.2f} s away"
        )
    else:
        print(f"Time       {verdict['decision']}: {verdict['reason']}")
    clip, reference = (shlex.quote(str(paths[name])) for name in ("clip", "reference"))
    print(f"Recording  {paths['recording']}   (MCAP: opens in Foxglove)")
    print(f"Picture    {paths['picture']}")
    print(f"Next       rsenf verify {clip} --reference {reference}")

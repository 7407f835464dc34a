"""Measure every method on the same simulated clips, and print how right each was.

    rsenf bench idle     idle-period estimators: error, refusals, spread, time, Cramér–Rao bound
    rsenf bench enf      ENF estimators, on the same clips: one run serves both tables
    rsenf bench claims   scenes with nothing to claim: how often something is claimed
    rsenf bench recording-time   still and moving films cut into clips, each searched for in a day:
                         decisions true, false and none, by every matcher
    rsenf bench calibration   likelihood ratios of the time of recording: how reliable they are
    rsenf bench match    blind searches of a day to ten years of reference: time and memory, beside
                         a loop over all lags and a plain FFT correlation
    rsenf bench pipeline   frames a second from the file to the estimate, processor time, memory and
                         latency: in one process and as a graph, beside ffmpeg's decoder
    rsenf bench feeds    live feeds added until this machine can't carry one more
    rsenf bench tracker  an hour of video after its frames are decoded: processor time and memory by
                         method, rows and frame rate; row means beside copying a plane
    rsenf bench discover   effects hidden in recordings: found and named rightly, wrongly or not at
                         all; false alarms; by how much the gap shrinks
    rsenf bench live     honest feeds and looped, spliced, delayed or exchanged ones: how soon the
                         live verdict tells, and how often falsely, beside a sliding correlation

Each clip is filmed once by the capture model, encoded at every bit rate in the same pass by x264,
decoded and sampled; all methods see the same rows. With --out, results are kept clip by clip, and
a run that was stopped goes on where it was. A second of 720p takes about half a second of one core.
"""

from __future__ import annotations

import argparse
import tempfile
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rsenf.batch.journal import Record
    from rsenf.bench.plan import Clip, Plan

RECORDING_TIME = "recording-time"
CALIBRATION = "calibration"
MATCH = "match"
DISCOVER = "discover"
LIVE = "live"
PIPELINE, FEEDS, TRACKER = "pipeline", "feeds", "tracker"
_TABLES = (
    "idle",
    "enf",
    "claims",
    RECORDING_TIME,
    CALIBRATION,
    MATCH,
    DISCOVER,
    LIVE,
    PIPELINE,
    FEEDS,
    TRACKER,
)
# Measured grids are not part of the project; in a checkout they lie beside it.
_GRIDS = Path("../shared/data")
_QUICK: dict[str, Any] = {
    "sizes": ("240p",),
    "frame_rates": ("25", "29.97"),
    "codings": ("lossless", "50k"),
    "clips": 1,
    "duration_s": 24.0,
}
_CLAIMS: dict[str, Any] = {"clips": 40}  # of each of five scenes
_GIVEN = ("sizes", "frame_rates", "nominals_hz", "codings", "first_seed", "clips", "duration_s")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    from rsenf.cli.options import count, positive

    parser.add_argument("table", choices=_TABLES)
    parser.add_argument("--out", type=Path, metavar="DIR", help="keep results there, and resume")
    parser.add_argument("--quick", action="store_true", help="a few short clips")
    parser.add_argument(
        "--table-only", action="store_true", help="measure nothing: the clips that --out has"
    )
    parser.add_argument("--jobs", type=count, default=2, metavar="N", help="processes (2)")
    parser.add_argument(
        "--only", choices=("films", "trials"),
        help="recording-time: make the films and try nothing yet; or try those that are there",
    )  # fmt: skip
    parser.add_argument(
        "--fit", type=Path, metavar="FILE.json",
        help="calibration, live: make a new one, into a file",
    )  # fmt: skip
    parser.add_argument(
        "--picture", type=Path, metavar="FILE.png", help="calibration, discover, live: draw it"
    )
    parser.add_argument(
        "--repeat", type=count, metavar="N", help="match, pipeline, tracker: times each (5)"
    )
    parser.add_argument(
        "--feeds", type=count, metavar="N", help="feeds: from so many on, one by one"
    )
    parser.add_argument("--hide", type=_words, metavar="LIST", help="discover: these effects only")
    parser.add_argument(
        "--times",
        type=positive,
        metavar="X",
        help="discover: strength over the weakest that is to be named (3)",
    )
    parser.add_argument("--video", action="store_true", help="discover: filmed and encoded")
    how = parser.add_mutually_exclusive_group()
    how.add_argument("--json", action="store_true")
    how.add_argument("--markdown", action="store_true", help="for a page")
    parser.add_argument("--pool-sizes", action="store_true", help="all sizes in one cell")
    plan = parser.add_argument_group("clips")
    plan.add_argument("--seed", type=count, dest="first_seed", metavar="FIRST", help="(0)")
    plan.add_argument(
        "--clips", type=count, metavar="N", help="of each cell or effect (20), scene (40)"
    )
    plan.add_argument("--duration-s", type=positive, metavar="S", help="of each clip (60)")
    plan.add_argument("--sizes", type=_words, metavar="LIST", help="(480p,720p)")
    plan.add_argument("--frame-rates", type=_words, metavar="LIST", help="(23.976,25,29.97,30)")
    plan.add_argument(
        "--nominal-hz", type=_nominals, dest="nominals_hz", metavar="LIST", help="grids (50)"
    )
    plan.add_argument(
        "--codings",
        type=_words,
        metavar="LIST",
        help="(lossless,150k,100k,50k; pipeline, feeds: h264,h265)",
    )
    plan.add_argument(
        "--grids", type=Path, metavar="DIR",
        help=f"measured grids ({_GRIDS} where it is there; synthetic otherwise)",
    )  # fmt: skip


def run(args: argparse.Namespace) -> int:
    """Measure what is missing, and print the table.

    Raises
    ------
    UsageError
        For a plan that can't be meant so.
    """
    from rsenf.bench.document import tabulate
    from rsenf.cli.console import say
    from rsenf.errors import EXIT_DONE, EXIT_FAILED, UsageError

    if args.table_only and not args.out:
        raise UsageError("--table-only without --out", "name the folder of the results")
    if args.table == RECORDING_TIME:
        from rsenf.cli import bench_recording_time

        return bench_recording_time.run(args)
    if args.table == CALIBRATION:
        from rsenf.cli import bench_calibration

        return bench_calibration.run(args)
    if args.table == MATCH:
        from rsenf.cli import bench_match

        return bench_match.run(args)
    if args.table == DISCOVER:
        from rsenf.cli import bench_discover

        return bench_discover.run(args)
    if args.table == LIVE:
        from rsenf.cli import bench_live

        return bench_live.run(args)
    if args.table == PIPELINE:
        from rsenf.cli import bench_pipeline

        return bench_pipeline.run(args)
    if args.table == FEEDS:
        from rsenf.cli import bench_feeds

        return bench_feeds.run(args)
    if args.table == TRACKER:
        from rsenf.cli import bench_tracker

        return bench_tracker.run(args)
    plan = _plan(args)
    clips = plan.nothing() if args.table == "claims" else plan.lit()
    if args.out:
        records = _records(args, clips, args.out)
    else:
        with tempfile.TemporaryDirectory() as folder:
            records = _records(args, clips, Path(folder))
    document = tabulate(args.table, records, pooled=args.pool_sizes)
    _print(args, document)
    broke = sum(row["broke"] for row in document["rows"])
    if broke:
        say(f"methods broke {broke} times: see 'broke' in the results")
    return EXIT_FAILED if broke else EXIT_DONE


def _plan(args: argparse.Namespace) -> Plan:
    from rsenf.bench.plan import Plan

    given: dict[str, Any] = {
        name: getattr(args, name) for name in _GIVEN if getattr(args, name) is not None
    }
    usual = _QUICK if args.quick else _CLAIMS if args.table == "claims" else {}
    return Plan(**(usual | given))


def _records(args: argparse.Namespace, clips: list[Clip], folder: Path) -> list[Record]:
    """Results of lit clips and of those with nothing to claim are different files."""
    from rsenf.batch.journal import read_records
    from rsenf.bench.measure import measure
    from rsenf.bench.session import measure_missing
    from rsenf.cli.console import progress_bar, say

    out = folder / ("claims.jsonl" if args.table == "claims" else "clips.jsonl")
    if args.table_only:
        return list(read_records(out).values())
    grids = grids_of(args)
    with progress_bar("measuring", sum(clip.duration_s for clip in clips)) as bar:

        def progress(done: int, missing: int) -> None:
            if not done:
                say(f"clips to measure: {missing} of {len(clips)}")
            bar(sum(clip.duration_s for clip in clips) * (1 - (missing - done) / len(clips)))

        return measure_missing(
            clips, partial(measure, grids=grids), out, max(args.jobs, 1), progress
        )


def grids_of(args: argparse.Namespace) -> Path | None:
    """Folder of measured grids, where there is one."""
    return args.grids or (_GRIDS if _GRIDS.is_dir() else None)


def _print(args: argparse.Namespace, document: dict[str, Any]) -> None:
    from rsenf.bench.text import page, text
    from rsenf.cli.console import print_json

    if args.json:
        print_json(document)
    elif args.markdown:
        print(page(document))
    else:
        print(text(document))


def _words(value: str) -> tuple[str, ...]:
    return tuple(word.strip() for word in value.split(","))


def _nominals(value: str) -> tuple[float, ...]:
    found = tuple(float(word) for word in value.split(","))
    if not set(found) <= {50.0, 60.0}:
        raise argparse.ArgumentTypeError(f"{value}: 50, 60 or 50,60")
    return found

"""Measure the errors of all methods on the same simulated clips, and print a table.

Each clip is simulated once by the capture model, encoded at every bit rate in the same pass by
x264, decoded and sampled. All methods see the same rows, and are compared with the Cramér–Rao
bound. With --out, results are kept clip by clip, and a stopped run resumes. A second of 720p takes
about 0.5 s of one core. 'rsenf bench TABLE --help' lists the options of a table.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path
from typing import Any

from rsenf.cli.bench_tables import MAKE, USUAL

TABLES = {
    "idle": "idle-period estimators: error, refusals, spread, time, Cramér–Rao bound",
    "enf": "ENF estimators, on the same clips: one run serves both tables",
    "claims": "scenes with nothing to claim: how often something is claimed",
    "cameras": "fleets of 50 cameras with the errors of such clips: which took a recording",
    "recording-time": (
        "still and moving films cut into clips, each searched for in a day: decisions true, false "
        "and none, by every matcher"
    ),
    "calibration": "likelihood ratios of the time of recording: how reliable they are",
    "match": (
        "blind searches of a day to ten years of reference: time and memory, beside a loop over "
        "all lags and a plain FFT correlation"
    ),
    "pipeline": (
        "frames a second from the file to the estimate, processor time, memory and latency: in "
        "one process and as a graph, beside ffmpeg's decoder"
    ),
    "feeds": "live feeds added until this machine can't carry one more",
    "tracker": (
        "an hour of video after its frames are decoded: processor time and memory by method, rows "
        "and frame rate; row means beside copying a plane"
    ),
    "discover": (
        "effects hidden in recordings: found and named rightly, wrongly or not at all; false "
        "alarms; by how much the gap shrinks"
    ),
    "foreign": (
        "every estimator on a camera that shares nothing with rsenf's own model: errors, whether "
        "the stated ones hold, and claims where there is no mains light"
    ),
    "live": (
        "honest feeds and looped, spliced, delayed or exchanged ones: how soon the live verdict "
        "tells, and how often falsely, beside a sliding correlation"
    ),
}
# Measured grids are not part of the project; next to a checkout they are in this folder.
_GRIDS = Path("../shared/data")
_ALSO = {"each": "each", "outside": "unknown"}  # the foreign camera's names


def add_bench(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    from rsenf.bench.discover import Plan as DiscoverPlan
    from rsenf.bench.discover.foreign import CAMERA
    from rsenf.bench.discover.foreign import Plan as ForeignPlan
    from rsenf.bench.foreign import EstimatorPlan
    from rsenf.bench.live import LivePlan
    from rsenf.bench.plan import Plan
    from rsenf.bench.recording_time import RecordingPlan
    from rsenf.cli.options import add_settings, count, many, positive

    words: dict[str, Any] = {"type": many(str), "metavar": "LIST"}
    number: dict[str, Any] = {"type": count, "metavar": "N"}
    seconds: dict[str, Any] = {"type": positive, "metavar": "S"}
    film = {"sizes": words | {"help": "(all; feeds 1080p)"}, "codings": words | {"help": "codecs"}}
    plans = dict.fromkeys(("idle", "enf", "claims", "cameras"), Plan) | {
        "recording-time": RecordingPlan,
        "discover": DiscoverPlan,
        "foreign": EstimatorPlan,
        "live": LivePlan,
    }
    special: dict[str, dict[str, dict[str, Any]]] = {
        "recording-time": {
            "only": {"choices": ("films", "trials"),
                     "help": "make the films and try nothing yet; or try those that are there"},
        },
        "cameras": {"fleets": {**number, "default": 20, "help": "drawn from them (20)"}},
        "calibration": {
            "clips": number | {"help": "searches (400)"},
            "real": number | {"help": "of real clips made worse (200, where they are there)"},
        },
        "match": {"duration-s": seconds | {"help": "of the clip (600)"}},
        "pipeline": film | {"duration-s": seconds | {"help": "of a film (as the size has it)"}},
        "feeds": film | {"duration-s": seconds | {"help": "of a film (60)"},
                         "feeds": number | {"help": "from so many on, one by one"}},
        "tracker": {"duration-s": seconds | {"help": "of each part (30)"}},
        "discover": {
            "foreign": {"type": Path, "nargs": "?", "const": CAMERA, "metavar": "FILE",
                        "help": "hidden by a camera that is none of rsenf's: its folder or file "
                                f"({CAMERA}); 60 outside and 60 pairs then"},
        },
        "foreign": {
            "camera": {"type": Path, "default": CAMERA, "metavar": "FILE",
                       "help": f"its folder or file ({CAMERA})"},
            "methods": words | {"default": (), "help": "of ENF and idle period (all)"},
        },
    }  # fmt: skip
    tables = parser.add_subparsers(dest="table", metavar="TABLE", required=True)
    for name, line in TABLES.items():
        table = tables.add_parser(name, help=line, description=line)
        table.add_argument("--out", type=Path, metavar="DIR", help="keep results there, and resume")
        table.add_argument("--quick", action="store_true", help="a few short clips")
        table.add_argument(
            "--table-only", action="store_true", help="measure nothing: the clips that --out has"
        )
        table.add_argument("--jobs", **{**number, "default": 2}, help="processes (2)")
        table.add_argument(
            "--grids", type=Path, metavar="DIR",
            help=f"measured grids ({_GRIDS} where it is there; synthetic otherwise)",
        )  # fmt: skip
        how = table.add_mutually_exclusive_group()
        how.add_argument("--json", action="store_true")
        how.add_argument("--markdown", action="store_true", help="for a page")
        if name in ("idle", "enf", "claims"):
            table.add_argument("--pool-sizes", action="store_true", help="all sizes in one cell")
        if name in ("calibration", "live"):
            table.add_argument(
                "--fit", type=Path, metavar="FILE.json", help="make a new one, into a file"
            )
        if name in ("calibration", "discover", "foreign", "live"):
            table.add_argument("--picture", type=Path, metavar="FILE.png", help="draw it")
        if name in ("match", "pipeline", "tracker"):
            table.add_argument("--repeat", **number, help="times each (5)")
        for option, given in special.get(name, {}).items():
            table.add_argument(f"--{option}", **given)
        if name in plans:
            usual = USUAL.get(name, {})
            also = _ALSO if name == "discover" else {}
            add_settings(table, "clips", plans[name], also=also, leave_out=("part",), **usual)
        else:
            table.add_argument("--seed", **{**number, "default": 0}, dest="seed", help="first (0)")
        if name == "discover":
            add_settings(table, "clips", ForeignPlan)


def run_bench(args: argparse.Namespace) -> int:
    """Measure the missing results, and print the table.

    Raises
    ------
    UsageError
        For contradictory or invalid options.
    """
    from rsenf.cli.console import print_json, say
    from rsenf.errors import EXIT_DONE, EXIT_FAILED, UsageError

    for option in ("table_only", "only"):
        if getattr(args, option, None) and not args.out:
            raise UsageError(f"--{option} without --out".replace("_", "-"), "name their folder")
    args.grids = args.grids or (_GRIDS if _GRIDS.is_dir() else None)
    with tempfile.TemporaryDirectory() as temporary:
        made = MAKE[args.table](args, args.out or Path(temporary))
    if made is None:
        return EXIT_DONE
    document, written = made
    if args.json:
        print_json(document)
    else:
        print(written(document, on_page=args.markdown))
    broke = sum(row.get("broke", 0) for row in document.get("rows", ()))
    if broke:
        say(f"methods broke {broke} times: see 'broke' in the results")
    return EXIT_FAILED if broke else EXIT_DONE

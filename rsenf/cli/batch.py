"""Run a verb on folders and lists of recordings, and collect the results in one table.

    rsenf batch verify videos/ --reference grid.csv --out results
    rsenf batch idle videos/ more/clip.mp4 --out cameras
    find /archive -name '*.mp4' -print0 | rsenf batch track --list - --out enf

For every recording OUT gets a result, or the reason why there is none: batch.parquet, batch.html to
read, and batch.jsonl, the journal, to which each is appended when done. After a stop, the same
command resumes. Recordings that have changed, failed or could not be read are done again; unusable
ones only with --retry. Local processes do the work, or with --scheduler the workers of a Dask
cluster, which must see the same folders under the same names. 'rsenf batch VERB --help' lists the
options of a verb.
"""

from __future__ import annotations

import argparse
import importlib
import math
import os
import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from rsenf.cli.console import note, progress_bar, read_options, say, tell
from rsenf.cli.options import count, positive
from rsenf.errors import EXIT_FAILED, InputError, UsageError

if TYPE_CHECKING:
    from rsenf.batch.settings import Found, Settings

ANALYSES = ("verify", "idle", "track", "discover")


def add_batch(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    from rsenf.cli.verify import add_reference

    verbs = parser.add_subparsers(dest="analysis", metavar="VERB", required=True)
    for name in ANALYSES:
        verb = verbs.add_parser(name, help=f"as 'rsenf {name}' does, for each recording")
        verb.add_argument("inputs", nargs="*", metavar="IN", help="recordings, and folders of them")
        verb.add_argument("--out", type=Path, metavar="DIR", required=True, help="results")
        verb.add_argument("--list", metavar="FILE", help="more of them, one a line; - for stdin")
        verb.add_argument("--jobs", type=count, metavar="N", help="processes (one for each core)")
        verb.add_argument(
            "--scheduler", metavar="ADDRESS", help="of a Dask cluster that does the work"
        )
        verb.add_argument(
            "--timeout-s", type=positive, metavar="S", help="give a recording up after so long"
        )
        verb.add_argument(
            "--retry", action="store_true", help="do what is unusable again, though unchanged"
        )
        verb.add_argument("--json", action="store_true", help="the summary as JSON")
        if name == "discover":
            verb.add_argument(
                "--one-camera", action="store_true",
                help="all are of one camera: write OUT/camera.yaml, its model, with spreads",
            )  # fmt: skip
        if name == "verify":
            add_reference(verb, required=True)
        importlib.import_module(f"rsenf.cli.{name}").add_settings(verb)


def run_batch(args: argparse.Namespace) -> int:
    """Run the analysis on all recordings."""
    from rsenf.batch.columns import exit_code, summary_of, summary_words, troubles
    from rsenf.batch.run import run_batch
    from rsenf.batch.settings import checked
    from rsenf.decode.source import cores
    from rsenf.discrepancy.fleet import write_camera

    found = _find(args)
    jobs = min(args.jobs or cores(), len(found.recordings))
    settings = checked(_settings(args, threads=1 if args.scheduler else max(1, cores() // jobs)))
    rows = run_batch(
        settings, found.recordings, jobs=jobs, scheduler=args.scheduler or "",
        timeout_s=args.timeout_s or math.inf, retry=args.retry, say=say,
        bar=partial(progress_bar, args.analysis, unit="recordings"),
    )  # fmt: skip
    summary = summary_of(args.analysis, args.out, found, rows)
    problem, path = "", args.out / "camera.yaml"
    if getattr(args, "one_camera", False):
        try:
            common = write_camera(path, [row["model"] for row in rows if row.get("model")])
            summary["camera"] = {"model": str(path), **common}
        except InputError as exc:
            path.unlink(missing_ok=True)  # of an earlier batch
            problem = f"no {path}: {exc}"
            summary["camera"] = {"model": None, "reason": str(exc)}
    tell(args, summary, summary_words(summary))
    if found.passed_over:
        kinds = ", ".join(f"{number} {kind}" for kind, number in summary["passed_over"].items())
        note(f"not named like recordings, passed over: {kinds}")
    if found.again:
        note(f"found under another name too, done once: {found.again}")
    for line in troubles(summary):
        say(line)
    if problem:
        say(problem)
    return EXIT_FAILED if problem else exit_code(rows, found)


def _settings(args: argparse.Namespace, threads: int) -> Settings:
    from rsenf.batch.settings import Settings

    module = importlib.import_module(f"rsenf.cli.{args.analysis}")
    return Settings(
        analysis=args.analysis,
        options=module.options_of(args),
        references=tuple(getattr(args, "reference", None) or ()),
        reading={**read_options(args), "store": getattr(args, "store", None)},
        effects=tuple(getattr(args, "effects", ())),
        begin=getattr(args, "begin", "rows"),
        camera=args.camera,
        frame_rate_hz=args.frame_rate_hz,
        effort=args.effort,
        out=str(args.out),
        threads=threads,
    )


def _find(args: argparse.Namespace) -> Found:
    from rsenf.batch.settings import find_recordings, read_list

    missing = next((path for path in args.inputs if not os.path.lexists(path)), None)
    if missing is not None:
        raise UsageError(f"{missing}: no such file or folder", "look for a misspelling")
    listed = read_list(_read(args.list), args.list) if args.list else []
    if not args.inputs and not listed:
        raise UsageError("no recordings are named", "name files and folders, or give --list FILE")
    if any(os.path.realpath(path) == os.path.realpath(args.out) for path in args.inputs):
        raise UsageError(
            f"--out {args.out} is the folder that is to be read",
            "name one of its own; it may be in it",
        )
    found = find_recordings([*args.inputs, *listed], args.out)
    if not found.recordings:
        passed = f"; {found.passed_over.total()} files are not named like one" * bool(
            found.passed_over
        )
        raise UsageError(
            f"no recordings in {', '.join([*args.inputs, *listed][:3])}{passed}",
            "name the files themselves to have them taken",
        )
    return found


def _read(name: str) -> bytes:
    try:
        return sys.stdin.buffer.read() if name == "-" else Path(name).read_bytes()
    except OSError as exc:
        raise UsageError(f"--list {name}: {exc.strerror}", "give a file of paths") from exc

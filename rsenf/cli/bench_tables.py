"""Tables of ``rsenf bench``: each measures what is missing, and returns a document and its text.

What a table needs is imported when it is made: :mod:`rsenf.cli.bench` shows its help without.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rsenf.batch.journal import Record
    from rsenf.bench.pipeline import Film

    Made = tuple[dict[str, Any], Callable[..., str]]  # a document, and what writes it

_CLAIMS: dict[str, Any] = {"clips": 40}  # for each of five scenes
_CAMERAS: dict[str, Any] = {
    "sizes": ("240p",), "frame_rates": ("23.976", "25", "29.97", "59.94"),
    "codings": ("150k", "100k", "50k"), "clips": 7, "duration_s": 20.0,
}  # fmt: skip
USUAL = {"claims": _CLAIMS, "cameras": _CAMERAS}


def _measured(
    args: argparse.Namespace, tasks: Sequence[Any], work: Callable[[Any], Any], out: Path, what: str
) -> list[Record]:
    """Measure what is missing in a file of results, with a progress bar."""
    from rsenf.bench.harness import measure_missing

    if (kept := _kept(args, out)) is not None:
        return kept
    with _counted(what, len(tasks)) as progress:
        return measure_missing(tasks, work, out, max(args.jobs, 1), progress)


def _kept(args: argparse.Namespace, out: Path) -> list[Record] | None:
    """Return the records of a file, if nothing is to be measured."""
    from rsenf.batch.journal import read_records

    return list(read_records(out).values()) if args.table_only else None


@contextmanager
def _counted(what: str, total: int) -> Iterator[Callable[[int, int], None]]:
    """Print how many results are missing, and show a progress bar."""
    from rsenf.cli.console import progress_bar, say

    with progress_bar(what, total, unit=f"of {total}") as bar:

        def progress(done: int, missing: int) -> None:
            if not done:
                say(f"{what}: {missing} of {total}")
            bar(total - missing + done)

        yield progress


def _drawn(args: argparse.Namespace, draw: Callable[[Path, Any], None], document: Any) -> None:
    from rsenf.cli.console import note

    if args.picture:
        draw(args.picture, document)
        note(f"picture: {args.picture}")


def _fitted(args: argparse.Namespace, fitted: Callable[[], Any]) -> None:
    from rsenf.cli.console import note
    from rsenf.whole_file import whole_file

    if args.fit:
        with whole_file(args.fit) as temporary:
            temporary.write_text(json.dumps(fitted(), indent=2) + "\n", encoding="utf-8")
        note(f"fitted: {args.fit}")


def _clips(args: argparse.Namespace, folder: Path) -> Made:
    from rsenf.bench.cameras_table import tabulated as draw_fleets
    from rsenf.bench.cameras_table import text as fleets_text
    from rsenf.bench.clip_tables import tabulated
    from rsenf.bench.clip_text import text
    from rsenf.bench.measure import measure
    from rsenf.bench.plan import Plan
    from rsenf.cli.options import settings_of

    claims = args.table == "claims"
    usual = USUAL.get(args.table, {})
    if args.quick:
        usual = {"sizes": ("240p",), "frame_rates": ("25", "29.97"),
                 "codings": ("lossless", "50k"), "clips": 1, "duration_s": 24.0}  # fmt: skip
    plan = settings_of(args, Plan, **usual)
    # Results of clips with mains light and without it are kept in different files.
    clips, out = (plan.nothing(), "claims.jsonl") if claims else (plan.lit(), "clips.jsonl")
    records = _measured(args, clips, partial(measure, grids=args.grids), folder / out, "clips")
    if args.table == "cameras":
        return draw_fleets(records, args.fleets, plan.first_seed), fleets_text
    return tabulated(args.table, records, pooled=args.pool_sizes), text


def _recording_time(args: argparse.Namespace, folder: Path) -> Made | None:
    from rsenf.bench.recording_time import RecordingPlan
    from rsenf.bench.recording_time.films import NOISE_HZ, has_film, make_missing
    from rsenf.bench.recording_time.table import tabulated, text
    from rsenf.bench.recording_time.trials import cuts_of, run_trials
    from rsenf.cli.options import settings_of

    usual: dict[str, Any] = {"size": "240p", "codings": ("lossless", "50k"), "clips": 1,
                             "duration_s": 130.0, "reference_s": 4 * 3600.0}  # fmt: skip
    films = settings_of(args, RecordingPlan, **(usual if args.quick else {})).films()
    films_in, grids = folder / "films", args.grids
    if not args.table_only and args.only != "trials":
        with _counted("films to make", len(films)) as progress:
            make_missing(films, films_in, grids, max(args.jobs, 1), progress)
        if args.only == "films":
            return None
    made = [film for film in films if has_film(films_in, film)]
    work = partial(run_trials, films=films_in, grids=grids)
    cuts, out = cuts_of(made, NOISE_HZ), folder / "recording-time.jsonl"
    what = f"cuts of {len(made)} films to try"
    return tabulated(_measured(args, cuts, work, out, what)), text


def _calibration(args: argparse.Namespace, folder: Path) -> Made:
    from rsenf.bench.calibration import table
    from rsenf.bench.calibration.real_clips import there
    from rsenf.bench.calibration.searches import RealSearch, Search, real_searched, searched
    from rsenf.bench.scenes import FIT, TEST
    from rsenf.cli.console import note
    from rsenf.errors import UsageError
    from rsenf.match.calibration import calibration

    if args.grids is None:
        raise UsageError("calibration needs measured grids", "name their folder with --grids")
    count, part = args.clips or (12 if args.quick else 400), FIT if args.fit else TEST
    tasks = [Search(part, args.seed + n, args.grids) for n in range(count)]
    records = _measured(args, tasks, searched, folder / "calibration.jsonl", "searches")
    real = []
    if there(args.grids):
        many = args.real or (12 if args.quick else 200)
        worse = [RealSearch(part, args.seed + n, args.grids) for n in range(many)]
        real = _measured(args, worse, real_searched, folder / "real.jsonl", "real clips")
    else:
        note(f"no real clips in {args.grids}: nothing is said of them")
    lines = table.fitted_lines([*records, *real]) if args.fit else calibration().lines
    document = table.tabulated(lines, records)
    if real:
        document["real"] = table.tabulated(lines, real) | {"damage": table.over_damage(lines, real)}
    _fitted(args, lambda: table.calibration_file(lines, [*records, *real]))
    _drawn(args, table.draw, document)
    return document, table.text


def _match(args: argparse.Namespace, folder: Path) -> Made:
    from rsenf.bench.harness import measure_missing
    from rsenf.bench.match_days import LONGEST_CLIP_S, Haystack
    from rsenf.bench.match_trial import (
        SPANS,
        Stream,
        Trial,
        measure_trials,
        tabulated,
        text,
        timed_stream,
    )
    from rsenf.cli.console import say
    from rsenf.errors import UsageError

    clip_s, shortest_s, grids = round(args.duration_s or 600), 600, args.grids
    if clip_s > LONGEST_CLIP_S:
        raise UsageError(f"a clip of {clip_s} s", f"at most {LONGEST_CLIP_S} s fit a day")
    repeats = args.repeat or (1 if args.quick else 5)
    trials = [
        Trial(Haystack(days, gaps, clip_s, args.seed, grids), repeats)
        for days in SPANS
        for gaps in (False, True)
        if not (args.quick and days > 7)
    ]
    lengths_s = (shortest_s,) if args.quick else (shortest_s, 3600, 3 * 3600, 10 * 3600)
    streams = [Stream(length_s, args.seed, grids) for length_s in lengths_s]
    out = folder / "match.jsonl"
    records = measure_trials(trials, out, lambda trial: say(f"searching: {trial.key}"))
    return tabulated(records, measure_missing(streams, timed_stream, out, 1)), text


def _pipeline(args: argparse.Namespace, folder: Path) -> Made:
    from rsenf.bench.pipeline import CODECS, SIZES
    from rsenf.bench.pipeline.contestants import RESULTS, has_ffmpeg, measure_turns, turns
    from rsenf.bench.pipeline.table import tabulated, text
    from rsenf.cli.console import note, say

    # Enough frames for some seconds of decoding.
    frames = {"480p": 6000, "720p": 3600, "1080p": 1800, "2160p": 600}
    sizes, codecs = list(SIZES), list(CODECS)
    if args.quick:
        frames, sizes, codecs = dict.fromkeys(SIZES, 300), ["480p"], codecs[:1]
    elif args.duration_s:
        frames = dict.fromkeys(SIZES, round(30 * args.duration_s))
    records = _kept(args, folder / RESULTS)
    if records is None:
        if not has_ffmpeg():
            note("there is no ffmpeg on this machine: everything is compared with PyAV's decoder")
        records = measure_turns(
            turns(_films(args, sizes, codecs, frames), args.repeat or (1 if args.quick else 5)),
            folder,
            lambda key, done, total: say(f"{done + 1}/{total}: {key}"),
        )
    return tabulated(records), text


def _feeds(args: argparse.Namespace, folder: Path) -> Made:
    from rsenf.bench.pipeline import SIZES
    from rsenf.bench.pipeline.feeds import RESULTS, measure_feeds, tabulated, text
    from rsenf.cli.console import say

    first = {"480p": 20, "720p": 12, "1080p": 8, "2160p": 1}
    frames = round(30 * (args.duration_s or (10.0 if args.quick else 60.0)))
    records = _kept(args, folder / RESULTS)
    if records is None:
        films = _films(args, ("1080p",), ("h264",), dict.fromkeys(SIZES, frames))
        records = [
            record
            for film in films
            for record in measure_feeds(film, args.feeds or first[film.size], folder, say)
        ]
    return tabulated(records), text


def _films(
    args: argparse.Namespace, sizes: Sequence[str], codecs: Sequence[str], frames: dict[str, int]
) -> list[Film]:
    """Return the films of the arguments; ``sizes`` and ``codecs`` are their defaults."""
    from rsenf.bench.pipeline import CODECS, FILMED, SIZES, Film
    from rsenf.errors import UsageError

    sizes, codecs = args.sizes or sizes, args.codings or codecs
    for given, known, what in ((sizes, SIZES, "size"), (codecs, CODECS, "codec")):
        if unknown := set(given) - set(known):
            raise UsageError(f"no {what} {min(unknown)!r}", f"one of {', '.join(known)}")
    return [
        Film(size, codec, max(frames[size] // FILMED, 1) * FILMED, seed=args.seed)
        for size in sizes
        for codec in codecs
    ]


def _tracker(args: argparse.Namespace, folder: Path) -> Made:
    from rsenf.bench.tracker import measure_trials, tabulated, text, trials
    from rsenf.cli.console import say

    parts, part_s = (2, 5.0) if args.quick else (5, 30.0)
    every = trials(args.repeat or parts, args.duration_s or part_s, quick=args.quick)
    records = measure_trials(every, folder, args.seed, lambda key: say(f"measuring: {key}"))
    return tabulated(records), text


def _discover(args: argparse.Namespace, folder: Path) -> Made:
    if args.foreign:
        return _foreign(args, folder)
    from rsenf.bench.discover import Plan, left_out, listed
    from rsenf.bench.discover.beside import SKEW, clock_cases, tried
    from rsenf.bench.discover.table import draw, tabulated, text
    from rsenf.cli.options import settings_of
    from rsenf.errors import UsageError

    for option in ("triples", "rows"):
        if getattr(args, option) is not None:
            raise UsageError(f"--{option} without --foreign", "only a foreign camera has it")
    hidden = _hidden(args, (*listed(), SKEW), left_out())
    if hidden:
        args.hide = [name for name in hidden if name != SKEW]
    usual: dict[str, Any] = {"duration_s": 30.0} if args.video else {}
    each = 20 if args.clips is None else args.clips
    many = 0 if hidden or args.video else each
    usual |= {"none": 5 * many, "outside": 2 * many, "pairs": 2 * many}
    if args.quick:
        usual = {"each": 1, "none": 1, "outside": 1, "pairs": 0, "duration_s": 27.0,
                 "effects": ("harmonics", "frame_drop", "timestamp_jitter")}  # fmt: skip
    plan = settings_of(args, Plan, **usual)
    cases = plan.cases()
    if not (args.quick or args.video or (hidden and SKEW not in hidden)):
        # Cases with a reference use the seeds that follow the others'.
        cases += clock_cases(plan.each, plan.first_seed + len(cases), plan.duration_s)
    work = partial(tried, grids=args.grids)
    document = tabulated(_measured(args, cases, work, folder / "discover.jsonl", "cases"))
    _drawn(args, draw, document)
    return document, text


def _foreign(args: argparse.Namespace, folder: Path) -> Made:
    from rsenf.bench.discover.foreign import Plan, camera_at, left_out, listed, tried
    from rsenf.bench.discover.table import draw
    from rsenf.bench.discover.table import foreign_tabulated as tabulated
    from rsenf.bench.discover.table import foreign_text as text
    from rsenf.cli.options import settings_of

    camera = camera_at(args.foreign.absolute())
    hidden = _hidden(args, (*listed(camera), *camera.UNKNOWN), left_out(camera))
    many = 0 if hidden else 20 if args.clips is None else args.clips
    usual: dict[str, Any] = {"none": 5 * many, "outside": 3 * many, "pairs": 3 * many}
    usual["triples"] = many
    if args.quick:
        usual = {"each": 1, "none": 1, "outside": 1, "pairs": 0, "triples": 0, "rows": 240,
                 "effects": ("harmonics", "frame_drop", "timestamp_jitter"),
                 "duration_s": 27.0}  # fmt: skip
    cases = settings_of(args, Plan, **usual).cases_of(camera)
    work = partial(tried, path=args.foreign.absolute())
    document = tabulated(_measured(args, cases, work, folder / "foreign.jsonl", "cases"))
    _drawn(args, draw, document)
    return document, text


def _hidden(
    args: argparse.Namespace, can: Sequence[str], left_out: dict[str, str]
) -> Sequence[str]:
    """Return the effects of --hide; without it, note which ones aren't hidden, and why."""
    from rsenf.cli.console import note
    from rsenf.errors import UsageError

    hidden: Sequence[str] = args.hide or ()
    if unknown := set(hidden) - set(can):
        why = left_out.get(min(unknown), "it is no effect")
        raise UsageError(f"--hide {min(unknown)}: {why}", f"one of {', '.join(can)}")
    if not (hidden or args.quick):
        for name, why in left_out.items():
            note(f"not hidden among the others: {name}: {why}")
    return hidden


def _estimators(args: argparse.Namespace, folder: Path) -> Made:
    from rsenf.bench.discover.foreign import camera_at
    from rsenf.bench.foreign import NEEDED, EstimatorPlan, tasks_of, tried
    from rsenf.bench.foreign.table import draw, tabulated, text
    from rsenf.cli.options import settings_of

    usual: dict[str, Any] = {}
    if args.quick:
        usual = {"raw": 2, "coded": 0, "nothing": 1, "duration_s": 24.0}
    path = args.camera.absolute()
    cases = settings_of(args, EstimatorPlan, **usual).cases(camera_at(path, NEEDED))
    tasks = tasks_of(cases, args.methods)
    work = partial(tried, path=path)
    records = _measured(args, tasks, work, folder / "estimators.jsonl", "cases")
    methods = {task.method for task in tasks}
    document = tabulated([record for record in records if record["method"] in methods])
    _drawn(args, draw, document)
    return document, text


def _live(args: argparse.Namespace, folder: Path) -> Made:
    from rsenf.bench.live import LivePlan
    from rsenf.bench.live.rules import watched
    from rsenf.bench.live.table import draw, limits_file, tabulated, text
    from rsenf.bench.scenes import FIT, TEST
    from rsenf.cli.options import settings_of

    usual: dict[str, Any] = {"clips": 9, "duration_s": 180.0} if args.quick else {}
    feeds = settings_of(args, LivePlan, **usual, part=FIT if args.fit else TEST).feeds()
    kept = folder / "estimates" if args.out else None
    work = partial(watched, grids=args.grids, kept=kept)
    records = _measured(args, feeds, work, folder / "live.jsonl", "feeds")
    document = tabulated(records)
    _fitted(args, lambda: limits_file(records))
    _drawn(args, draw, document)
    return document, text


MAKE: dict[str, Callable[[argparse.Namespace, Path], Made | None]] = {
    **dict.fromkeys(("idle", "enf", "claims", "cameras"), _clips),
    "recording-time": _recording_time,
    "calibration": _calibration,
    "match": _match,
    "pipeline": _pipeline,
    "feeds": _feeds,
    "tracker": _tracker,
    "discover": _discover,
    "foreign": _estimators,
    "live": _live,
}

"""Measure the errors of all methods on the same simulated clips, and print a table.

Each clip is simulated once by the capture model, encoded at every bit rate in the same pass by
x264, decoded and sampled. All methods see the same rows, and are compared with the Cramér–Rao
bound. With --out, results are kept clip by clip, and a stopped run resumes. A second of 720p takes
about 0.5 s of one core. 'rsenf bench TABLE --help' lists the options of a table.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rsenf.batch.journal import Record
    from rsenf.bench.pipeline.films import Film

    Made = tuple[dict[str, Any], Callable[[dict[str, Any], bool], str]]

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
_CLAIMS: dict[str, Any] = {"clips": 40}  # for each of five scenes
_CAMERAS: dict[str, Any] = {
    "sizes": ("240p",), "frame_rates": ("23.976", "25", "29.97", "59.94"),
    "codings": ("150k", "100k", "50k"), "clips": 7, "duration_s": 20.0,
}  # fmt: skip
_USUAL = {"claims": _CLAIMS, "cameras": _CAMERAS}
_ALSO = {"each": "each", "outside": "unknown"}  # the foreign camera's names


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    from rsenf.bench.discover.foreign import CAMERA
    from rsenf.bench.discover.foreign import Plan as ForeignPlan
    from rsenf.bench.discover.plan import Plan as DiscoverPlan
    from rsenf.bench.foreign.plan import EstimatorPlan
    from rsenf.bench.live.plan import LivePlan
    from rsenf.bench.plan import Plan
    from rsenf.bench.recording_time.plan import RecordingPlan
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
    own: dict[str, dict[str, dict[str, Any]]] = {
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
        for option, given in own.get(name, {}).items():
            table.add_argument(f"--{option}", **given)
        if name in plans:
            usual = _USUAL.get(name, {})
            also = _ALSO if name == "discover" else {}
            add_settings(table, "clips", plans[name], also=also, leave_out=("part",), **usual)
        else:
            table.add_argument("--seed", **{**number, "default": 0}, dest="seed", help="first (0)")
        if name == "discover":
            add_settings(table, "clips", ForeignPlan)


def run(args: argparse.Namespace) -> int:
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
        made = _MAKE[args.table](args, args.out or Path(temporary))
    if made is None:
        return EXIT_DONE
    document, written = made
    if args.json:
        print_json(document)
    else:
        print(written(document, args.markdown))
    broke = sum(row.get("broke", 0) for row in document.get("rows", ()))
    if broke:
        say(f"methods broke {broke} times: see 'broke' in the results")
    return EXIT_FAILED if broke else EXIT_DONE


def _measured(
    args: argparse.Namespace, tasks: Sequence[Any], work: Callable[[Any], Any], out: Path, what: str
) -> list[Record]:
    """Measure what is missing in a file of results, with a progress bar."""
    from rsenf.batch.journal import read_records
    from rsenf.bench.session import measure_missing

    if args.table_only:
        return list(read_records(out).values())
    with _counted(what, len(tasks)) as progress:
        return measure_missing(tasks, work, out, max(args.jobs, 1), progress)


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
    from rsenf.bench.cameras_table import tabulate as draw_fleets
    from rsenf.bench.cameras_table import text as fleets
    from rsenf.bench.document import tabulate
    from rsenf.bench.measure import measure
    from rsenf.bench.plan import Plan
    from rsenf.bench.text import page, text
    from rsenf.cli.options import settings_of

    claims = args.table == "claims"
    usual = _USUAL.get(args.table, {})
    if args.quick:
        usual = {"sizes": ("240p",), "frame_rates": ("25", "29.97"),
                 "codings": ("lossless", "50k"), "clips": 1, "duration_s": 24.0}  # fmt: skip
    plan = settings_of(args, Plan, **usual)
    # Results of clips with mains light and without it are kept in different files.
    clips, out = (plan.nothing(), "claims.jsonl") if claims else (plan.lit(), "clips.jsonl")
    records = _measured(args, clips, partial(measure, grids=args.grids), folder / out, "clips")
    if args.table == "cameras":
        return draw_fleets(records, args.fleets, plan.first_seed), lambda told, on_page: fleets(
            told
        )
    document = tabulate(args.table, records, pooled=args.pool_sizes)
    return document, lambda told, on_page: page(told) if on_page else text(told)


def _recording_time(args: argparse.Namespace, folder: Path) -> Made | None:
    from rsenf.bench.recording_time.document import tabulate
    from rsenf.bench.recording_time.films import has_film
    from rsenf.bench.recording_time.plan import RecordingPlan
    from rsenf.bench.recording_time.references import NOISE_HZ
    from rsenf.bench.recording_time.session import cuts_of, make_missing
    from rsenf.bench.recording_time.text import page, text
    from rsenf.bench.recording_time.trials import run_trials
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
    document = tabulate(_measured(args, cuts, work, out, what))
    return document, lambda told, on_page: page(told) if on_page else text(told)


def _calibration(args: argparse.Namespace, folder: Path) -> Made:
    from rsenf.bench.calibration.damage import damage_text, over_damage
    from rsenf.bench.calibration.grids import FIT, TEST
    from rsenf.bench.calibration.picture import draw
    from rsenf.bench.calibration.real_clips import there
    from rsenf.bench.calibration.searches import RealSearch, Search, real_searched, searched
    from rsenf.bench.calibration.table import calibration_file, fitted_lines, tabulated, text
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
    lines = fitted_lines([*records, *real]) if args.fit else calibration().lines
    document = tabulated(lines, records)
    if real:
        document["real"] = tabulated(lines, real) | {"damage": over_damage(lines, real)}
    _fitted(args, lambda: calibration_file(lines, [*records, *real]))
    _drawn(args, draw, document)

    def written(told: dict[str, Any], on_page: bool) -> str:
        parts = [text(told)]
        if "real" in told:
            parts += [text(told["real"]), damage_text(told["real"]["damage"])]
        return "\n\n".join(parts)

    return document, written


def _match(args: argparse.Namespace, folder: Path) -> Made:
    from rsenf.bench.match_days import LONGEST_CLIP_S, Haystack
    from rsenf.bench.match_stream import Stream, timed_stream
    from rsenf.bench.match_table import SPANS, page, tabulate, text
    from rsenf.bench.match_trial import Trial, measure_trials
    from rsenf.bench.session import measure_missing
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
    document = tabulate(records, measure_missing(streams, timed_stream, out, 1))
    return document, lambda told, on_page: page(told) if on_page else text(told)


def _pipeline(args: argparse.Namespace, folder: Path) -> Made:
    from rsenf.batch.journal import read_records
    from rsenf.bench.pipeline.contestants import has_ffmpeg
    from rsenf.bench.pipeline.films import CODECS, SIZES
    from rsenf.bench.pipeline.table import tabulate, text
    from rsenf.bench.pipeline.trial import RESULTS, measure_turns, turns
    from rsenf.cli.console import note, say

    # Enough frames for some seconds of decoding.
    frames = {"480p": 6000, "720p": 3600, "1080p": 1800, "2160p": 600}
    sizes, codecs = list(SIZES), list(CODECS)
    if args.quick:
        frames, sizes, codecs = dict.fromkeys(SIZES, 300), ["480p"], codecs[:1]
    elif args.duration_s:
        frames = dict.fromkeys(SIZES, round(30 * args.duration_s))
    if args.table_only:
        records = list(read_records(folder / RESULTS).values())
    else:
        if not has_ffmpeg():
            note("there is no ffmpeg on this machine: everything is compared with PyAV's decoder")
        records = measure_turns(
            turns(_films(args, sizes, codecs, frames), args.repeat or (1 if args.quick else 5)),
            folder,
            lambda key, done, total: say(f"{done + 1}/{total}: {key}"),
        )
    return tabulate(records), lambda told, on_page: text(told, on_page=on_page)


def _feeds(args: argparse.Namespace, folder: Path) -> Made:
    from rsenf.batch.journal import read_records
    from rsenf.bench.pipeline.feeds import RESULTS, measure_feeds, tabulate, text
    from rsenf.bench.pipeline.films import SIZES
    from rsenf.cli.console import say

    first = {"480p": 20, "720p": 12, "1080p": 8, "2160p": 1}
    frames = round(30 * (args.duration_s or (10.0 if args.quick else 60.0)))
    if args.table_only:
        records = list(read_records(folder / RESULTS).values())
    else:
        films = _films(args, ("1080p",), ("h264",), dict.fromkeys(SIZES, frames))
        records = [
            record
            for film in films
            for record in measure_feeds(film, args.feeds or first[film.size], folder, say)
        ]
    return tabulate(records), lambda told, on_page: text(told, on_page=on_page)


def _films(
    args: argparse.Namespace, sizes: Sequence[str], codecs: Sequence[str], frames: dict[str, int]
) -> list[Film]:
    """Return the films of the arguments; ``sizes`` and ``codecs`` are their defaults."""
    from rsenf.bench.pipeline.films import CODECS, FILMED, SIZES, Film
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
    from rsenf.bench.tracker.table import tabulate, text
    from rsenf.bench.tracker.trials import measure_trials, trials
    from rsenf.cli.console import say

    parts, part_s = (2, 5.0) if args.quick else (5, 30.0)
    every = trials(args.repeat or parts, args.duration_s or part_s, quick=args.quick)
    records = measure_trials(every, folder, args.seed, lambda key: say(f"measuring: {key}"))
    return tabulate(records), lambda told, on_page: text(told, on_page=on_page)


def _discover(args: argparse.Namespace, folder: Path) -> Made:
    if args.foreign:
        return _foreign(args, folder)
    from rsenf.bench.discover.beside import SKEW, clock_cases, tried
    from rsenf.bench.discover.picture import draw
    from rsenf.bench.discover.plan import Plan, left_out, listed
    from rsenf.bench.discover.table import tabulated, text
    from rsenf.cli.console import note
    from rsenf.cli.options import settings_of
    from rsenf.errors import UsageError

    for option in ("triples", "rows"):
        if getattr(args, option) is not None:
            raise UsageError(f"--{option} without --foreign", "only a foreign camera has it")
    can, hidden = (*listed(), SKEW), args.hide
    if unknown := set(hidden or ()) - set(can):
        why = left_out().get(min(unknown), "it is no effect")
        raise UsageError(f"--hide {min(unknown)}: {why}", f"one of {', '.join(can)}")
    if hidden:
        args.hide = [name for name in hidden if name != SKEW]
    elif not args.quick:
        for name, why in left_out().items():
            note(f"not hidden among the others: {name}: {why}")
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
    return document, lambda told, on_page: text(told, on_page=on_page)


def _foreign(args: argparse.Namespace, folder: Path) -> Made:
    from rsenf.bench.discover.foreign import Plan, camera_at, left_out, listed, tried
    from rsenf.bench.discover.foreign_table import tabulated, text
    from rsenf.bench.discover.picture import draw
    from rsenf.cli.console import note
    from rsenf.cli.options import settings_of
    from rsenf.errors import UsageError

    camera, hidden = camera_at(args.foreign.absolute()), args.hide
    can = (*listed(camera), *camera.UNKNOWN)
    if unknown := set(hidden or ()) - set(can):
        why = left_out(camera).get(min(unknown), "it is no effect")
        raise UsageError(f"--hide {min(unknown)}: {why}", f"one of {', '.join(can)}")
    if not (hidden or args.quick):
        for name, why in left_out(camera).items():
            note(f"not hidden among the others: {name}: {why}")
    many = 0 if hidden else 20 if args.clips is None else args.clips
    usual: dict[str, Any] = {"none": 5 * many, "outside": 3 * many, "pairs": 3 * many}
    usual["triples"] = many
    if args.quick:
        usual = {"each": 1, "none": 1, "outside": 1, "pairs": 0, "triples": 0, "rows": 240,
                 "effects": ("harmonics", "frame_drop", "timestamp_jitter"),
                 "duration_s": 27.0}  # fmt: skip
    cases = settings_of(args, Plan, **usual).cases(camera)
    work = partial(tried, path=args.foreign.absolute())
    document = tabulated(_measured(args, cases, work, folder / "foreign.jsonl", "cases"))
    _drawn(args, draw, document)
    return document, lambda told, on_page: text(told, on_page=on_page)


def _estimators(args: argparse.Namespace, folder: Path) -> Made:
    from rsenf.bench.discover.foreign import camera_at
    from rsenf.bench.foreign.picture import draw
    from rsenf.bench.foreign.plan import NEEDED, EstimatorPlan, tasks_of, tried
    from rsenf.bench.foreign.table import tabulated, text
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
    return document, lambda told, on_page: text(told, on_page=on_page)


def _live(args: argparse.Namespace, folder: Path) -> Made:
    from rsenf.bench.calibration.grids import FIT, TEST
    from rsenf.bench.live.fit import limits_file
    from rsenf.bench.live.picture import draw
    from rsenf.bench.live.plan import LivePlan
    from rsenf.bench.live.table import tabulated
    from rsenf.bench.live.text import page, text
    from rsenf.bench.live.trials import watched
    from rsenf.cli.options import settings_of

    usual: dict[str, Any] = {"clips": 9, "duration_s": 180.0} if args.quick else {}
    feeds = settings_of(args, LivePlan, **usual, part=FIT if args.fit else TEST).feeds()
    kept = folder / "estimates" if args.out else None
    work = partial(watched, grids=args.grids, kept=kept)
    records = _measured(args, feeds, work, folder / "live.jsonl", "feeds")
    document = tabulated(records)
    _fitted(args, lambda: limits_file(records))
    _drawn(args, draw, document)
    return document, lambda told, on_page: page(told) if on_page else text(told)


_MAKE: dict[str, Callable[[argparse.Namespace, Path], Made | None]] = {
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

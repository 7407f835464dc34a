"""Verbs on a camera's idle period: estimate it, identify a camera by it, the paper's tables."""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rsenf.cli import console, options
from rsenf.errors import EXIT_DONE

if TYPE_CHECKING:
    from rsenf.api.idle import IdleResult


IDLE = """\
Estimate the idle period and read-out time of the camera from the flicker of mains light.

The verdict is 'estimated', or why there is no value: 'ambiguous' (more than one fits), 'no_signal'
(no flicker of mains light), 'refused' (the recording doesn't allow a reliable answer).

With two recordings: do they have the same read-out time? If the difference exceeds the errors, they
come from different cameras, or modes of one camera; equal read-out times prove nothing."""


def add_idle(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.add_argument("input", metavar="IN", help="video, .mcap recording or .npz luminance")
    parser.add_argument("other", nargs="?", metavar="OTHER", help="another, to compare it with")
    parser.add_argument("--json", action="store_true", help="the estimate as JSON")
    add_settings(parser)


def add_settings(parser: argparse.ArgumentParser) -> None:
    """Add the arguments that say how the idle period is estimated."""
    from rsenf.idle import IdleSettings

    console.add_recording_arguments(parser, "frames", "rows")
    options.add_settings(parser, "idle", IdleSettings, also={"method": "method"})


def run_idle(args: argparse.Namespace) -> int:
    """Estimate a recording's idle period, or compare two recordings."""
    from rsenf.api.idle import compare_idle

    paths = [path for path in (args.input, args.other) if path is not None]
    found = [estimated(args, path) for path in paths]
    compared = compare_idle(*found) if len(found) == 2 else None
    if args.json:
        doc = compared.to_dict() | {"recordings": paths} if compared else found[0].to_dict()
        console.print_json(doc)
    else:
        for path, one in zip(paths, found, strict=True):
            print(f"{path}: " * (len(paths) > 1) + str(one))
            for line in one.remarks:
                console.note(line)
        if compared:
            print(compared)
    return max(map(console.say_loss, paths, found))


def estimated(args: argparse.Namespace, path: str) -> IdleResult:
    """Estimate the idle period of a recording, with a progress bar."""
    from rsenf.api.idle import idle

    options = options_of(args)
    recording = console.open_recording(args, path)
    with console.progress_bar("estimating", recording.duration_s) as progress:
        return idle(recording, **options, progress=progress)


def options_of(args: argparse.Namespace) -> dict[str, Any]:
    """Return the keyword arguments of :func:`rsenf.api.idle.idle` for the estimation."""
    from rsenf.api.idle import idle_settings
    from rsenf.idle import IdleSettings

    settings = idle_settings(options.settings_of(args, IdleSettings))
    return {"rows": console.row_settings(args), "settings": settings}


CAMERA = """\
Which camera made a recording? Compare its read-out time with those of known cameras.

    rsenf camera add NAME FILE…    store the read-out times of a camera's recordings
    rsenf camera list              cameras by mode: frame rate, size, crop, direction, read-out time
    rsenf camera identify FILE     likelihood ratio: each known camera against any other camera

The read-out time is a property of sensor and mode, not of one camera: others of its model share it.
The store is $RSENF_STORE, or in the user's data folder; --store DIR names another."""


def add_camera(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    from rsenf.idle.compare import SAME_MODEL_RATIO

    verbs = parser.add_subparsers(dest="what", required=True, metavar="add|list|identify")

    add = partial(console.add_store_verb, verbs)
    new = add("add", "keep the read-out times of a camera's recordings")
    new.add_argument("name", metavar="NAME", help="what to call it; more of a known one is added")
    new.add_argument("files", nargs="+", metavar="FILE")
    new.add_argument(
        "--clock-ppm", type=float, metavar="PPM", help="its clock's error, as verify found it"
    )
    add("list", "show the known cameras by mode").set_defaults(files=[])
    which = add("identify", "weigh each known camera in this mode against another of those about")
    which.add_argument("files", nargs=1, metavar="FILE")
    which.add_argument(
        "--same-model", type=float, default=SAME_MODEL_RATIO, metavar="SHARE",
        help=f"of the cameras about that are of the same model ({SAME_MODEL_RATIO:g})",
    )  # fmt: skip
    for sub in (new, which):
        sub.add_argument(
            "--crop", default="", metavar="WORDS", help="if known, such as stabilised: a mode too"
        )
        add_settings(sub)


def run_camera(args: argparse.Namespace) -> int:
    """Add, list or identify."""
    from rsenf.api.camera import Cameras, Identification, add_camera, identify_camera, list_cameras

    found = [estimated(args, path) for path in args.files]
    result: Cameras | Identification
    if args.what == "add":
        result = add_camera(
            args.name, *found, store=args.store, crop=args.crop, clock_ppm=args.clock_ppm
        )
    elif args.what == "list":
        result = list_cameras(args.store)
    else:
        result = identify_camera(
            found[0], store=args.store, crop=args.crop, same_model_ratio=args.same_model
        )
    remarks = dict.fromkeys(line for one in found for line in one.remarks)
    console.tell(args, result.to_dict(), result, remarks)
    return max([EXIT_DONE, *map(console.say_loss, args.files, found)])


TABLES = """\
Reproduce the paper's idle tables and its figure of the strongest line from the line model.

By default the numbers are corrected where the paper is wrong, and its errata are listed with the
reasons. With --as-published they are the paper's: M rounded to whole rows, lines of harmonic 1
above 0 Hz only, whole hertz and one decimal. The figure compares a simulation with the model."""


def add_tables(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--as-published", action="store_true", help="the paper's own numbers")
    which.add_argument(
        "--light", choices=("cosine", "rectified"), default="cosine",
        help="of the tables: one harmonic, or |cos|, which the figure always has",
    )  # fmt: skip
    parser.add_argument("--csv", type=Path, metavar="DIR", help="write each table to a file too")
    parser.add_argument("--plots", type=Path, metavar="DIR", help="draw pictures too, as PNG")
    parser.add_argument("--json", action="store_true")


def run_tables(args: argparse.Namespace) -> int:
    """Make the tables."""
    from rsenf.report import tables

    step_percent = tables.FINE_STEP_PERCENT if args.plots else tables.STEP_PERCENT
    with console.progress_bar("simulating", tables.simulated_s(step_percent)) as progress:
        drawn = tables.tables_document(
            as_published=args.as_published, light=args.light, step_percent=step_percent,
            progress=progress,
        )  # fmt: skip
    document = tables.thinned(drawn)
    console.tell(args, document, tables.tables_text(document))
    written = _write_csv(args.csv, document) if args.csv else []
    written += _draw(args.plots, drawn) if args.plots else []
    for path in written:
        console.note(f"wrote {path}")
    return EXIT_DONE


def _write_csv(folder: Path, document: dict[str, Any]) -> list[Path]:
    from rsenf.report.tables import tables_csv
    from rsenf.whole_file import whole_file

    folder.mkdir(parents=True, exist_ok=True)
    texts = tables_csv(document)
    for name, text in texts.items():
        with whole_file(folder / name) as part:
            part.write_text(text, encoding="utf-8")
    return [folder / name for name in texts]


def _draw(folder: Path, document: dict[str, Any]) -> list[Path]:
    from rsenf.report.panels import draw_idle_tables, draw_strongest

    folder.mkdir(parents=True, exist_ok=True)
    tables, strongest = folder / "idle_tables.png", folder / "strongest_line.png"
    draw_idle_tables(tables, document)
    draw_strongest(strongest, document)
    return [tables, strongest]

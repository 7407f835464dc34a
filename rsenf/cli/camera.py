"""Which camera made a recording? Compare its read-out time with those of known cameras.

    rsenf camera add NAME FILE…    store the read-out times of a camera's recordings
    rsenf camera list              cameras by mode: frame rate, size, crop, direction, read-out time
    rsenf camera identify FILE     likelihood ratio: each known camera against any other camera

The read-out time is a property of sensor and mode, not of one camera: others of its model share it.
The store is $RSENF_STORE, or in the user's data folder; --store DIR names another.
"""

from __future__ import annotations

import argparse
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    from rsenf.cli.idle import add_settings
    from rsenf.idle.compare import SAME_MODEL_RATIO

    verbs = parser.add_subparsers(dest="what", required=True, metavar="add|list|identify")

    def add(what: str, help_line: str) -> argparse.ArgumentParser:
        sub = verbs.add_parser(what, help=help_line, description=help_line)
        sub.add_argument("--store", type=Path, metavar="DIR", help="of the store")
        sub.add_argument("--json", action="store_true")
        return sub

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


def run(args: argparse.Namespace) -> int:
    """Add, list or identify."""
    from rsenf.api.camera import (
        Cameras,
        Identification,
        add_camera,
        identify_camera,
        list_cameras,
    )
    from rsenf.cli.console import note, print_json, say_loss
    from rsenf.cli.idle import estimated

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
    if args.json:
        print_json(result.to_dict())
    else:
        print(result)
        for line in dict.fromkeys(w for one in found for w in one.warnings if w != one.loss):
            note(line)
    return max(
        (say_loss(path, one) for path, one in zip(args.files, found, strict=True)), default=0
    )

"""Which effects does a capture model lack? Fit it, find where it differs from the data, extend it.

The model is fitted to some blocks of time and scored on the others (held-out data). Its residual is
tested for every effect of the catalogue. Forward selection adds each effect that the held-out data
support, with its parameters and their errors, until none is left; where a rest stays, a grammar of
effects is searched, and what it finds is written as an effect file. The verdict: 'no_discrepancy',
'explained' or 'unexplained' (with the place of the residual). OUT gets a report (report.html) and
the extended model, which 'rsenf simulate --model' accepts, with --effects for each effect file.
Long computations on a video are cached beside OUT until all is done: after a stop, the same command
resumes. With --reference the camera's clock error is tested too, and one mean per frame is enough.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any

from rsenf.cli import console


def add_discover(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.add_argument("input", metavar="IN", help="video, .mcap recording or .npz luminance")
    parser.add_argument("--out", type=Path, metavar="DIR", required=True, help="what is found")
    parser.add_argument("--json", action="store_true", help="the result as JSON")
    add_settings(parser)


def add_settings(parser: argparse.ArgumentParser) -> None:
    """Add the arguments that say how a recording is analysed."""
    parser.add_argument(
        "--model", type=Path, metavar="FILE", help="to begin with (a lamp without harmonics)"
    )
    parser.add_argument(
        "--fits", type=Path, metavar="FILE",
        help="a camera's model, from 'batch discover --one-camera': says whether it fits",
    )  # fmt: skip
    parser.add_argument(
        "--effects", action="append", type=Path, default=[], metavar="FILE.py",
        help="adds your own effects to the catalogue; configs/model/my_effect.py is a template",
    )  # fmt: skip
    parser.add_argument(
        "--reference", nargs=1, metavar="REF",
        help="the grid's frequency meanwhile: CSV, Parquet, WAV of the mains, or store:GRID",
    )  # fmt: skip
    console.add_reference_arguments(parser)
    console.add_recording_arguments(parser, leave_out=("strips", "tile_means"))


def run_discover(args: argparse.Namespace) -> int:
    """Run the workflow on a recording."""
    from rsenf.api.discover import check_out, discover
    from rsenf.model import load_effects

    check_out(args.out)  # before anything is opened
    for path in args.effects:
        load_effects(path)
    references = console.references_of(args) if args.reference else None
    recording = console.open_recording(args, args.input)
    with console.stages("reading") as (doing, share):
        found = discover(
            recording, references, **options_of(args), out=args.out, camera=args.camera,
            progress=lambda read_s: share(read_s / (recording.duration_s or math.inf)),
            doing=doing, share=share,
        )  # fmt: skip
    console.tell(args, found.to_dict(), found)
    if found.note:
        console.note(found.note)
    return console.say_loss(args.input, found)


def options_of(args: argparse.Namespace) -> dict[str, Any]:
    """Return the keyword arguments of :func:`rsenf.api.discover.discover` for the analysis."""
    names = ("model", "fits", "nominal_hz")
    return {name: getattr(args, name) for name in names} | {"rows": console.row_settings(args)}

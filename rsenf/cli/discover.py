"""What does the model of a capture lack? Fit it, see where data and simulation differ, add it.

The model is fitted to some blocks of time and scored on the others. What is left is compared with
every effect of the catalogue; one that held-out data support is added, with its parameters and
their errors, until nothing more is. The verdict is 'no_discrepancy', 'explained' or 'unexplained'
(with where), and OUT gets a report to read (report.html) and the extended model, which 'rsenf
simulate --model' takes as it is. What takes long of a video is kept beside OUT until all is done:
stopped, the same command goes on from there. With --reference the camera's clock is looked at too,
and one mean for each frame is enough.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from rsenf.cli.discover_reference import Result
    from rsenf.discrepancy.measured import Measured
    from rsenf.match.series import Grid
    from rsenf.messages import RowBlock
    from rsenf.messages.schema import Float32Array
    from rsenf.model import CaptureModel
    from rsenf.run.inputs import Input

    Told = AbstractContextManager[Callable[[Any], None]]

SILENT: Told = nullcontext(lambda told: None)
MODEL, RESULT, RESIDUALS = "model.yaml", "discovery.json", "residuals.npz"
PAGE = "report.html"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.add_argument("input", metavar="IN", help="video, .mcap recording or .npz luminance")
    parser.add_argument("--out", type=Path, metavar="DIR", required=True, help="what is found")
    parser.add_argument("--json", action="store_true", help="the result as JSON")
    add_settings(parser)


def add_settings(parser: argparse.ArgumentParser) -> None:
    """Arguments that say how a recording is looked at."""
    from rsenf.cli import discover_reference
    from rsenf.cli.console import add_row_arguments

    parser.add_argument(
        "--model", type=Path, metavar="FILE", help="to begin with (a lamp without harmonics)"
    )
    parser.add_argument(
        "--effects",
        action="append",
        type=Path,
        default=[],
        metavar="FILE.py",
        help="adds your own effects to the catalogue; configs/model/my_effect.py is a template",
    )
    discover_reference.add_arguments(parser)
    add_row_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Run the workflow on a recording.

    Raises
    ------
    InputError
        When there are no rows, too few seconds, or no flicker to fit a model to.
    UsageError
        For a folder that holds anything else, a model or effects that can't be meant so.
    """
    from rsenf.cli.console import note, print_json, progress_bar, say, stages
    from rsenf.errors import EXIT_DONE, EXIT_LOSS
    from rsenf.report.discovery import discovery_words
    from rsenf.run.inputs import open_input_file

    _check_out(args.out)
    model, grid = begun_with(args)
    recording = open_input_file(args.input, camera=args.camera)
    reading = progress_bar("reading", recording.duration_s)
    result, loss = discovered(args, recording, model, grid, reading, stages())
    if args.json:
        print_json(result.told)
    else:
        print(discovery_words(result.told))
    if result.note:
        note(result.note)
    if loss:
        say(f"{args.input}: {loss}")
    return EXIT_LOSS if loss else EXIT_DONE


def begun_with(args: argparse.Namespace) -> tuple[CaptureModel, Grid | None]:
    """Return the model to begin with, once its effects are there, and the reference, if any."""
    from rsenf.cli.discover_reference import reference_of
    from rsenf.model import load_effects

    for path in args.effects:
        load_effects(path)
    return _model(args), reference_of(args)


def discovered(
    args: argparse.Namespace,
    recording: Input,
    model: CaptureModel,
    grid: Grid | None,
    reading: Told = SILENT,
    doing: Told = SILENT,
) -> tuple[Result, str]:
    """Fill the folder ``--out``; return what was found, and what could not be read.

    Parameters
    ----------
    args : Namespace
    recording : Input
        What ``args.input`` names, opened.
    model : CaptureModel
        To begin with.
    grid : Grid or None
    reading, doing : context managers of callables, optional
        Told how many seconds are read, and in words what is being done.
    """
    from rsenf.cli.begun import begun
    from rsenf.cli.discover_input import identity_of, recoded_by, rows_of
    from rsenf.cli.discover_reference import by_frame_means
    from rsenf.discrepancy.beside import holds_frame_means

    with begun(args.out, identity_of(args)) as kept:
        with reading as seconds:
            blocks, loss = rows_of(args, recording, kept, seconds)
        with _named(args.input), doing as progress:
            if kept.found:
                progress(f"going on from what {kept.folder} has of a run that was stopped")
            if grid and holds_frame_means(blocks):
                result = by_frame_means(args, model, blocks, grid, progress)
            else:
                again = recoded_by(args, kept) if recording.begins_with == "frames" else None
                result = _by_rows(args, model, blocks, again, grid, progress)
            progress("writing the report")
            _keep(args, result)
    return result, loss


@contextmanager
def _named(path: str) -> Iterator[None]:
    """Say of which recording it is that something is wrong."""
    from rsenf.errors import InputError

    try:
        yield
    except InputError as error:
        raise type(error)(f"{path}: {error.message}", error.hint) from error


def _by_rows(
    args: argparse.Namespace,
    model: CaptureModel,
    blocks: list[RowBlock],
    codec: Callable[[Measured], Callable[[Float32Array], Float32Array]] | None,
    grid: Grid | None,
    progress: Callable[[str], None],
) -> Result:
    """Discover by rows, and beside a reference where there is one."""
    import numpy as np

    from rsenf.cli.discover_reference import Result, residuals_of
    from rsenf.discrepancy.beside import (
        beside_json,
        beside_model,
        beside_of,
        clip_of,
        discover_beside,
        joined,
    )
    from rsenf.discrepancy.measured import measured_of
    from rsenf.discrepancy.result import discovery_json, model_of
    from rsenf.discrepancy.verdict import discover
    from rsenf.report.discovery_page import discovery_page
    from rsenf.run.recoded import is_lossy

    data, name = measured_of(blocks, args.nominal_hz), Path(args.input).name
    # A reference of another time is refused before anything long is done.
    laid = beside_of(clip_of(data), grid) if grid else None
    # What is too little to tie rows together may still be more than any effect.
    again = codec(data) if codec and is_lossy(Path(args.input)) else None
    found = discover(model, data, progress, recoded=again)
    told, extended = discovery_json(found, str(args.out / MODEL)), model_of(found, name)
    residuals: dict[str, NDArray[Any]] = {
        "frame_time_s": data.time_s,
        "before": found.first.residual.astype(np.float16),
        "after": found.last.residual.astype(np.float16),
    }
    beside = discover_beside(extended, laid, progress) if laid else None
    extended = beside_model(beside, name) if beside else extended
    page = discovery_page(found, told, name, extended, beside)
    if beside:
        told, residuals = joined(told, beside_json(beside, "")), residuals | residuals_of(beside)
    tied = "a codec has tied rows together, and counts as a discrepancy (give the video it coded)"
    return Result(told, extended, page, residuals, tied if data.coded and not again else "")


def _check_out(folder: Path) -> None:
    """Refuse to replace what isn't an earlier result."""
    from rsenf.errors import UsageError

    if folder.exists() and not folder.is_dir():
        raise UsageError(f"--out {folder}: not a folder", "name a new one")
    there = folder.iterdir() if folder.exists() else iter(())
    others = {path.name for path in there} - {MODEL, RESULT, RESIDUALS, PAGE}
    if others:
        problem = f"--out {folder}: holds what is no earlier result: {min(others)}"
        raise UsageError(problem, "name a new or an empty folder")


def _model(args: argparse.Namespace) -> CaptureModel:
    from rsenf.config.model_file import load_model
    from rsenf.discrepancy.start import PLAIN

    return load_model(args.model) if args.model else PLAIN


def _keep(args: argparse.Namespace, result: Result) -> None:
    """Write what was found, all of it or nothing."""
    import json

    import numpy as np
    import yaml

    from rsenf.whole_file import whole_folder

    args.out.parent.mkdir(parents=True, exist_ok=True)
    with whole_folder(args.out) as folder:
        (folder / MODEL).write_text(yaml.safe_dump(result.model.to_dict(), sort_keys=False))
        (folder / RESULT).write_text(json.dumps(result.told, indent=2, allow_nan=False) + "\n")
        (folder / PAGE).write_text(result.page, encoding="utf-8")
        np.savez_compressed(folder / RESIDUALS, allow_pickle=False, **result.residuals)

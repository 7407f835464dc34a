"""What does the model of a capture lack? Fit it, see where data and simulation differ, add it.

The model is fitted to some blocks of time and scored on the others. What is left is compared with
every effect of the catalogue; one that held-out data support is added, with its parameters and
their errors, until nothing more is. The verdict is 'no_discrepancy', 'explained' or 'unexplained'
(with where), and OUT gets the extended model, which 'rsenf simulate --model' takes as it is. With
--reference the camera's clock is looked at too, and one mean for each frame is enough.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from rsenf.match.series import Grid
    from rsenf.messages import RowBlock
    from rsenf.model import CaptureModel
    from rsenf.run.inline import Analysis
    from rsenf.track import TrackSettings

MODEL, RESULT, RESIDUALS = "model.yaml", "discovery.json", "residuals.npz"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    from rsenf.cli import discover_reference
    from rsenf.cli.console import add_row_arguments

    parser.add_argument("input", metavar="IN", help="video, .mcap recording or .npz luminance")
    parser.add_argument("--out", type=Path, metavar="DIR", required=True, help="what is found")
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
    parser.add_argument("--json", action="store_true", help="the result as JSON")
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
    from rsenf.cli.console import note, print_json, say
    from rsenf.cli.discover_reference import holds_frame_means, reference_of
    from rsenf.errors import EXIT_DONE, EXIT_LOSS
    from rsenf.model import load_effects
    from rsenf.report.discovery import discovery_words

    _check_out(args.out)
    for path in args.effects:
        load_effects(path)
    model, grid = _model(args), reference_of(args)
    if grid and holds_frame_means(args):
        told, loss = _by_frame_means(args, model, grid)
    else:
        told, loss = _by_rows(args, model, grid)
    if args.json:
        print_json(told)
    else:
        print(discovery_words(told))
    if Path(args.input).suffix != ".npz":
        note("a codec ties rows together: what it does to them counts as a discrepancy")
    if loss:
        say(f"{args.input}: {loss}")
    return EXIT_LOSS if loss else EXIT_DONE


def _by_rows(
    args: argparse.Namespace, model: CaptureModel, grid: Grid | None
) -> tuple[dict[str, Any], str]:
    """Discover by rows, and by a reference where there is one; return the result and the loss."""
    import numpy as np

    from rsenf.cli.console import note
    from rsenf.cli.discover_reference import by_reference, residuals_of
    from rsenf.discrepancy import (
        discover,
        discovery_json,
        grid_json,
        grid_model,
        joined,
        measured_of,
        model_of,
    )
    from rsenf.track import TrackSettings

    settings, name = TrackSettings(nominal_hz=args.nominal_hz), Path(args.input).name
    blocks, analysis = _analyse(args, settings)
    data = measured_of(blocks, _nominal_hz(args, analysis))
    found = discover(model, data, analysis.estimates, analysis.idle.idle_ratio, note)
    told, extended = discovery_json(found, str(args.out / MODEL)), model_of(found, name)
    residuals: dict[str, NDArray[Any]] = {
        "frame_time_s": data.time_s,
        "before": found.first.residual.astype(np.float16),
        "after": found.last.residual.astype(np.float16),
    }
    if grid:
        beside = by_reference(extended, blocks, analysis, grid, settings)
        told, extended = joined(told, grid_json(beside, "")), grid_model(beside, name)
        residuals |= residuals_of(beside)
    _keep(args, extended, told, residuals)
    return told, analysis.loss


def _by_frame_means(
    args: argparse.Namespace, model: CaptureModel, grid: Grid
) -> tuple[dict[str, Any], str]:
    """Discover by a reference alone; return the result and the loss."""
    from rsenf.cli.discover_reference import by_reference, frame_means_settings, residuals_of
    from rsenf.discrepancy import grid_json, grid_model

    settings = frame_means_settings(args, grid)
    blocks, analysis = _analyse(args, settings)
    found = by_reference(model, blocks, analysis, grid, settings)
    told = grid_json(found, str(args.out / MODEL))
    _keep(args, grid_model(found, Path(args.input).name), told, residuals_of(found))
    return told, analysis.loss


def _check_out(folder: Path) -> None:
    """Refuse to replace what isn't an earlier result."""
    from rsenf.errors import UsageError

    if folder.exists() and not folder.is_dir():
        raise UsageError(f"--out {folder}: not a folder", "name a new one")
    there = folder.iterdir() if folder.exists() else iter(())
    others = {path.name for path in there} - {MODEL, RESULT, RESIDUALS}
    if others:
        problem = f"--out {folder}: holds what is no earlier result: {min(others)}"
        raise UsageError(problem, "name a new or an empty folder")


def _model(args: argparse.Namespace) -> CaptureModel:
    from rsenf.config.model_file import load_model
    from rsenf.model import CaptureModel, Light

    if args.model:
        return load_model(args.model)
    return CaptureModel(name="plain", light=Light(lamp="tone"))


def _analyse(args: argparse.Namespace, settings: TrackSettings) -> tuple[list[RowBlock], Analysis]:
    from rsenf.cli.console import progress_bar, row_settings
    from rsenf.idle import IdleSettings
    from rsenf.run.inline import analyse
    from rsenf.run.inputs import open_input_file

    recording = open_input_file(args.input, camera=args.camera)
    blocks: list[RowBlock] = []

    def tap(topic: str, message: Any) -> None:
        if topic == "rows":
            blocks.append(message)

    with progress_bar("reading", recording.duration_s) as progress:
        analysis = analyse(
            recording,
            rows=row_settings(args),
            track=settings,
            idle=IdleSettings(nominal_hz=args.nominal_hz),
            progress=progress,
            tap=tap,
        )
    epoch = blocks[0].header.epoch if blocks else 0
    return [block for block in blocks if block.header.epoch == epoch], analysis


def _nominal_hz(args: argparse.Namespace, analysis: Analysis) -> float:
    told = [e.nominal_hz for e in analysis.estimates if e.usable]
    return float(args.nominal_hz or (told[0] if told else 50.0))


def _keep(
    args: argparse.Namespace,
    extended: CaptureModel,
    told: dict[str, Any],
    residuals: dict[str, NDArray[Any]],
) -> None:
    """Write what was found, all of it or nothing."""
    import json

    import numpy as np
    import yaml

    from rsenf.whole_file import whole_folder

    args.out.parent.mkdir(parents=True, exist_ok=True)
    with whole_folder(args.out) as folder:
        (folder / MODEL).write_text(yaml.safe_dump(extended.to_dict(), sort_keys=False))
        (folder / RESULT).write_text(json.dumps(told, indent=2, allow_nan=False) + "\n")
        np.savez_compressed(folder / RESIDUALS, allow_pickle=False, **residuals)

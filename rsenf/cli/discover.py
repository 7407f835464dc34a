"""What does the model of a capture lack? Fit it, see where data and simulation differ, add it.

The model is fitted to some blocks of time and scored on the others. What is left is compared with
every effect of the catalogue; one that held-out data support is added, with its parameters and
their errors, until nothing more is. The verdict is 'no_discrepancy', 'explained' or 'unexplained'
(with where), and OUT gets a report to read (report.html) and the extended model, which 'rsenf
simulate --model' takes as it is.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rsenf.discrepancy import Discovery
    from rsenf.messages import RowBlock
    from rsenf.model import CaptureModel
    from rsenf.run.inline import Analysis

MODEL, RESULT, RESIDUALS = "model.yaml", "discovery.json", "residuals.npz"
PAGE = "report.html"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
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
    from rsenf.cli.console import note, print_json, say, stages
    from rsenf.discrepancy import discover, discovery_json, measured_of
    from rsenf.errors import EXIT_DONE, EXIT_LOSS
    from rsenf.model import load_effects
    from rsenf.report.discovery import discovery_words

    _check_out(args.out)
    for path in args.effects:
        load_effects(path)
    model = _model(args)
    blocks, analysis = _analyse(args)
    data = measured_of(blocks, _nominal_hz(args, analysis))
    with stages() as progress:
        found = discover(model, data, analysis.estimates, analysis.idle.idle_ratio, progress)
        told = discovery_json(found, str(args.out / MODEL))
        progress("writing the report")
        _keep(args, found, told)
    if args.json:
        print_json(told)
    else:
        print(discovery_words(told))
    if Path(args.input).suffix != ".npz":
        note("a codec ties rows together: what it does to them counts as a discrepancy")
    if analysis.loss:
        say(f"{args.input}: {analysis.loss}")
    return EXIT_LOSS if analysis.loss else EXIT_DONE


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
    from rsenf.model import CaptureModel, Light

    if args.model:
        return load_model(args.model)
    return CaptureModel(name="plain", light=Light(lamp="tone"))


def _analyse(args: argparse.Namespace) -> tuple[list[RowBlock], Analysis]:
    from rsenf.cli.console import progress_bar, row_settings
    from rsenf.idle import IdleSettings
    from rsenf.run.inline import analyse
    from rsenf.run.inputs import open_input_file
    from rsenf.track import TrackSettings

    recording = open_input_file(args.input, camera=args.camera)
    blocks: list[RowBlock] = []

    def tap(topic: str, message: Any) -> None:
        if topic == "rows":
            blocks.append(message)

    with progress_bar("reading", recording.duration_s) as progress:
        analysis = analyse(
            recording,
            rows=row_settings(args),
            track=TrackSettings(nominal_hz=args.nominal_hz),
            idle=IdleSettings(nominal_hz=args.nominal_hz),
            progress=progress,
            tap=tap,
        )
    epoch = blocks[0].header.epoch if blocks else 0
    return [block for block in blocks if block.header.epoch == epoch], analysis


def _nominal_hz(args: argparse.Namespace, analysis: Analysis) -> float:
    told = [e.nominal_hz for e in analysis.estimates if e.usable]
    return float(args.nominal_hz or (told[0] if told else 50.0))


def _keep(args: argparse.Namespace, found: Discovery, told: dict[str, Any]) -> None:
    """Write what was found, all of it or nothing."""
    import json

    import numpy as np
    import yaml

    from rsenf.discrepancy import model_of
    from rsenf.report.discovery_page import discovery_page
    from rsenf.whole_file import whole_folder

    args.out.parent.mkdir(parents=True, exist_ok=True)
    with whole_folder(args.out) as folder:
        name = Path(args.input).name
        extended = model_of(found, name)
        (folder / MODEL).write_text(yaml.safe_dump(extended.to_dict(), sort_keys=False))
        (folder / RESULT).write_text(json.dumps(told, indent=2, allow_nan=False) + "\n")
        (folder / PAGE).write_text(discovery_page(found, told, name, extended), encoding="utf-8")
        np.savez_compressed(
            folder / RESIDUALS,
            frame_time_s=found.last.data.time_s,
            before=found.first.residual.astype(np.float16),
            after=found.last.residual.astype(np.float16),
        )

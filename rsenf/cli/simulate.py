"""Film a lamp on a grid's frequency path with a simulated rolling-shutter camera.

X.truth.json beside the clip says what is true of it: enough to judge any estimator by.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rsenf.model import CaptureModel, GridPath

_ROWS_SUFFIX = ".npz"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    from rsenf.cli.console import count, positive

    parser.add_argument(
        "--out", type=Path, required=True, metavar="X",
        help="X.mp4, .mov, .mkv, .avi or .webm for video, X.npz for row means",
    )  # fmt: skip
    what = parser.add_argument_group("the clip")
    what.add_argument("--duration-s", type=positive, default=60.0, metavar="S", help="length (60)")
    what.add_argument("--seed", type=count, default=1, metavar="N", help="of everything random (1)")
    what.add_argument("--strips", type=int, default=1, metavar="N", help="of each row in X.npz (1)")
    grid = parser.add_argument_group("the grid")
    grid.add_argument(
        "--reference", type=Path, metavar="REF", help="measured; drawn at random otherwise"
    )
    grid.add_argument("--start-s", type=float, default=0.0, metavar="S", help="where on it (0)")
    grid.add_argument("--nominal-hz", type=float, choices=(50.0, 60.0), help="50, or that of REF")
    grid.add_argument("--timezone", metavar="ZONE", help="of REF's times, for example Europe/Paris")
    grid.add_argument("--step-s", type=positive, metavar="S", help="of REF, where it has no times")
    camera = parser.add_argument_group("the capture, over the model file")
    camera.add_argument("--model", type=Path, metavar="FILE", help="YAML; see configs/model")
    camera.add_argument("--lamp", metavar="KIND", help="led, halogen, incandescent, cfl or ideal")
    camera.add_argument("--size", type=_size, metavar="1280x720")
    camera.add_argument("--frame-rate", metavar="30000/1001")
    camera.add_argument("--idle-ratio", type=float, metavar="RATIO", help="0 to 0.99")
    camera.add_argument("--clock-ppm", type=float, metavar="PPM", help="fast > 0")
    camera.add_argument("--codec", metavar="NAME", help="h264, h265, vp9 or mjpeg")
    camera.add_argument("--bitrate", type=_bits, metavar="150k", help="constant quality otherwise")
    camera.add_argument("--preset", metavar="NAME", help="the encoder's effort, for example medium")
    camera.add_argument("--lossless", action="store_true", default=None)
    parser.add_argument("--json", action="store_true", help="print the result as JSON")


def run(args: argparse.Namespace) -> int:
    """Make the clip and its truth.

    Raises
    ------
    UsageError
        For an option, model or reference that can't be meant so.
    RecordingError
        When a file can't be written.
    """
    from rsenf.errors import EXIT_DONE
    from rsenf.model import synthetic_grid

    model = _model(args)
    grid = _measured(args) if args.reference else synthetic_grid(
        args.seed, args.duration_s + 1, nominal_hz=args.nominal_hz or 50.0, start_s=args.start_s
    )  # fmt: skip
    write = _write_rows if args.out.suffix == _ROWS_SUFFIX else _write_video
    truth = write(args, model, grid)
    _report(args, truth)
    return EXIT_DONE


def _model(args: argparse.Namespace) -> CaptureModel:
    from rsenf.config.model_file import load_model
    from rsenf.model import CaptureModel, parse_frame_rate

    model = load_model(args.model) if args.model else CaptureModel()
    columns, rows = args.size or (None, None)
    rate = parse_frame_rate(args.frame_rate) if args.frame_rate else None
    shutter = {
        "frame_rate": rate, "rows": rows, "columns": columns,
        "idle_ratio": args.idle_ratio, "clock_ppm": args.clock_ppm,
    }  # fmt: skip
    codec = {
        "name": args.codec, "bitrate_bps": args.bitrate,
        "lossless": args.lossless, "preset": args.preset,
    }  # fmt: skip
    encoding = model.codec
    if args.bitrate or args.lossless:  # either replaces what the model file says of both
        encoding = dataclasses.replace(encoding, bitrate_bps=None, lossless=False)
    return dataclasses.replace(
        model,
        light=_over(model.light, {"lamp": args.lamp}),
        shutter=_over(model.shutter, shutter),
        codec=_over(encoding, codec),
    )


def _over(part: Any, given: dict[str, object]) -> Any:
    """Return a part of the model with what was given on the command line."""
    return dataclasses.replace(part, **{k: v for k, v in given.items() if v is not None})


def _measured(args: argparse.Namespace) -> GridPath:
    from rsenf.cli.console import note
    from rsenf.model import GridPath
    from rsenf.reference import read_reference

    reference = read_reference(
        args.reference, timezone=args.timezone, step_s=args.step_s, nominal_hz=args.nominal_hz
    )
    for line in reference.notes:
        note(f"{args.reference}: {line}")
    return GridPath(reference.freq_hz, reference.step_s, args.start_s, reference.nominal_hz)


def _write_rows(args: argparse.Namespace, model: CaptureModel, grid: GridPath) -> dict[str, Any]:
    import numpy as np

    from rsenf.model import simulate_rows
    from rsenf.whole_file import whole_file

    data = simulate_rows(model, grid, args.duration_s, args.seed, strips=args.strips)
    with _truth_beside(args.out, data.truth), whole_file(args.out) as part, part.open("wb") as file:
        np.savez(file, rows=data.level, frame_time_s=data.frame_time_s)
    return data.truth


def _write_video(args: argparse.Namespace, model: CaptureModel, grid: GridPath) -> dict[str, Any]:
    from rsenf.cli.console import progress_bar
    from rsenf.model import render_frames, write_video

    frames = render_frames(model, grid, args.duration_s, args.seed)
    rate_hz = float(frames.frame_rate)
    bar = progress_bar("filming", frames.frames / rate_hz)
    with _truth_beside(args.out, frames.truth), bar as show:
        write_video(args.out, frames, model.codec, lambda done: show(done / rate_hz))
    return frames.truth


@contextmanager
def _truth_beside(out: Path, truth: dict[str, Any]) -> Iterator[None]:
    """Let the truth appear when the clip has."""
    from rsenf.whole_file import whole_file

    with whole_file(_truth_path(out)) as part:
        part.write_text(json.dumps(truth, indent=1) + "\n", encoding="utf-8")
        yield


def _truth_path(out: Path) -> Path:
    return out.with_suffix(".truth.json")


def _report(args: argparse.Namespace, truth: dict[str, Any]) -> None:
    from rsenf.cli.console import note, print_json

    kept = ("frames", "duration_s", "frame_rate_hz", "nominal_hz", "idle_ratio", "read_out_time_s",
            "clock_ppm", "reference_start_s", "seed", "notes")  # fmt: skip
    result = {"out": str(args.out), "truth": str(_truth_path(args.out))}
    result |= {key: truth[key] for key in kept}
    if args.json:
        print_json(result)
        return
    print(
        f"{args.out}: {truth['frames']} frames, {truth['duration_s']:.3f} s at "
        f"{truth['frame_rate']} fps, {truth['nominal_hz']:g} Hz grid, idle {truth['idle_ratio']:g}"
    )
    print(f"{_truth_path(args.out)}: what is true of it")
    for line in truth["notes"]:
        note(line)


def _size(text: str) -> tuple[int, int]:
    columns, _, rows = text.lower().partition("x")
    try:
        return int(columns), int(rows)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a size like 1280x720") from None


def _bits(text: str) -> int:
    number, factor = text, 1
    if text[-1:].lower() in ("k", "m"):
        number, factor = text[:-1], {"k": 1_000, "m": 1_000_000}[text[-1].lower()]
    try:
        return round(float(number) * factor)
    except (ValueError, OverflowError):
        raise argparse.ArgumentTypeError(f"{text!r} is not a bit rate like 150k or 2M") from None

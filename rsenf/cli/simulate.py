"""Film a lamp on a grid's frequency path with a simulated rolling-shutter camera.

X.truth.json beside the clip says what is true of it: enough to judge any estimator by.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rsenf.model import GridPath


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    from rsenf.cli.effect_list import ListEffects
    from rsenf.cli.options import count, positive
    from rsenf.cli.simulated_model import bits, labels, size

    parser.add_argument(
        "--out", type=Path, required=True, metavar="X",
        help="X.mp4, .mov, .mkv, .avi or .webm for video; X.npz or X.mcap for row means",
    )  # fmt: skip
    what = parser.add_argument_group("the clip")
    what.add_argument("--duration-s", type=positive, default=60.0, metavar="S", help="length (60)")
    what.add_argument("--seed", type=count, default=1, metavar="N", help="of everything random (1)")
    what.add_argument(
        "--strips", type=int, default=1, metavar="N", help="of each row, in row means (1)"
    )
    what.add_argument("--site", default="simulated", metavar="NAME", help="in X.mcap (simulated)")
    what.add_argument("--camera", default="camera", metavar="NAME", help="in X.mcap (camera)")
    grid = parser.add_argument_group("the grid")
    grid.add_argument("--reference", type=Path, metavar="REF", help="measured; drawn otherwise")
    grid.add_argument("--start-s", type=float, default=0.0, metavar="S", help="where on it (0)")
    grid.add_argument("--nominal-hz", type=float, choices=(50.0, 60.0), help="50, or that of REF")
    grid.add_argument("--timezone", metavar="ZONE", help="of REF's times, for example Europe/Paris")
    grid.add_argument("--step-s", type=positive, metavar="S", help="of REF, where it has no times")
    camera = parser.add_argument_group("the capture, over the model file")
    camera.add_argument("--model", type=Path, metavar="FILE", help="YAML; see configs/model")
    camera.add_argument(
        "--lamp", metavar="KIND", help="led, halogen, sodium, cfl, ideal and others"
    )
    camera.add_argument("--size", type=size, metavar="1280x720")
    camera.add_argument("--frame-rate", metavar="30000/1001")
    camera.add_argument("--idle-ratio", type=float, metavar="RATIO", help="0 to 0.99")
    camera.add_argument("--clock-ppm", type=float, metavar="PPM", help="fast > 0")
    camera.add_argument(
        "--effect", action="append", default=[], metavar="NAME:PARAMETER=VALUE,...",
        help="one of the catalogue, in place of the model file's own of that name; repeatable",
    )  # fmt: skip
    camera.add_argument(
        "--effects", action="append", default=[], type=Path, metavar="FILE.py",
        help="adds your own effects to the catalogue; configs/model/my_effect.py is a template",
    )  # fmt: skip
    coding = parser.add_argument_group("the encoder, over the model file")
    coding.add_argument("--codec", metavar="NAME", help="h264, h265, vp9 or mjpeg")
    coding.add_argument("--bitrate", type=bits, metavar="150k", help="constant quality otherwise")
    coding.add_argument("--preset", metavar="NAME", help="its effort, for example medium")
    coding.add_argument("--lossless", action="store_true", default=None)
    coding.add_argument(
        "--encodings", type=labels, metavar="lossless,150k,...",
        help="X.lossless.mp4, X.150k.mp4, ... of one and the same clip, filmed once",
    )  # fmt: skip
    parser.add_argument(
        "--list-effects", action=ListEffects, nargs=0, help="print the catalogue of effects and end"
    )  # fmt: skip
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
    from rsenf.cli.simulated_files import SimulatedClip
    from rsenf.cli.simulated_model import codecs_of, model_of
    from rsenf.errors import EXIT_DONE, UsageError
    from rsenf.model import load_effects, synthetic_grid

    for path in args.effects:
        load_effects(path)
    model = model_of(args)
    grid = _measured(args) if args.reference else synthetic_grid(
        args.seed, args.duration_s + 1, nominal_hz=args.nominal_hz or 50.0, start_s=args.start_s
    )  # fmt: skip
    clip = SimulatedClip(args.out, model, grid, args.duration_s, args.seed)
    rows = args.out.suffix in (".npz", ".mcap")
    if rows and args.encodings:
        raise UsageError(f"{args.out}: row means aren't encoded", "--encodings is for video")
    if not rows:
        truth = clip.write_videos(codecs_of(model, args.encodings))
    elif args.out.suffix == ".npz":
        truth = clip.write_arrays(args.strips)
    else:
        truth = clip.write_recording(args.strips, args.site, args.camera)
    _report(args, clip.truth_path, truth)
    return EXIT_DONE


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


def _report(args: argparse.Namespace, truth_path: Path, truth: dict[str, Any]) -> None:
    from rsenf.cli.console import note, print_json

    kept = ("frames", "duration_s", "frame_rate_hz", "nominal_hz", "idle_ratio", "read_out_time_s",
            "clock_ppm", "reference_start_s", "seed", "notes")  # fmt: skip
    result = {"out": str(args.out), "files": truth["files"], "truth": str(truth_path)}
    result |= {key: truth[key] for key in kept}
    if args.json:
        print_json(result)
        return
    print(
        f"{', '.join(f['name'] for f in truth['files'])}: {truth['frames']} frames, "
        f"{truth['duration_s']:.3f} s at {truth['frame_rate']} fps, "
        f"{truth['nominal_hz']:g} Hz grid, idle {truth['idle_ratio']:g}"
    )
    print(f"{truth_path}: what is true of it")
    for line in truth["notes"]:
        note(line)

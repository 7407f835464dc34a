"""Convert the pictures in another program's MCAP file to a recording, with the rows sampled.

Supports ROS 2 (sensor_msgs/msg/Image and CompressedImage, foxglove_msgs) and Foxglove
(CompressedVideo, CompressedImage and RawImage, Protobuf or JSON). Frame times are the pictures'
time stamps. Compressed pictures are copied; of raw ones the luma is kept, lossless.

'rsenf track', 'idle' and others also read such a file directly; --camera selects one of several.
"""

from __future__ import annotations

import argparse
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    from rsenf.cli.console import add_row_arguments

    parser.add_argument("foreign", type=Path, metavar="FOREIGN.mcap")
    parser.add_argument("--out", type=Path, required=True, metavar="NEW.mcap")
    parser.add_argument("--site", default="import", metavar="NAME", help="of the cameras (import)")
    parser.add_argument("--overwrite", action="store_true")
    parser.add_argument("--json", action="store_true")
    add_row_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Import a file."""
    from dataclasses import asdict

    from rsenf.bus.keys import NAME_RULE, is_name
    from rsenf.cli.console import note, print_json, progress_bar, row_settings, say
    from rsenf.errors import EXIT_DONE, EXIT_LOSS, UsageError
    from rsenf.record import open_recording
    from rsenf.run.foreign.convert import import_pictures

    if not is_name(args.site):
        raise UsageError(f"{args.site!r} is no name of a site", NAME_RULE)
    if args.out.exists() and not args.overwrite:
        raise UsageError(f"{args.out} exists", "--overwrite replaces it")
    recording = open_recording(args.foreign)
    if args.out.exists() and args.out.samefile(args.foreign):
        raise UsageError(f"{args.out} is the file to read", "name another")
    with progress_bar("importing", None) as progress:
        cameras = import_pictures(
            recording,
            args.out,
            site=args.site,
            camera=args.camera,
            rows=row_settings(args),
            progress=progress,
        )
    if args.json:
        print_json(
            {
                "out": str(args.out),
                "cameras": {name: asdict(done) for name, done in cameras.items()},
                "lost": recording.lost,
            }
        )
    losses = [recording.lost]
    for name, done in cameras.items():
        if not args.json:
            print(f"{name}: {done.frames} frames, {done.duration_s:.1f} s, from {done.topic}")
        losses.append(f"{name}: {done.loss}" if done.loss else "")
        for line in done.warnings:
            note(f"{name}: {line}")
    for loss in filter(None, losses):
        say(f"{args.foreign}: {loss}")
    return EXIT_LOSS if any(losses) else EXIT_DONE

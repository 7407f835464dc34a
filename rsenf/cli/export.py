"""Verbs on files of other programs: export a topic, and import pictures."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rsenf.cli import console
from rsenf.cli.options import count
from rsenf.errors import EXIT_DONE, EXIT_LOSS, UsageError

if TYPE_CHECKING:
    from rsenf.record import Recording


EXPORT = """\
Export one topic of a recording to a file for other programs; its suffix sets the format.

  .csv, .parquet   one line per message, or per frame for rows; the columns are the header's and
                   the message's fields with their units ('rsenf explain EnfEstimate')
  .wav             the light as a sound: rows at the rate they were read, idle periods filled in

In CSV, lists are JSON, and unknown values are empty cells. Pictures are not exported: Foxglove
shows them. A sound needs the camera's idle ratio: from the recording, or given."""


SOUND = ".wav"
TABLES = (".csv", ".parquet")
Written = tuple[dict[str, Any], str]  # what was written, as a document and as text


def add_export(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.add_argument("recording", metavar="FILE.mcap")
    parser.add_argument(
        "--out", type=Path, required=True, metavar="FILE", help=f"{', '.join(TABLES)} or {SOUND}"
    )
    parser.add_argument(
        "--topic", metavar="NAME", help="such as track, idle, match, rows (track; rows for a sound)"
    )
    parser.add_argument("--camera", metavar="NAME", help="of a recording with several")
    parser.add_argument("--run", metavar="ID", help="only this run, by how its identity begins")
    parser.add_argument(
        "--epoch", type=count, metavar="N", help="only this stretch of a source that restarted"
    )
    group = parser.add_argument_group("sound")
    group.add_argument(
        "--idle-ratio", type=float, metavar="R", help="of the camera, when the recording has none"
    )
    group.add_argument("--samples", choices=("float32", "pcm16"), default="float32")
    parser.add_argument("--json", action="store_true")


def run_export(args: argparse.Namespace) -> int:
    """Export a topic."""
    from rsenf.record import open_recording

    kind = args.out.suffix.lower()
    if kind not in (SOUND, *TABLES):
        raise UsageError(
            f"{args.out}: no telling what to write", f"end it in {', '.join(TABLES)} or {SOUND}"
        )
    recording = open_recording(args.recording)
    usual, write = ("rows", _sound) if kind == SOUND else ("track", _table)
    topic = _find_topic(recording, args.topic or usual, args.camera)
    document, words = write(recording, topic, args)
    document = {"out": str(args.out), "topic": topic, **document, "lost": recording.lost}
    console.tell(args, document, f"{args.out}: {words}")
    if recording.lost:
        console.say(f"{args.recording}: {recording.lost}")
    return EXIT_LOSS if recording.lost else EXIT_DONE


def _find_topic(recording: Recording, name: str, camera: str | None) -> str:
    """Return the topic whose name, or its last part, this is; ``camera``: or a site, or a grid."""
    ours = [topic.name for topic in recording.topics.values() if topic.is_ours]
    meant = [t for t in ours if name in (t, t.rpartition("/")[2])]
    if camera:
        meant = [t for t in meant if camera in t.split("/")[:-1]]
    if len(meant) == 1:
        return meant[0]
    of_camera = f" of a camera {camera!r}" if camera else ""
    if not meant:
        there = ", ".join(ours) or "none"
        raise UsageError(f"{recording.path}: no topic {name!r}{of_camera}", f"its topics: {there}")
    raise UsageError(
        f"{recording.path}: several topics {name!r}: {', '.join(meant)}",
        "choose one with --camera, or give it whole",
    )


def _table(recording: Recording, topic: str, args: argparse.Namespace) -> Written:
    from rsenf.record.export import Selection, write_table

    lines = write_table(recording, topic, args.out, Selection(args.run, args.epoch))
    return {"lines": lines}, f"{lines} lines of {topic}"


def _sound(recording: Recording, topic: str, args: argparse.Namespace) -> Written:
    from rsenf.record.export import RecordedLight, Selection, write_sound

    light = RecordedLight(recording, topic, Selection(args.run, args.epoch))
    sound = write_sound(
        light.blocks,
        args.out,
        idle_ratio=light.idle_ratio if args.idle_ratio is None else args.idle_ratio,
        upwards=light.upwards,
        sample_format=args.samples,
        about={"recording": recording.path.name, "topic": topic, **light.part._asdict()},
    )
    return asdict(sound), (
        f"{sound.duration_s:.1f} s of {topic} at {sound.rate_hz} Hz; "
        f"full scale is {sound.levels_per_unit:.3g} levels"
    )


IMPORT = """\
Convert the pictures in another program's MCAP file to a recording, with the rows sampled.

Supports ROS 2 (sensor_msgs/msg/Image and CompressedImage, foxglove_msgs) and Foxglove
(CompressedVideo, CompressedImage and RawImage, Protobuf or JSON). Frame times are the pictures'
time stamps. Compressed pictures are copied; of raw ones the luma is kept, lossless.

'rsenf track', 'idle' and others also read such a file directly; --camera selects one of several."""


def add_import(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.add_argument("foreign", type=Path, metavar="FOREIGN.mcap")
    parser.add_argument("--out", type=Path, required=True, metavar="NEW.mcap")
    parser.add_argument("--site", default="import", metavar="NAME", help="of the cameras (import)")
    parser.add_argument("--overwrite", action="store_true")
    parser.add_argument("--json", action="store_true")
    console.add_row_arguments(parser)


def run_import(args: argparse.Namespace) -> int:
    """Import a file."""
    from rsenf.bus.keys import NAME_RULE, is_name
    from rsenf.record import open_recording
    from rsenf.run.foreign.convert import import_pictures

    if not is_name(args.site):
        raise UsageError(f"{args.site!r} is no name of a site", NAME_RULE)
    if args.out.exists() and not args.overwrite:
        raise UsageError(f"{args.out} exists", "--overwrite replaces it")
    recording = open_recording(args.foreign)
    if args.out.exists() and args.out.samefile(args.foreign):
        raise UsageError(f"{args.out} is the file to read", "name another")
    with console.progress_bar("importing", None) as progress:
        cameras = import_pictures(
            recording, args.out, site=args.site, camera=args.camera,
            rows=console.row_settings(args), progress=progress,
        )  # fmt: skip
    if args.json:
        documents = {name: asdict(done) for name, done in cameras.items()}
        document = {"out": str(args.out), "cameras": documents, "lost": recording.lost}
        console.print_json(document)
    losses = [recording.lost]
    for name, done in cameras.items():
        if not args.json:
            print(f"{name}: {done.frames} frames, {done.duration_s:.1f} s, from {done.topic}")
        losses.append(f"{name}: {done.loss}" if done.loss else "")
        for line in done.warnings:
            console.note(f"{name}: {line}")
    for loss in filter(None, losses):
        console.say(f"{args.foreign}: {loss}")
    return EXIT_LOSS if any(losses) else EXIT_DONE

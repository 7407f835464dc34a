"""Export one topic of a recording to a file for other programs; its suffix sets the format.

  .csv, .parquet   one line per message, or per frame for rows; the columns are the header's and
                   the message's fields with their units ('rsenf explain EnfEstimate')
  .wav             the light as a sound: rows at the rate they were read, idle periods filled in

In CSV, lists are JSON, and unknown values are empty cells. Pictures are not exported: Foxglove
shows them. A sound needs the camera's idle ratio: from the recording, or given.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rsenf.record import Recording

SOUND = ".wav"
TABLES = (".csv", ".parquet")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    from rsenf.cli.options import count

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


def run(args: argparse.Namespace) -> int:
    """Export a topic."""
    from rsenf.cli.console import print_json, say
    from rsenf.errors import EXIT_DONE, EXIT_LOSS, UsageError
    from rsenf.record import open_recording

    kind = args.out.suffix.lower()
    if kind not in (SOUND, *TABLES):
        raise UsageError(
            f"{args.out}: no telling what to write", f"end it in {', '.join(TABLES)} or {SOUND}"
        )
    recording = open_recording(args.recording)
    is_sound = kind == SOUND
    topic = find_topic(recording, args.topic or ("rows" if is_sound else "track"), args.camera)
    document = (_sound if is_sound else _table)(recording, topic, args)
    document = {"out": str(args.out), "topic": topic, **document, "lost": recording.lost}
    if args.json:
        print_json(document)
    else:
        print(_words(document))
    if recording.lost:
        say(f"{args.recording}: {recording.lost}")
    return EXIT_LOSS if recording.lost else EXIT_DONE


def find_topic(recording: Recording, name: str, camera: str | None) -> str:
    """Find a topic of a recording.

    Parameters
    ----------
    recording : Recording
    name : str
        The full topic, or its last part, such as ``track``.
    camera : str or None
        Camera, site or grid; needed if several topics have the name.

    Raises
    ------
    UsageError
        When no topic, or more than one, fits.
    """
    from rsenf.errors import UsageError

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


def _table(recording: Recording, topic: str, args: argparse.Namespace) -> dict[str, Any]:
    from rsenf.record.export import Part, write_table

    return {"lines": write_table(recording, topic, args.out, Part(args.run, args.epoch))}


def _sound(recording: Recording, topic: str, args: argparse.Namespace) -> dict[str, Any]:
    from dataclasses import asdict

    from rsenf.record.export import Part, RecordedLight, write_sound

    light = RecordedLight(recording, topic, Part(args.run, args.epoch))
    sound = write_sound(
        light.blocks,
        args.out,
        idle_ratio=light.idle_ratio if args.idle_ratio is None else args.idle_ratio,
        upwards=light.upwards,
        sample_format=args.samples,
        about={"recording": recording.path.name, "topic": topic, **light.part._asdict()},
    )
    return asdict(sound)


def _words(document: dict[str, Any]) -> str:
    if "lines" in document:
        return f"{document['out']}: {document['lines']} lines of {document['topic']}"
    return (
        f"{document['out']}: {document['duration_s']:.1f} s of {document['topic']} at "
        f"{document['rate_hz']} Hz; full scale is {document['levels_per_unit']:.3g} levels"
    )

"""Damages foreign files at random, and sees what comes of them.

``python -m tests.run.foreign_damage 10000 1`` prints how many ended how; a crash is printed with
the seed that makes it again.
"""

from __future__ import annotations

import struct
import sys
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parent))

from foreign_files import (
    SECOND_NS,
    STAMP_NS,
    foxglove_json,
    foxglove_protobuf,
    h264_packets,
    ros_compressed,
    ros_image,
    still,
    wall_luma,
    write_mcap,
)
from mcap.writer import CompressionType

from rsenf.errors import RsenfError
from rsenf.record import open_recording
from rsenf.rows.settings import RowsSettings
from rsenf.run.foreign.convert import import_pictures

VIDEO, RAW = "foxglove.CompressedVideo", "foxglove.RawImage"
FORMS = ("raw", "jpeg", "png", "protobuf video", "json raw")
COUNT = 12


def samples() -> dict[str, bytes]:
    """Small whole files of every form; without compression, so that damage gets through."""
    films = {form: [] for form in FORMS}
    packets = h264_packets(COUNT)
    for k, (stamp_ns, luma) in enumerate(wall_luma(COUNT)):
        size = {"width": 32, "height": 24, "step": 32, "encoding": "mono8"}
        video = foxglove_protobuf(VIDEO, stamp_ns, data=packets[k], format="h264")
        films["raw"].append(
            (
                "cdr",
                "sensor_msgs/msg/Image",
                ros_image(stamp_ns, "mono8", 24, 32, 32, luma.tobytes()),
            )
        )
        for form, ending in (("jpeg", ".jpg"), ("png", ".png")):
            payload = ros_compressed(stamp_ns, form, still(luma, ending))
            films[form].append(("cdr", "sensor_msgs/msg/CompressedImage", payload))
        films["protobuf video"].append(("protobuf", VIDEO, video))
        films["json raw"].append(
            ("json", RAW, foxglove_json(stamp_ns, data=luma.tobytes(), **size))
        )
    with tempfile.TemporaryDirectory() as folder:
        return {form: _file(Path(folder) / "a.mcap", film) for form, film in films.items()}


def _file(path: Path, film: list[tuple[str, str, bytes]]) -> bytes:
    messages = [("/cam", *message, STAMP_NS + k * SECOND_NS) for k, message in enumerate(film)]
    return write_mcap(path, messages, CompressionType.NONE, chunk_size=4000).read_bytes()


def damaged(whole: bytes, rng: np.random.Generator) -> bytes:
    """Flip bytes, cut, swap or blank parts; half of the time checksums of chunks are taken out."""
    content = bytearray(whole)
    if rng.random() < 0.5:
        _forget_checksums(content)
    kind, at = rng.integers(4), int(rng.integers(len(content)))
    if kind == 0:
        for place in rng.integers(0, len(content), int(rng.integers(1, 8))):
            content[place] = int(rng.integers(256))
    elif kind == 1:
        del content[at:]
    elif kind == 2:
        size, other = int(rng.integers(1, 400)), int(rng.integers(len(content)))
        content[at : at + size] = content[other : other + size]
    else:
        size = int(rng.integers(1, 400))
        content[at : at + size] = bytes(len(content[at : at + size]))
    return bytes(content)


def _forget_checksums(content: bytearray) -> None:
    """Zero the checksum of every chunk: 'there is none'."""
    at = 8
    while at + 9 <= len(content):
        kind, length = struct.unpack_from("<BQ", content, at)
        if kind == 6:
            content[at + 9 + 24 : at + 9 + 28] = bytes(4)
        at += 9 + length


def outcome(folder: Path, content: bytes) -> str:
    """Import a file; return how it ended: 'whole', 'part', an error's name, or 'CRASH …'."""
    path, out = folder / "foreign.mcap", folder / "new.mcap"
    path.write_bytes(content)
    out.unlink(missing_ok=True)
    try:
        recording = open_recording(path)
        done = import_pictures(recording, out, site="x", rows=RowsSettings())
    except RsenfError as exc:
        assert not out.exists()
        return type(exc).__name__
    except Exception as exc:  # noqa: BLE001 - what is looked for
        return f"CRASH {type(exc).__name__}: {exc}"
    assert open_recording(out).complete
    lost = recording.lost or any(one.loss for one in done.values())
    return "part" if lost else "whole"


def main(count: int, seed: int) -> int:
    ends: Counter[str] = Counter()
    whole = samples()
    with tempfile.TemporaryDirectory() as folder:
        for number in range(count):
            rng = np.random.default_rng([seed, number])
            form = FORMS[number % len(FORMS)]
            end = outcome(Path(folder), damaged(whole[form], rng))
            ends[end] += 1
            if end.startswith("CRASH"):
                print(f"seed {seed}, number {number}, {form}: {end}")
    print(dict(ends))
    return 1 if any(end.startswith("CRASH") for end in ends) else 0


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]), int(sys.argv[2])))

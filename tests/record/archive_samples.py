"""An archive in the making, with a clock that is moved by hand."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from record_samples import NOW_NS, Clock, packet, rows

from rsenf.messages import encode
from rsenf.record import open_recording
from rsenf.record.archive import ArchiveRecorder
from rsenf.record.limits import AlarmSettings, Retention, Rotation

CAM1, CAM2 = "rsenf/lab/cam1", "rsenf/lab/cam2"
FRAME_S = 0.04


def archive(root: Path, clock: Clock, **options: Any) -> ArchiveRecorder:
    """Open an archive."""
    given = {"rotation": Rotation(), "retention": Retention(), "alarms": AlarmSettings()}
    given["run_info"] = {"run_id": "run"}
    return ArchiveRecorder(root, clock_ns=clock, **{**given, **options})


def put(recorder: ArchiveRecorder, topic: str, message: Any) -> bool:
    """Record a message as it would come from the bus."""
    return recorder.write_encoded(topic, type(message), encode(message), message.header)


def film(
    recorder: ArchiveRecorder,
    clock: Clock,
    frames: range,
    cameras: tuple[str, ...] = (CAM1,),
    size: int = 200,
) -> None:
    """Record video with a key frame every ten frames, and rows, as a live camera sends them."""
    for seq in frames:
        for camera in cameras:
            put(recorder, f"{camera}/video", packet(seq, size, **at(seq)))
            put(recorder, f"{camera}/rows", rows(seq, **at(seq)))
        recorder.tick()
        clock.advance(FRAME_S)


def at(seq: int) -> dict[str, int]:
    """Stream time and arrival of a frame."""
    pts_ns = round(seq * FRAME_S * 1e9)
    return {"pts_ns": pts_ns, "arrival_time_ns": NOW_NS + pts_ns}


def files(root: Path) -> list[Path]:
    """Files of an archive, the oldest first."""
    return sorted(root.glob("*/*/*/*.mcap"))


def numbers(path: Path, topic: str) -> list[int]:
    """Sequence numbers that a file has of a topic."""
    return [m.header.seq for _, m, _ in open_recording(path).messages([topic])]


def written_at(path: Path, time_ns: int) -> None:
    """Say when a file was last written."""
    os.utime(path, ns=(time_ns, time_ns))

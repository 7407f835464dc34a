"""Writing one 1080p30 feed, video passed through, faster than it comes: what is lost, and memory.

Not a test by itself: ``python -m tests.record.ten_times 600 10 7 /tmp/out`` writes 600 s of a feed
of 4 Mb/s at ten times real time into an archive, with the numbers drawn from seed 7, and prints
what came back and the memory over time. Rate 0 is as fast as it goes.
"""

from __future__ import annotations

import resource
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rsenf.messages import Header, RowBlock, VideoPacket, encode
from rsenf.record import open_recording
from rsenf.record.archive import ArchiveRecorder
from rsenf.record.archive.layout import archived_files
from rsenf.record.limits import AlarmSettings, Retention, Rotation

CAMERA = "rsenf/site/cam"
FRAMES_PER_S, GOP, BLOCK, ROWS, STRIPS = 30, 30, 8, 1080, 2
PACKET_BYTES, KEY_BYTES = 14_700, 74_000  # 4 Mb/s
STATM = Path("/proc/self/statm")


@dataclass(frozen=True)
class Outcome:
    """What was sent, what is there, how late it became and what memory it took.

    ``memory_mb`` is the resident memory after each tenth of the feed.
    """

    sent: int
    read: int
    in_order: bool
    files: int
    size_mb: float
    took_s: float
    latest_s: float
    memory_mb: tuple[float, ...]
    peak_mb: float


def feed(seconds: int, seed: int) -> Iterator[tuple[str, Any]]:
    """Packets, and a block of rows every eight frames."""
    rng = np.random.default_rng(seed)
    level = rng.normal(100, 5, (BLOCK, ROWS, STRIPS)).astype(np.float32)
    for seq in range(seconds * FRAMES_PER_S):
        key = seq % GOP == 0
        size = int((KEY_BYTES if key else PACKET_BYTES) * rng.uniform(0.8, 1.2))
        data = rng.bytes(size)  # never the same, or it would compress
        yield (
            f"{CAMERA}/video",
            VideoPacket(header=_header(seq, seq), codec="h264", keyframe=key, data=data),
        )
        if seq % BLOCK == BLOCK - 1:
            first = seq - BLOCK + 1
            yield (
                f"{CAMERA}/rows",
                RowBlock(
                    header=_header(seq // BLOCK, first),
                    frames=BLOCK,
                    rows=ROWS,
                    strips=STRIPS,
                    frame_number=np.arange(first, seq + 1),
                    frame_pts_ns=np.arange(first, seq + 1) * 33_366_667,
                    level=level + np.float32(rng.normal()),
                    kept_px=np.full((ROWS, STRIPS), 960, np.uint32),
                ),
            )


def _header(seq: int, frame: int) -> Header:
    return Header(run_id="study", source="site/cam", seq=seq, pts_ns=frame * 33_366_667,
                  arrival_time_ns=1_790_000_000 * 10**9 + frame * 33_366_667)  # fmt: skip


def write(folder: Path, seconds: int, rate: float, seed: int) -> Outcome:
    """Write the feed at a rate, and read all of it back."""
    begun, latest_s, sent, memory_mb = time.monotonic(), 0.0, 0, []
    with ArchiveRecorder(
        folder,
        run_info={"run_id": "study"},
        clock_ns=time.time_ns,
        rotation=Rotation(size_mb=100.0),
        retention=Retention(),
        alarms=AlarmSettings(),
    ) as recorder:
        for topic, message in feed(seconds, seed):
            if rate:
                ahead_s = message.header.pts_ns / 1e9 / rate - (time.monotonic() - begun)
                latest_s = max(latest_s, -ahead_s)
                time.sleep(max(ahead_s, 0.0))
            recorder.write_encoded(topic, type(message), encode(message), message.header)
            recorder.tick()
            sent += 1
            if message.header.pts_ns / 1e9 >= seconds * (len(memory_mb) + 1) / 10 - 0.3:
                memory_mb.append(_memory_mb())
    took_s = time.monotonic() - begun
    read, in_order = _read_back(folder)
    files = archived_files(folder)
    size_mb = sum(file.path.stat().st_size for file in files) / 1e6
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    return Outcome(
        sent, read, in_order, len(files), size_mb, took_s, latest_s, tuple(memory_mb), peak_mb
    )


def _read_back(folder: Path) -> tuple[int, bool]:
    """Count the messages, and tell whether each topic's numbers follow each other."""
    expected: dict[str, int] = {}
    in_order = True
    for file in archived_files(folder):
        for topic, message, _ in open_recording(file.path).messages():
            in_order &= message.header.seq == expected.get(topic, 0)
            expected[topic] = message.header.seq + 1
    return sum(expected.values()), in_order


def _memory_mb() -> float:
    return int(STATM.read_text().split()[1]) * resource.getpagesize() / 1e6


if __name__ == "__main__":
    print(write(Path(sys.argv[4]), int(sys.argv[1]), float(sys.argv[2]), int(sys.argv[3])))

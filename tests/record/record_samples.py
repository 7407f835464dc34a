"""Messages of every class with random content, and a clock that stands still until moved."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from rsenf.messages import Header, RowBlock, VideoPacket
from rsenf.messages.schema import _ARRAYS, field_specs, message_classes
from rsenf.record import Recorder

SECOND_NS = 1_000_000_000
NOW_NS = 1_790_000_000 * SECOND_NS
ROWS = "rsenf/site/cam/rows"
VIDEO = "rsenf/site/cam/video"


class Clock:
    def __init__(self, now_ns: int = NOW_NS) -> None:
        self.now_ns = now_ns

    def __call__(self) -> int:
        return self.now_ns

    def advance(self, seconds: float) -> None:
        self.now_ns += round(seconds * SECOND_NS)


def header(seq: int, **changed: Any) -> Header:
    given = {
        "run_id": "run",
        "source": "site/cam",
        "seq": seq,
        "frame_first": seq,
        "frame_last": seq,
        "pts_ns": seq * 40_000_000,
        "arrival_time_ns": NOW_NS + seq * 1_000_000,
    }
    return Header(**{**given, **changed})


def random_message(cls: type[Any], seed: int, head: Header) -> Any:
    """Fill every field of a message class, by what its schema says of it and nothing else."""
    rng = np.random.default_rng(seed)
    values: dict[str, Any] = {}
    for spec in field_specs(cls):
        if spec.kind == "scalar":
            values[spec.name] = _scalar(spec.wire, rng)
        elif spec.kind == "message":
            values[spec.name] = head
        elif spec.kind == "repeated":
            inner = message_classes().get(spec.wire)
            values[spec.name] = tuple(
                random_message(inner, seed + k, head) if inner else _scalar(spec.wire, rng)
                for k in range(3)
            )
    sizes = {name for spec in field_specs(cls) for name in spec.shape}
    values.update({name: int(rng.integers(1, 5)) for name in sizes})
    for spec in field_specs(cls):
        if spec.kind == "array":
            shape = tuple(values[name] for name in spec.shape) or (3,)
            raw = rng.bytes(int(np.prod(shape)) * 8)  # any bits, NaN and infinity included
            values[spec.name] = np.frombuffer(raw, _ARRAYS[spec.wire])[: np.prod(shape)].reshape(
                shape
            )
    return cls(**values)


def _scalar(wire: str, rng: np.random.Generator) -> Any:
    return {
        "int64": lambda: int(rng.integers(-(2**62), 2**62)),
        "double": lambda: float(rng.normal()) if rng.random() < 0.8 else float("inf"),
        "bool": lambda: bool(rng.random() < 0.5),
        "string": lambda: "ρ²·" + "".join(rng.choice(list("abc d/"), 5)),
        "bytes": lambda: rng.bytes(20),
    }[wire]()


def packet(seq: int, size: int = 200, codec: str = "h264", **changed: Any) -> VideoPacket:
    data = np.random.default_rng(seq).bytes(size)
    return VideoPacket(
        header=header(seq, **changed), codec=codec, keyframe=seq % 10 == 0, data=data
    )


def rows(number: int, frames: int = 2, n_rows: int = 6, **changed: Any) -> RowBlock:
    rng = np.random.default_rng(number)
    return RowBlock(
        header=header(**{"seq": number, **changed}),
        frames=frames,
        rows=n_rows,
        strips=2,
        frame_number=np.arange(frames) + number * frames,
        frame_pts_ns=np.arange(frames) * 40_000_000,
        level=rng.normal(100, 5, (frames, n_rows, 2)).astype(np.float32),
        kept_px=np.full((n_rows, 2), 640, np.uint32),
    )


def sample_file(path: Path, seconds: int = 3, **options: Any) -> list[tuple[str, Any]]:
    """Record rows and video, flushed once a second; return what was written, in order."""
    clock = Clock()
    written = list(sample_stream(seconds))
    with Recorder(path, run_info={"run_id": "run"}, clock_ns=clock, **options) as recorder:
        for topic, message in written:
            recorder.write(topic, message)
            clock.advance(0.04)
    return written


def sample_stream(seconds: int) -> Iterator[tuple[str, Any]]:
    for seq in range(seconds * 12):
        yield VIDEO, packet(seq)
        yield ROWS, rows(seq)

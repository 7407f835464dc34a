"""Rows of a recording for ``rsenf discover``, and what its codec makes of others."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from rsenf.cli.begun import Arrays, Begun
    from rsenf.discrepancy.measured import Measured
    from rsenf.messages import RowBlock
    from rsenf.messages.schema import Float32Array
    from rsenf.rows.settings import RowsSettings
    from rsenf.run.inputs import Input

STRIPS = 4  # of a video's rows: two from left to right, each in two that a codec treats apart


def identity_of(args: argparse.Namespace) -> str:
    """Return what tells a recording and the way it is sampled from any other."""
    path = Path(args.input)
    there = path.stat() if path.exists() else None
    changed = (there.st_size, there.st_mtime_ns) if there else ()
    return f"{path.resolve()} {changed} {args.camera} {_settings(args)}"


def rows_of(
    args: argparse.Namespace, recording: Input, run: Begun, progress: Callable[[float], None]
) -> tuple[list[RowBlock], str]:
    """Return the rows of the recording's first stretch, and what of it could not be read."""
    from rsenf.messages import RowBlock, decode, encode

    if recording.begins_with != "frames":  # rows are read in no time
        return _read(args, recording, progress)

    def read() -> Arrays:
        blocks, loss = _read(args, recording, progress)
        coded = [encode(block) for block in blocks]
        return {
            "bytes": np.frombuffer(b"".join(coded), np.uint8),
            "ends": np.cumsum([len(one) for one in coded], dtype=np.int64),
            "loss": np.array(loss),
        }

    kept = run.kept(b"rows", read)
    coded, begin, blocks = kept["bytes"].tobytes(), 0, []
    for end in kept["ends"].tolist():
        blocks.append(decode(RowBlock, coded[begin:end]))
        begin = end
    return blocks, str(kept["loss"])


def recoded_by(
    args: argparse.Namespace, run: Begun
) -> Callable[[Measured], Callable[[Float32Array], Float32Array]]:
    """Return what puts rows through the codec of a video, once they are told to be coded."""
    from rsenf.run.recoded import recoded

    def of(data: Measured) -> Callable[[Float32Array], Float32Array]:
        def through(level: Float32Array) -> Float32Array:
            def make() -> Arrays:
                return {"level": recoded(Path(args.input), level, data.axis, _settings(args))}

            what = f"recoded {data.axis} {level.shape} ".encode() + level.tobytes()
            return np.asarray(run.kept(what, make)["level"], np.float32)

        return through

    return of


def _read(
    args: argparse.Namespace, recording: Input, progress: Callable[[float], None]
) -> tuple[list[RowBlock], str]:
    from rsenf.run.inline import analyse

    blocks: list[RowBlock] = []

    def tap(topic: str, message: Any) -> None:
        if topic == "rows":
            blocks.append(message)

    analysis = analyse(recording, rows=_settings(args), progress=progress, tap=tap)
    epoch = blocks[0].header.epoch if blocks else 0
    return [b for b in blocks if b.header.epoch == epoch], analysis.loss


def _settings(args: argparse.Namespace) -> RowsSettings:
    import dataclasses

    from rsenf.cli.console import row_settings

    return dataclasses.replace(row_settings(args), strips=STRIPS)

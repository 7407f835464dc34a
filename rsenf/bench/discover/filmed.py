"""A case filmed, encoded by a real codec, decoded and sampled: the workflow gets a video."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from rsenf.api.recordings import read_recording
from rsenf.bench.discover.plan import Case
from rsenf.bench.discover.scene import Drawn
from rsenf.discrepancy.measured import Float32Array, Measured, measured_of
from rsenf.model import render_frames
from rsenf.model.codec import Codec
from rsenf.model.video_file import write_video
from rsenf.rows.settings import RowsSettings
from rsenf.run.recoded import is_lossy, recoded

CODECS = {
    "lossless": Codec(lossless=True),
    "x264 4 Mb/s": Codec(bitrate_bps=4_000_000),
}
ROWS = RowsSettings(strips=4)  # as the command samples a video


def codec_of(case: Case) -> str:
    """Name of the codec of a case: they take turns."""
    return tuple(CODECS)[case.seed % len(CODECS)] if case.video else ""


def filmed(case: Case, made: Drawn, path: Path) -> None:
    """Film a case into a file."""
    frames = render_frames(made.truth, made.grid, case.duration_s, case.seed)
    write_video(path, frames, CODECS[codec_of(case)])


def sampled(path: Path) -> tuple[Measured, Callable[[Float32Array], Float32Array] | None]:
    """Return the rows of a video, and what codes rows as it was coded, where it is."""
    data = measured_of(read_recording(path, rows=ROWS).blocks)
    again = (lambda level: recoded(path, level, data.axis, ROWS)) if is_lossy(path) else None
    return data, again

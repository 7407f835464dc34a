"""A clip rendered once: row blocks of the raw frames, and of every encoding after decoding."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsenf.bench.plan import codec_of
from rsenf.bench.scenes import Setting
from rsenf.decode import SourceSpec, open_source
from rsenf.messages import Frame, Header, RowBlock
from rsenf.model import FrameStream, GridPath, write_videos
from rsenf.model.exposures import Capture
from rsenf.rows.stage import Rows
from rsenf.timebase import pts_to_ns

Luma = NDArray[np.uint8]


@dataclass(eq=False)
class Filmed:
    """A clip as row blocks.

    Parameters
    ----------
    truth : dict
        From the simulation.
    blocks : dict of str to list of RowBlock
        By coding.
    cpu_s : dict of str to float
        Processor time of ``film`` (rendering and encoding) and ``decode`` (decoding and sampling).
    """

    truth: dict[str, Any]
    blocks: dict[str, list[RowBlock]] = field(default_factory=dict)
    cpu_s: dict[str, float] = field(default_factory=dict)


class _Shown(FrameStream):
    """The frames of a clip; a callback gets each one before the encoders do."""

    def __init__(self, capture: Capture, show: Callable[[int, int, Luma], None]) -> None:
        super().__init__(capture)
        self._show = show

    def __iter__(self) -> Iterator[tuple[int, Luma]]:
        for number, (pts, luma) in enumerate(super().__iter__()):
            self._show(number, pts_to_ns(pts, self.time_base), luma)
            yield pts, luma


def film(setting: Setting, grid: GridPath, duration_s: float, codings: Sequence[str]) -> Filmed:
    """Film a clip, encode it in the same pass, decode, and sample the rows of every coding.

    Rows of the lossless coding are sampled from the raw frames. Encoded files are temporary.
    """
    begin_s = time.process_time()
    rows, blocks = Rows(), []

    def sample(number: int, pts_ns: int, luma: Luma) -> None:
        height, width = luma.shape
        header = Header(frame_first=number, frame_last=number, seq=number, pts_ns=pts_ns)
        blocks.extend(
            rows.update(Frame(header=header, height_px=height, width_px=width, luma=luma))
        )

    frames = _Shown(Capture(setting.model, grid, duration_s, setting.seed), sample)
    filmed = Filmed(truth=frames.truth)
    codecs = {coding: codec_of(coding) for coding in codings}
    with tempfile.TemporaryDirectory(prefix="rsenf-bench-") as folder:
        files = {coding: Path(folder) / f"{coding}.mp4" for coding in codings}
        write_videos({files[c]: codec for c, codec in codecs.items() if codec}, frames)
        filmed.cpu_s["film"] = time.process_time() - begin_s
        begin_s, blocks = time.process_time(), blocks + rows.flush()
        for coding, codec in codecs.items():
            filmed.blocks[coding] = decoded(files[coding]) if codec else blocks
        filmed.cpu_s["decode"] = time.process_time() - begin_s
    return filmed


def decoded(path: Path) -> list[RowBlock]:
    """Decode a video file and sample its rows with the default settings."""
    rows, blocks = Rows(), []
    # One thread: several clips are measured in parallel.
    spec = SourceSpec(url=str(path), kind="file", threads=1)
    with open_source(spec, source="", run_id="", clock_ns=lambda: 0) as frames:
        for frame in frames:
            assert isinstance(frame, Frame)  # packets come only on request
            blocks += rows.update(frame)
    return blocks + rows.flush()

"""A clean simulated clip, and FFmpeg's filters on it: effects that rsenf didn't make."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import av.filter

from rsenf.model import CaptureModel, Light, Shutter, render_frames, synthetic_grid
from rsenf.model.codec import Codec
from rsenf.model.video_file import write_video

SECONDS, WIDTH_PX, LINES = 27.0, 192, 160
Filters = tuple[tuple[str, str], ...]


def film(path: Path, seed: int, rate: Fraction = Fraction(30000, 1001)) -> None:
    """Film a wall under a pure tone, losslessly."""
    shutter = Shutter(frame_rate=rate, rows=LINES, columns=WIDTH_PX, idle_ratio=0.38)
    model = CaptureModel(light=Light(lamp="tone"), shutter=shutter)
    frames = render_frames(model, synthetic_grid(seed, SECONDS + 1.0), SECONDS, seed)
    write_video(path, frames, Codec(lossless=True))


def pass_through(source: Path, out: Path, filters: Filters, **options: str) -> None:
    """Decode a clip, filter it, and code it by x264: losslessly unless told otherwise."""
    with av.open(str(source)) as given, av.open(str(out), "w") as made:
        stream = given.streams.video[0]
        graph = av.filter.Graph()
        chain = [graph.add_buffer(template=stream), *(graph.add(*each) for each in filters)]
        graph.link_nodes(
            *chain, graph.add("format", "yuv420p"), graph.add("buffersink")
        ).configure()
        coder: Any = None
        for frame in given.decode(stream):
            graph.push(frame)
            coder = _pull(graph, made, coder, stream, options)
        graph.push(None)
        coder = _pull(graph, made, coder, stream, options)
        made.mux(coder.encode(None))


def _pull(graph: Any, made: Any, coder: Any, stream: Any, options: dict[str, str]) -> Any:
    while True:
        try:
            frame = graph.pull()
        except (av.BlockingIOError, av.EOFError):
            return coder
        if coder is None:
            coder = made.add_stream("libx264", rate=stream.average_rate)
            coder.options = {"preset": "ultrafast"} | (options or {"qp": "0"})
            coder.width, coder.height, coder.pix_fmt = frame.width, frame.height, "yuv420p"
            coder.codec_context.time_base = frame.time_base
        frame.pict_type = 0
        made.mux(coder.encode(frame))

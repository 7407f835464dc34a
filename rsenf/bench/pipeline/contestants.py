"""What is timed over a film, in turns: a bare decoder, rsenf in one process, and rsenf as a graph.

Each turn runs in a new process.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsenf import __version__
from rsenf.batch.journal import Record
from rsenf.bench.harness import HELD, PEAK, memory_mb, watch_others
from rsenf.bench.pipeline import SIZES, Film, made, reference_of
from rsenf.bench.pipeline.graphs import Ran, Split, run_split
from rsenf.errors import NodeFailed
from rsenf.messages import Frame, Header
from rsenf.rows.stage import Rows

FFMPEG, PYAV, ONE = "ffmpeg", "PyAV", "one process"
COPY, MEANS, LIVE = "copy of the plane", "row means", "live"
SPLITS = {
    "fused": Split(record=False),
    "fused, recorded": Split(),
    "apart": Split(frames="ring", record=False),
    "apart, recorded": Split(frames="ring"),
}
PLANES, OF_PLANES = 32, 320
_BENCH = re.compile(r"bench: utime=([\d.]+)s stime=([\d.]+)s rtime=([\d.]+)s")
_MAXRSS = re.compile(r"maxrss=(\d+)ki?B", re.IGNORECASE)


def has_ffmpeg() -> bool:
    """Whether ffmpeg is installed, with which everything is compared."""
    return shutil.which("ffmpeg") is not None


def contestants() -> tuple[str, ...]:
    """Return the names of all contestants on this machine."""
    beside = (FFMPEG,) if has_ffmpeg() else ()
    return (*beside, PYAV, ONE, *SPLITS, COPY, MEANS)


def time_it(contestant: str, film: Film, path: Path) -> Record:
    """Time a contestant on a film.

    Parameters
    ----------
    contestant : str
        Of :func:`contestants`, or :data:`LIVE`.
    film : Film
    path : Path
        Its file.

    Returns
    -------
    dict
        ``frames``, ``seconds``, ``cpu_s`` and ``peak_mb``; of a graph also by node.
    """
    timers: dict[str, Callable[[], Record]] = {
        FFMPEG: lambda: _ffmpeg(film, path),
        PYAV: lambda: _in_here(_bare(path), film.frames),
        ONE: lambda: _in_here(_one_process(path), film.frames),
        COPY: lambda: _copies(film),
        MEANS: lambda: _row_means(film),
        LIVE: lambda: _latency(path),
    }
    if contestant in SPLITS:
        return _graph(SPLITS[contestant], film, path)
    return timers[contestant]()


def _ffmpeg(film: Film, path: Path) -> Record:
    """Decode with ffmpeg; times by its own benchmark, without its start."""
    words = ["ffmpeg", "-nostdin", "-hide_banner", "-benchmark", "-i", str(path), "-map", "0:v:0",
             "-f", "null", "-"]  # fmt: skip
    ended = subprocess.run(words, capture_output=True, text=True, check=False)
    took, peak = _BENCH.search(ended.stderr), _MAXRSS.search(ended.stderr)
    if ended.returncode or took is None:
        raise NodeFailed(f"ffmpeg can't decode {path.name}")
    user_s, system_s, seconds = map(float, took.groups())
    peak_mb = int(peak[1]) / 1024 if peak else None
    return _record(film.frames, seconds, user_s + system_s, peak_mb)


def _in_here(work: Callable[[], Any], frames: int) -> Record:
    """Time a function in this process, without imports."""
    held_mb = memory_mb(HELD)
    begun_s, spent_s = time.perf_counter(), time.process_time()
    work()
    seconds, cpu_s = time.perf_counter() - begun_s, time.process_time() - spent_s
    return {**_record(frames, seconds, cpu_s, memory_mb(PEAK)), "held_mb": held_mb}


def _record(frames: int, seconds: float, cpu_s: float, peak_mb: float | None) -> Record:
    return {"frames": frames, "seconds": seconds, "cpu_s": cpu_s, "peak_mb": peak_mb}


def _bare(path: Path) -> Callable[[], None]:
    """Return a function that only decodes."""
    import av

    def work() -> None:
        with av.open(str(path)) as container:
            stream = container.streams.video[0]
            stream.thread_type = "AUTO"
            for _ in container.decode(stream):
                pass

    return work


def _one_process(path: Path) -> Callable[[], Any]:
    """Return a function that analyses a film; libraries and the reference are loaded before.

    Loading takes 0.25 s, some per cent of the time of a film of minutes.
    """
    import rsenf.decode.file  # noqa: F401 - FFmpeg
    from rsenf.idle import IdleSettings
    from rsenf.live import Live
    from rsenf.live.settings import LiveSettings
    from rsenf.reference import open_reference, reference_blocks
    from rsenf.rows.settings import RowsSettings
    from rsenf.run.inline import analyse
    from rsenf.run.inputs import open_input_file
    from rsenf.track import TrackSettings

    reference = open_reference(str(reference_of(path)), timezone="UTC")
    blocks = list(reference_blocks(reference, source="reference/mains", run_id=""))
    return lambda: analyse(
        open_input_file(path),
        rows=RowsSettings(),
        track=TrackSettings(),
        idle=IdleSettings(),
        make_live=lambda: Live(LiveSettings(), start_utc_ns=reference.t0_ns),
        reference=blocks,
    )


def _graph(split: Split, film: Film, path: Path) -> Record:
    """Time a graph, from the first batch of rows to the end of the last node."""
    with tempfile.TemporaryDirectory(prefix="rsenf-bench-") as folder:
        ran = run_split(split, path, Path(folder))
    first, cpu_s = ran.begun, ran.cpu_s
    return {
        **_record(
            film.frames - first.header.frame_last - 1,
            (ran.ended_ns - first.at_ns) / 1e9,
            sum(cpu_s.values()) * (1 - (first.header.frame_last + 1) / film.frames),
            sum(ran.peak_mb.values()),
        ),
        "node_cpu_s": cpu_s,
        "node_peak_mb": ran.peak_mb,
        "lost": ran.lost,
    }


def _latency(path: Path) -> Record:
    """Play a film in real time; return the latency of rows and estimates.

    Counted from the arrival of the first frame of the newest block in a message.
    """
    with tempfile.TemporaryDirectory(prefix="rsenf-bench-") as folder:
        ran = run_split(Split(threads=1, pace=True), path, Path(folder))
    return {"latency_s": latencies_s(ran), "lost": ran.lost}


def latencies_s(ran: Ran) -> dict[str, list[float]]:
    """Return the latencies of received messages by topic, s."""
    out: dict[str, list[float]] = {}
    for h in ran.heard:
        if not h.header.is_end:
            out.setdefault(h.topic, []).append((h.at_ns - h.header.arrival_time_ns) / 1e9)
    return out


def _copies(film: Film) -> Record:
    """Time copies of luma planes: the limit by memory bandwidth."""
    planes = _planes(film)
    to = np.empty_like(planes[0])

    def work() -> None:
        for number in range(OF_PLANES):
            np.copyto(to, planes[number % PLANES])

    work()  # first access to the memory
    return _in_here(work, OF_PLANES)


def _row_means(film: Film) -> Record:
    """Time the row means of the same planes."""
    planes, rows = _planes(film), Rows()
    height_px, width_px = planes[0].shape

    def work() -> None:
        for number in range(OF_PLANES):
            header = Header(frame_first=number, frame_last=number, seq=number)
            luma = planes[number % PLANES]
            rows.update(Frame(header=header, height_px=height_px, width_px=width_px, luma=luma))

    work()
    return _in_here(work, OF_PLANES)


def _planes(film: Film) -> list[NDArray[np.uint8]]:
    """Return planes of noise, larger in all than the cache."""
    width, height = SIZES[film.size]
    plane = np.random.default_rng(film.seed).integers(90, 130, (height, width), np.uint8)
    return [np.roll(plane, number) for number in range(PLANES)]


VERSION = 2
RESULTS, FILMS = "pipeline.jsonl", "films"
LIVE_FRAMES = 900


@dataclass(frozen=True)
class Turn:
    """One turn of a contestant on a film."""

    contestant: str
    film: Film
    number: int

    @property
    def key(self) -> str:
        """Unique name, by which its record is found."""
        return f"{self.film.name} {self.contestant} {self.number} v{VERSION}"


def turns(films: Sequence[Film], rounds: int) -> list[Turn]:
    """Return all turns: in a round each contestant has one, so that load affects all alike."""
    out = []
    for film in films:
        again = [Turn(name, film, n) for n in range(rounds) for name in contestants()]
        once = Film(film.size, film.codec, LIVE_FRAMES, film.filmed, film.seed)
        out += [*again, Turn(LIVE, once, 0)]
    return out


def taken(turn: Turn, films: Path) -> Record:
    """Measure a turn."""
    film = turn.film
    path, others = made(film, films), watch_others()
    timed = time_it(turn.contestant, film, path)
    return {
        "version": VERSION,
        "key": turn.key,
        "contestant": turn.contestant,
        "size": film.size,
        "codec": film.codec,
        "bitrate_bps": film.bitrate_bps,
        "number": turn.number,
        "others_ratio": others(),
        "cores": os.cpu_count(),
        "rsenf": __version__,
        **timed,
    }

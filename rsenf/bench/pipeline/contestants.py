"""What is timed side by side: a bare decoder, this program in one process, and as a graph.

Contestants take turns over films, each time in a process of its own.
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
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsenf import __version__
from rsenf.batch.journal import Record
from rsenf.bench.harness import measure_in_turn
from rsenf.bench.machine import HELD, PEAK, memory_mb, watch_others
from rsenf.bench.pipeline.films import SIZES, Film, made, reference_of
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
    """Whether the program that everything is compared with is there."""
    return shutil.which("ffmpeg") is not None


def contestants() -> tuple[str, ...]:
    """Return the names of all that can be timed here, in turn."""
    beside = (FFMPEG,) if has_ffmpeg() else ()
    return (*beside, PYAV, ONE, *SPLITS, COPY, MEANS)


def time_it(contestant: str, film: Film, path: Path) -> Record:
    """Time one over a film.

    Returns
    -------
    dict
        ``frames`` in ``seconds``, with ``cpu_s`` and ``peak_mb``; of a graph by node, too.
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
    """Decode with the program; its own clock, which begins when it is loaded."""
    words = ["ffmpeg", "-nostdin", "-hide_banner", "-benchmark", "-i", str(path), "-map", "0:v:0",
             "-f", "null", "-"]  # fmt: skip
    told = subprocess.run(words, capture_output=True, text=True, check=False)
    took, peak = _BENCH.search(told.stderr), _MAXRSS.search(told.stderr)
    if told.returncode or took is None:
        raise NodeFailed(f"ffmpeg can't decode {path.name}")
    user_s, system_s, seconds = map(float, took.groups())
    peak_mb = int(peak[1]) / 1024 if peak else None
    return _record(film.frames, seconds, user_s + system_s, peak_mb)


def _in_here(work: Callable[[], Any], frames: int) -> Record:
    """Time some work in this process, which has imported what it takes."""
    held_mb = memory_mb(HELD)
    begun_s, spent_s = time.perf_counter(), time.process_time()
    work()
    seconds, cpu_s = time.perf_counter() - begun_s, time.process_time() - spent_s
    return {**_record(frames, seconds, cpu_s, memory_mb(PEAK)), "held_mb": held_mb}


def _record(frames: int, seconds: float, cpu_s: float, peak_mb: float | None) -> Record:
    return {"frames": frames, "seconds": seconds, "cpu_s": cpu_s, "peak_mb": peak_mb}


def _bare(path: Path) -> Callable[[], None]:
    """Return the work of decoding alone."""
    import av

    def work() -> None:
        with av.open(str(path)) as container:
            stream = container.streams.video[0]
            stream.thread_type = "AUTO"
            for _ in container.decode(stream):
                pass

    return work


def _one_process(path: Path) -> Callable[[], Any]:
    """Return the work on a film from opening it on: libraries and the reference are there by then.

    They take a quarter of a second, which a film of minutes makes seem slow by some per cent.
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
    """Run a graph: timed from the first blocks of rows to the last mark of an end."""
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
    """Play a film at its own speed: how long after a frame is each thing heard that is made of it.

    Of a block of rows, and of an estimate, it is counted from the first frame of the newest block
    that is in it.
    """
    with tempfile.TemporaryDirectory(prefix="rsenf-bench-") as folder:
        ran = run_split(Split(threads=1, pace=True), path, Path(folder))
    return {"latency_s": latencies_s(ran), "lost": ran.lost}


def latencies_s(ran: Ran) -> dict[str, list[float]]:
    """Return the latencies of what was heard, by topic."""
    out: dict[str, list[float]] = {}
    for h in ran.heard:
        if not h.header.is_end:
            out.setdefault(h.topic, []).append((h.at_ns - h.header.arrival_time_ns) / 1e9)
    return out


def _copies(film: Film) -> Record:
    """Copy planes one after the other: what memory allows."""
    planes = _planes(film)
    to = np.empty_like(planes[0])

    def work() -> None:
        for number in range(OF_PLANES):
            np.copyto(to, planes[number % PLANES])

    work()  # the memory is touched for the first time
    return _in_here(work, OF_PLANES)


def _row_means(film: Film) -> Record:
    """Sample the same planes as frames."""
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
    """Return planes of noise, more of them than a cache holds."""
    width, height = SIZES[film.size]
    plane = np.random.default_rng(film.seed).integers(90, 130, (height, width), np.uint8)
    return [np.roll(plane, number) for number in range(PLANES)]


VERSION = 2
RESULTS, FILMS = "pipeline.jsonl", "films"
LIVE_FRAMES = 900


@dataclass(frozen=True)
class Turn:
    """One turn of one of them."""

    contestant: str
    film: Film
    number: int

    @property
    def key(self) -> str:
        """Unique name, by which its record is found."""
        return f"{self.film.name} {self.contestant} {self.number} v{VERSION}"


def turns(films: Sequence[Film], rounds: int) -> list[Turn]:
    """Return all turns of some films: in each round everybody has one, so that load hits all."""
    out = []
    for film in films:
        again = [Turn(name, film, n) for n in range(rounds) for name in contestants()]
        once = Film(film.size, film.codec, LIVE_FRAMES, film.filmed, film.seed)
        out += [*again, Turn(LIVE, once, 0)]
    return out


def measure_turns(
    all_turns: Sequence[Turn], folder: Path, progress: Callable[[str, int, int], None]
) -> list[Record]:
    """Time what has no record yet; films are made as they are needed.

    Parameters
    ----------
    all_turns : sequence of Turn
    folder : Path
        Where films and results are kept.
    progress : callable
        Told what comes next, and how many are done of how many.
    """
    films = folder / FILMS

    def prepare(done: int, turn: Turn) -> None:
        progress(turn.key, done, len(all_turns))
        made(turn.film, films)

    return measure_in_turn(all_turns, partial(taken, films=films), folder / RESULTS, prepare)


def taken(turn: Turn, films: Path) -> Record:
    """Take a turn."""
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

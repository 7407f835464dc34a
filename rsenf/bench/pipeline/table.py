"""What is timed over a film, in turns: a bare decoder, rsenf in one process, and rsenf as a graph.

Each turn runs in a new process. At the end: tables of throughput, processor time, memory and
latency.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from itertools import product
from operator import itemgetter
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from rsenf.batch.journal import Record
from rsenf.bench import harness, pipeline
from rsenf.bench.harness import most_of_others
from rsenf.bench.statistics import Row, grouped
from rsenf.bench.tables import Column, table_of, titled
from rsenf.errors import NodeFailed

FFMPEG, PYAV, ONE, LIVE = "ffmpeg", "PyAV", "one process", "live"
SPLITS = {
    "fused": pipeline.Split(record=False),
    "fused, recorded": pipeline.Split(),
    "apart": pipeline.Split(frames="ring", record=False),
    "apart, recorded": pipeline.Split(frames="ring"),
}
RESULTS = "pipeline.jsonl"
# Blocks in one batch arrive at nearly the same time; the next batch after as much video.
AT_ONCE_NS = 10_000_000
LIVE_FRAMES = 900
BAR = 40  # length of the bar of a whole frame's time
FRAMES = {"480p": 6000, "720p": 3600, "1080p": 1800, "2160p": 600}  # some seconds of decoding
_BENCH = re.compile(r"bench: utime=([\d.]+)s stime=([\d.]+)s rtime=([\d.]+)s")
_MAXRSS = re.compile(r"maxrss=(\d+)ki?B", re.IGNORECASE)
_NOTE = """\
Frames a second and seconds of processor time per 1000 frames, medians; ÷ decoder: over {decoder} of
the same round, median of the rounds. Rounds in which other programs took more than a tenth of the
machine from either don't count where there are others. fused: rows taken where frames are decoded;
apart: in a process of their own, frames in shared memory; both with estimates, idle period and
verdicts of liveness, and recorded with the video or not. Processes are counted from when they are
ready; peak MB is the sum of their largest proportional set sizes, looked at every 5 s."""
_LATE_NOTE = """\
The film at its own speed, recorded: from a frame's arrival until what is made of it is heard by
another process; of a block, and of an estimate, from the first of the newest 8 frames in it, which
take 233 ms to come."""


def _time_it(contestant: str, film: pipeline.Film, path: Path) -> Record:
    """Time a contestant: ``frames``, ``seconds``, ``cpu_s`` and ``peak_mb``; of a graph by node."""
    if contestant in SPLITS:
        return _graph(SPLITS[contestant], film, path)
    if contestant == LIVE:
        return _latency(path)
    if contestant == FFMPEG:
        return _ffmpeg(film, path)
    work = _bare(path) if contestant == PYAV else _one_process(path)
    begun_s, spent_s = time.perf_counter(), time.process_time()
    work()
    seconds, cpu_s = time.perf_counter() - begun_s, time.process_time() - spent_s
    peak_mb = harness.memory_mb(harness.PEAK)
    return {"frames": film.frames, "seconds": seconds, "cpu_s": cpu_s, "peak_mb": peak_mb}


def _ffmpeg(film: pipeline.Film, path: Path) -> Record:
    """Decode with ffmpeg; times by its own benchmark, without its start."""
    words = ["ffmpeg", "-nostdin", "-hide_banner", "-benchmark", "-i", str(path), "-map", "0:v:0",
             "-f", "null", "-"]  # fmt: skip
    ended = subprocess.run(words, capture_output=True, text=True, check=False)
    took, peak = _BENCH.search(ended.stderr), _MAXRSS.search(ended.stderr)
    if ended.returncode or took is None:
        raise NodeFailed(f"ffmpeg can't decode {path.name}")
    user_s, system_s, seconds = map(float, took.groups())
    peak_mb, cpu_s = int(peak[1]) / 1024 if peak else None, user_s + system_s
    return {"frames": film.frames, "seconds": seconds, "cpu_s": cpu_s, "peak_mb": peak_mb}


def _bare(path: Path) -> Callable[[], None]:
    """Return a function that only decodes."""
    import av

    def work() -> None:
        with av.open(str(path)) as container:
            container.streams.video[0].thread_type = "AUTO"
            for _ in container.decode(video=0):
                pass

    return work


def _one_process(path: Path) -> Callable[[], Any]:
    """Return a function that analyses a film; libraries and the reference are loaded before."""
    # Not at the top, since the memory of a bare decoder is measured, too.
    import rsenf.decode.file  # noqa: F401 - FFmpeg
    from rsenf.idle import IdleSettings
    from rsenf.live import Live
    from rsenf.live.settings import LiveSettings
    from rsenf.reference import open_reference, reference_blocks
    from rsenf.rows.settings import RowsSettings
    from rsenf.run.inline import analyse
    from rsenf.run.inputs import open_input_file
    from rsenf.track import TrackSettings

    reference = open_reference(str(pipeline.reference_of(path)), timezone="UTC")
    blocks = list(reference_blocks(reference, source="reference/mains", run_id=""))
    return lambda: analyse(
        open_input_file(path),
        rows=RowsSettings(),
        track=TrackSettings(),
        idle=IdleSettings(),
        make_live=lambda: Live(LiveSettings(), start_utc_ns=reference.t0_ns),
        reference=blocks,
    )


def _graph(split: pipeline.Split, film: pipeline.Film, path: Path) -> Record:
    """Time a graph, from the first batch of rows to the end of the last node."""
    ran = pipeline.run_split(split, path)
    # The last block of the first batch: all frames up to it are done.
    rows = ran.rows
    first = [h for h in rows if h.at_ns - rows[0].at_ns <= AT_ONCE_NS][-1]
    before, ended_ns = first.header.frame_last + 1, max(h.time_ns for h in ran.last.values())
    cpu_s = {node: s * (1 - before / film.frames) for node, s in ran.cpu_s.items()}
    return {
        "frames": film.frames - before,
        "seconds": (ended_ns - first.at_ns) / 1e9,
        "cpu_s": sum(cpu_s.values()),
        "peak_mb": sum(ran.peak_mb.values()),
        "node_cpu_s": cpu_s,
        "node_peak_mb": ran.peak_mb,
        "lost": ran.lost,
    }


def _latency(path: Path) -> Record:
    """Play a film in real time; return the latency of rows and estimates."""
    ran = pipeline.run_split(pipeline.Split(threads=1, pace=True), path)
    out: dict[str, list[float]] = {}
    for h in ran.heard:
        if not h.header.is_end:
            out.setdefault(h.topic, []).append((h.at_ns - h.header.arrival_time_ns) / 1e9)
    return {"latency_s": out, "lost": ran.lost}


Turn = tuple[pipeline.Film, str, int]  # film, contestant and round


def _turns(films: Sequence[pipeline.Film], rounds: int) -> dict[str, Turn]:
    """Return all turns: in a round each contestant has one, so that load affects all alike."""
    beside, out = (FFMPEG,) if shutil.which("ffmpeg") else (), list[Turn]()
    for film in films:
        every = product(range(rounds), (*beside, PYAV, ONE, *SPLITS))
        out += [(film, name, number) for number, name in every]
        out.append((replace(film, frames=LIVE_FRAMES), LIVE, 0))
    return {f"{turn[0].name} {turn[1]} {turn[2]} v{pipeline.VERSION}": turn for turn in out}


def _taken(film: pipeline.Film, contestant: str, number: int, films: Path) -> Record:
    path, others = pipeline.made(film, films), harness.watch_others()
    timed = _time_it(contestant, film, path)
    turned = {"contestant": contestant, "number": number}
    return turned | pipeline.film_facts(film, others) | timed


def _tabulated(records: Sequence[Record]) -> Row:
    timed = [r for r in records if r["contestant"] != LIVE]
    late = [r for r in records if r["contestant"] == LIVE]
    decoder = FFMPEG if any(r["contestant"] == FFMPEG for r in timed) else PYAV
    rows = [row for _, group in grouped(timed, "size", "codec") for row in _rows(group, decoder)]
    return {
        "table": "pipeline",
        "decoder": decoder,
        "rounds": max((r["number"] + 1 for r in timed), default=0),
        "cores": sorted({r["cores"] for r in records}),
        "others_ratio": most_of_others([*rows, *late]),
        "versions": sorted({r["rsenf"] for r in records}),
        "rows": rows,
        "latency": [row for r in late for row in _late(r)],
    }


def _rows(group: Sequence[Record], decoder: str) -> Iterable[Row]:
    by_name: dict[str, dict[int, Record]] = {}
    for record in group:
        by_name.setdefault(record["contestant"], {})[record["number"]] = record
    beside = by_name[decoder]
    for name, rounds in by_name.items():
        every = [(r, beside[n]) for n, r in rounds.items() if n in beside]
        # Only the share of other programs decides, not the measured times.
        pairs = [p for p in every if (most_of_others(p) or 0.0) <= harness.BUSY_RATIO] or every
        counted = [r for r, _ in pairs]
        yield {
            **{field: group[0][field] for field in ("size", "codec", "bitrate_bps")},
            "contestant": name,
            "rounds": len(counted),
            "disturbed": len(rounds) - len(counted),
            "others_ratio": most_of_others([r for pair in pairs for r in pair]),
            "frames_per_s": median(map(_rate, counted)),
            "cpu_s_per_1000": median(map(_cost, counted)),
            "rate_ratio": median(_rate(r) / _rate(other) for r, other in pairs),
            "cpu_ratio": median(_cost(r) / _cost(other) for r, other in pairs),
            "peak_mb": max((r["peak_mb"] for r in rounds.values() if r["peak_mb"]), default=None),
            "lost": sum(r["lost"] for r in rounds.values()) if name in SPLITS else None,
            "node_cpu_s_per_1000": {
                node: median(1000.0 * r["node_cpu_s"][node] / r["frames"] for r in counted)
                for node in counted[0].get("node_cpu_s", ())
            },
        }


def _rate(record: Record) -> float:
    return float(record["frames"] / record["seconds"])


def _cost(record: Record) -> float:
    return float(1000.0 * record["cpu_s"] / record["frames"])


def _late(record: Record) -> Iterable[Row]:
    for topic, latencies_s in record["latency_s"].items():
        p50, p99 = np.percentile(latencies_s, [50, 99])
        yield {
            **{field: record[field] for field in ("size", "codec", "lost")},
            "topic": topic, "heard": len(latencies_s), "p50_s": float(p50), "p99_s": float(p99),
        }  # fmt: skip


def _text(document: Row, *, on_page: bool = False) -> str:
    cores = ", ".join(map(str, document["cores"]))
    missing = "" if document["decoder"] == FFMPEG else "; ffmpeg isn't here: compared with PyAV"
    basis = f"medians of {document['rounds']} rounds on {cores} cores{missing}"
    basis += harness.others_said(document)
    notes = [_NOTE.format(decoder=document["decoder"]), _LATE_NOTE, basis]
    tables = (
        table_of("Frame rate and processor time", _COLUMNS, document["rows"]),
        table_of("Latency", _LATE_COLUMNS, document["latency"]),
    )
    profile = _profile(document["rows"])
    shown = [f"```\n{profile}\n```" if on_page else profile] if profile else []
    return titled(tables, [*shown, *([basis] if on_page else notes)], on_page=on_page)


def _profile(rows: Iterable[Row]) -> str:
    """Draw what each node takes of a frame's processor time; empty where no graph ran."""
    lines: list[str] = []
    for row in (row for row in rows if any(row["node_cpu_s_per_1000"].values())):
        ms, name = row["node_cpu_s_per_1000"], row["contestant"]
        whole_ms = sum(ms.values())
        lines.append(f"{row['size']} {row['codec']}, {name}: {whole_ms:.1f} ms of CPU a frame")
        for node, of_ms in sorted(ms.items(), key=itemgetter(1), reverse=True):
            bar = "█" * round(BAR * of_ms / whole_ms)
            lines.append(f"  {node:>12} {of_ms:6.2f} {bar}".rstrip())
    return "\n".join(lines)


_COLUMNS: tuple[Column, ...] = (
    pipeline.FILM, pipeline.BITRATE, ("what", "contestant"),
    ("rounds", lambda r: f"{r['rounds']} of {r['rounds'] + r['disturbed']}"),
    ("frames/s", "frames_per_s", ".0f"), ("÷ decoder", "rate_ratio", ".2f"),
    ("CPU s per 1000", "cpu_s_per_1000", ".2f"), ("÷ decoder", "cpu_ratio", ".2f"),
    ("peak MB", "peak_mb", ".0f"),
    ("lost", lambda r: "" if r["lost"] is None else str(r["lost"])),
)  # fmt: skip
_LATE_COLUMNS: tuple[Column, ...] = (
    pipeline.FILM, ("of", "topic"), ("heard", "heard"),
    ("p50", "p50_s", ".0f ms"), ("p99", "p99_s", ".0f ms"), ("lost", "lost"),
)  # fmt: skip


def measure(run: harness.BenchRun) -> harness.Made:
    """Measure the turns that are missing."""
    options = run.options
    frames, sizes, codecs = FRAMES, list(pipeline.SIZES), list(pipeline.CODECS)
    if options.quick:
        frames, sizes, codecs = dict.fromkeys(pipeline.SIZES, 300), ["480p"], codecs[:1]
    elif options.duration_s:
        frames = dict.fromkeys(pipeline.SIZES, round(30 * options.duration_s))
    if not (options.table_only or shutil.which("ffmpeg")):
        run.note("there is no ffmpeg on this machine: everything is compared with PyAV's decoder")
    rounds = options.repeat or (1 if options.quick else 5)
    every = _turns(pipeline.films_of(run, sizes, codecs, frames), rounds)
    films = run.folder / pipeline.FILMS
    work = partial(_taken, films=films)
    records = run.in_turn(every, work, RESULTS, lambda film, *_: pipeline.made(film, films))
    return harness.Made(_tabulated(records), _text)

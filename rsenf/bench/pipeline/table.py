"""Tables of throughput, processor time, memory and latency of the contestants."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import partial
from statistics import median

import numpy as np

from rsenf.batch.journal import Record
from rsenf.bench.harness import Made, Run, measure_in_turn, most_of_others, others_said, undisturbed
from rsenf.bench.pipeline import CODECS, SIZES, films_of, made, shown_film
from rsenf.bench.pipeline.contestants import (
    COPY,
    FFMPEG,
    FILMS,
    LIVE,
    MEANS,
    ONE,
    PYAV,
    RESULTS,
    SPLITS,
    Turn,
    has_ffmpeg,
    taken,
    turns,
)
from rsenf.bench.tables import Column, Row, grouped, table_of, titled

# Least frame rate relative to the decoder's, of 720p and 1080p in H.264.
MARKS = {ONE: 0.95, "fused, recorded": 0.9, "apart, recorded": 0.75}
MARKED = ("720p", "1080p")
_NOTE = """\
Frames a second and seconds of processor time per 1000 frames, medians; ÷ decoder: over {decoder} of
the same round, median of the rounds. Rounds in which other programs took more than a tenth of the
machine from either don't count where there are others. fused: rows taken where frames are decoded;
apart: in a process of their own, frames in shared memory; both with estimates, idle period and
verdicts of liveness, and recorded with the video or not. Processes are counted from when they are
ready; peak MB is the sum over all of them. copy of the plane, row means: the same planes of luma
copied, and sampled with the mask of what is steady; ÷ decoder there: over the copy."""
_LATE_NOTE = """\
The film at its own speed, recorded: from a frame's arrival until what is made of it is heard by
another process; of a block, and of an estimate, from the first of the newest 8 frames in it, which
take 233 ms to come."""


def tabulated(records: Sequence[Record]) -> Row:
    """Return the tables as plain values."""
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
    """Yield the rows of one film."""
    by_name: dict[str, dict[int, Record]] = {}
    for record in group:
        by_name.setdefault(record["contestant"], {})[record["number"]] = record
    for name, rounds in by_name.items():
        beside = by_name[COPY if name in (COPY, MEANS) else decoder]
        pairs = undisturbed([(r, beside[n]) for n, r in rounds.items() if n in beside])
        counted = [r for r, _ in pairs]
        first = next(iter(rounds.values()))
        marked = first["size"] in MARKED and first["codec"] == "h264"
        yield {
            "size": first["size"],
            "codec": first["codec"],
            "bitrate_bps": first["bitrate_bps"],
            "contestant": name,
            "rounds": len(counted),
            "disturbed": len(rounds) - len(counted),
            "others_ratio": most_of_others([r for pair in pairs for r in pair]),
            "frames_per_s": median(map(_rate, counted)),
            "cpu_s_per_1000": median(map(_cost, counted)),
            "rate_ratio": median(_rate(r) / _rate(other) for r, other in pairs),
            "cpu_ratio": median(_cost(r) / _cost(other) for r, other in pairs),
            "mark": MARKS.get(name) if marked else None,
            "peak_mb": _most(r["peak_mb"] for r in rounds.values()),
            "lost": sum(r["lost"] for r in rounds.values()) if name in SPLITS else None,
            "node_cpu_s_per_1000": _by_node(rounds.values(), "node_cpu_s"),
            "node_peak_mb": _by_node(rounds.values(), "node_peak_mb"),
        }


def _rate(record: Record) -> float:
    return float(record["frames"] / record["seconds"])


def _cost(record: Record) -> float:
    return float(1000.0 * record["cpu_s"] / record["frames"])


def _most(values: Iterable[float | None]) -> float | None:
    return max((v for v in values if v is not None), default=None)


def _by_node(records: Iterable[Record], what: str) -> dict[str, float]:
    """Return the median of each node; seconds are per 1000 frames."""
    found: dict[str, list[float]] = {}
    for record in records:
        scale = 1000.0 / record["frames"] if what.endswith("_s") else 1.0
        for node, value in record.get(what, {}).items():
            found.setdefault(node, []).append(scale * value)
    return {node: median(values) for node, values in found.items()}


def _late(record: Record) -> Iterable[Row]:
    for topic, latencies_s in record["latency_s"].items():
        p50, p99 = np.percentile(latencies_s, [50, 99])
        yield {
            "size": record["size"],
            "codec": record["codec"],
            "topic": topic,
            "heard": len(latencies_s),
            "p50_s": float(p50),
            "p99_s": float(p99),
            "lost": record["lost"],
        }


def text(document: Row, *, on_page: bool = False) -> str:
    """Return the tables for a terminal, or in Markdown."""
    made = _made_from(document)
    notes = [_NOTE.format(decoder=document["decoder"]), _LATE_NOTE, made]
    tables = (
        table_of("Frame rate and processor time", _COLUMNS, document["rows"]),
        table_of("Latency", _LATE_COLUMNS, document["latency"]),
    )
    return titled(tables, [made] if on_page else notes, on_page=on_page)


def _made_from(document: Row) -> str:
    cores = ", ".join(map(str, document["cores"]))
    missing = "" if document["decoder"] == FFMPEG else "; ffmpeg isn't here: compared with PyAV"
    return (
        f"medians of {document['rounds']} rounds on {cores} cores{missing}{others_said(document)}"
    )


def _mark(row: Row) -> str:
    """Return a limit, and whether the frame rate is within it."""
    if row["mark"] is None:
        return ""
    held = "yes" if row["rate_ratio"] >= row["mark"] else "no"
    return f"{row['mark']:g} {'not told' if others_said(row) else held}"


_COLUMNS: tuple[Column, ...] = (
    ("film", shown_film), ("Mb/s", lambda r: f"{r['bitrate_bps'] / 1e6:g}"),
    ("what", "contestant"),
    ("rounds", lambda r: f"{r['rounds']} of {r['rounds'] + r['disturbed']}"),
    ("frames/s", "frames_per_s", ".0f"), ("÷ decoder", "rate_ratio", ".2f"), ("mark", _mark),
    ("CPU s per 1000", "cpu_s_per_1000", ".2f"), ("÷ decoder", "cpu_ratio", ".2f"),
    ("peak MB", "peak_mb", ".0f"),
    ("lost", lambda r: "" if r["lost"] is None else str(r["lost"])),
)  # fmt: skip
_LATE_COLUMNS: tuple[Column, ...] = (
    ("film", shown_film), ("of", "topic"), ("heard", "heard"),
    ("p50", lambda r: f"{1e3 * r['p50_s']:.0f} ms"),
    ("p99", lambda r: f"{1e3 * r['p99_s']:.0f} ms"), ("lost", "lost"),
)  # fmt: skip


FRAMES = {"480p": 6000, "720p": 3600, "1080p": 1800, "2160p": 600}  # some seconds of decoding


def measure(run: Run) -> Made:
    """Measure the turns that are missing."""
    options = run.options
    frames, sizes, codecs = FRAMES, list(SIZES), list(CODECS)
    if options.quick:
        frames, sizes, codecs = dict.fromkeys(SIZES, 300), ["480p"], codecs[:1]
    elif options.duration_s:
        frames = dict.fromkeys(SIZES, round(30 * options.duration_s))
    records = run.kept(RESULTS)
    if records is None:
        if not has_ffmpeg():
            run.note(
                "there is no ffmpeg on this machine: everything is compared with PyAV's decoder"
            )
        rounds = options.repeat or (1 if options.quick else 5)
        every, films = turns(films_of(run, sizes, codecs, frames), rounds), run.folder / FILMS

        def prepare(done: int, turn: Turn) -> None:
            run.say(f"{done + 1}/{len(every)}: {turn.key}")
            made(turn.film, films)

        work = partial(taken, films=films)
        records = measure_in_turn(every, work, run.folder / RESULTS, prepare)
    return Made(tabulated(records), text)

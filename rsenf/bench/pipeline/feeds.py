"""The number of live feeds that a machine carries: feeds are added until one falls behind."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from itertools import chain, count
from pathlib import Path
from statistics import median
from typing import Any

from rsenf.batch.journal import Record
from rsenf.bench import harness, pipeline
from rsenf.bench.statistics import grouped
from rsenf.bench.tables import Column, table_of, titled
from rsenf.decode.source import Effort

RESULTS = "feeds.jsonl"
FIRST = {"480p": 20, "720p": 12, "1080p": 8, "2160p": 1}  # feeds that are added one by one
# A feed that is so far behind in the last quarter of the film isn't carried.
BEHIND_S = 0.5
TRIES = 3  # repeats of a number that isn't carried while other programs are busy
_NOTE = """\
Feeds that play the same film at its own speed, each decoded and sampled in a process of one thread,
with estimates, idle periods, verdicts of liveness and one recording of everything, video included.
processor: share of all cores; latest: how far the feed that is furthest behind its own speed was in
the last quarter; lost: messages dropped, missed or refused; carried: nothing lost, and none of the
feeds more than half a second behind; MB: proportional set sizes, a feed more: its decoder's."""


def _counts(first: int) -> Iterator[int]:
    """Yield the numbers of feeds to try: in steps of two, from ``first`` on of one.

    >>> from itertools import islice
    >>> list(islice(_counts(5), 5))
    [1, 2, 4, 5, 6]
    """
    yield from (n for n in (1, *range(2, first, 2)) if n < first)
    yield from count(first)


def _measure_feeds(
    run: harness.BenchRun, film: pipeline.Film, first: int, effort: Effort = "full"
) -> list[Record]:
    """Add feeds until one falls behind for another reason than other programs."""
    films, records = run.folder / pipeline.FILMS, []
    work = partial(_carried, films=films)
    fast = "fast " if effort == "fast" else ""
    for feeds in _counts(first):
        for number in range(TRIES):
            key = f"{film.name} {fast}x{feeds} {number} v{pipeline.VERSION}"
            many = {key: (film, feeds, effort)}
            (record,) = run.in_turn(many, work, RESULTS, lambda of, *_: pipeline.made(of, films))
            if record["carried"] or not harness.others_said(record):
                break
        records.append(record)
        if not record["carried"]:
            break
    return records


def _carried(film: pipeline.Film, feeds: int, effort: Effort, films: Path) -> Record:
    """Run some feeds of a film; return whether all were carried, and what they cost."""
    split = pipeline.Split(cameras=feeds, threads=1, pace=True, effort=effort)
    path, others = pipeline.made(film, films), harness.watch_others()
    ran = pipeline.run_split(split, path)
    cameras = {heard.source for heard in ran.rows}
    late = [_lateness_s([h for h in ran.rows if h.source == camera]) for camera in cameras]
    last = [sorted(of[-len(of) // 4 :]) for of in late]
    p50_s = max(median(of) for of in last)
    return {
        **pipeline.film_facts(film, others),
        "feeds": feeds,
        "effort": effort,
        "seconds": film.frames / float(pipeline.FRAME_RATE),
        "node_cpu_s": ran.cpu_s,
        "cpu_s": sum(ran.cpu_s.values()),
        "node_peak_mb": ran.peak_mb,
        "late_p50_s": p50_s,
        "late_p99_s": max(of[min(int(0.99 * len(of)), len(of) - 1)] for of in last),
        "lost": ran.lost,
        "carried": not ran.lost and len(late) == feeds and p50_s < BEHIND_S,
    }


def _lateness_s(blocks: list[pipeline.Heard]) -> list[float]:
    """Return the delay of each block against real time, s, relative to the smallest one."""
    ahead_ns = [heard.at_ns - heard.header.pts_ns for heard in blocks]
    soonest_ns = min(ahead_ns)
    return [(ns - soonest_ns) / 1e9 for ns in ahead_ns]


def _tabulated(records: list[Record]) -> dict[str, Any]:
    rows = []
    for record in records:
        cpu_s, of_node_mb = record["cpu_s"] / record["seconds"], record["node_peak_mb"]
        rows.append({
            "effort": "full",  # of records made before there was another
            **record,
            "processor_ratio": cpu_s / record["cores"],
            "cpu_ms_per_frame": 1e3 * cpu_s / record["feeds"] / float(pipeline.FRAME_RATE),
            "peak_mb": sum(of_node_mb.values()),
            "mb_a_feed": median(mb for name, mb in of_node_mb.items() if "decode-" in name),
        })  # fmt: skip
    return {
        "table": "feeds",
        "others_ratio": harness.most_of_others(records),
        "carried": [
            film | {"feeds": [0, *(row["feeds"] for row in of if row["carried"])][-1]}
            for film, of in grouped(rows, "size", "codec", "effort")
        ],
        "rows": rows,
    }


def _text(document: dict[str, Any], *, on_page: bool = False) -> str:
    summary = [
        f"{c['feeds']} feeds of {c['size']} are carried with effort {c['effort']}"
        for c in document["carried"]
    ]
    cores = ", ".join(map(str, sorted({row["cores"] for row in document["rows"]})))
    made = f"{'; '.join(summary)}; {cores} cores{harness.others_said(document)}"
    table = table_of("Feeds at 30 frames/s", _COLUMNS, document["rows"])
    return titled([table], [made] if on_page else [_NOTE, made], on_page=on_page)


_COLUMNS: tuple[Column, ...] = (
    pipeline.FILM, pipeline.BITRATE, ("effort", "effort"), ("feeds", "feeds"),
    ("processor", "processor_ratio", ".0%"), ("ms a frame", "cpu_ms_per_frame", ".2f"),
    ("latest p50", "late_p50_s", ".0f ms"), ("latest p99", "late_p99_s", ".0f ms"),
    ("lost", "lost"), ("peak MB", "peak_mb", ".0f"), ("a feed more", "mb_a_feed", ".0f"),
    ("carried", lambda r: "yes" if r["carried"] else "no"),
)  # fmt: skip


def measure(run: harness.BenchRun) -> harness.Made:
    """Add feeds of each film until one falls behind."""
    options, records = run.options, run.kept(RESULTS)
    if records is None:
        frames = round(30 * (options.duration_s or (10.0 if options.quick else 60.0)))
        effort: Effort = "fast" if options.fast else "full"
        films = pipeline.films_of(run, ["1080p"], ["h264"], dict.fromkeys(pipeline.SIZES, frames))
        every = (_measure_feeds(run, f, options.feeds or FIRST[f.size], effort) for f in films)
        records = list(chain.from_iterable(every))
    return harness.Made(_tabulated(records), _text)

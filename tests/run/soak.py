"""Hours of a camera's rows through the real processes, faster than real time: does anything grow?

By hand: ``python -m tests.run.soak --hours 8``. The rows of a lamp on a wandering grid are written
to a recording, which a graph plays as fast as its nodes take it: track, idle, match, live, and an
archive that begins new files and deletes the oldest. Every few seconds it is noted what each
process holds; at the end, whether every message sent was taken, dropped or missed by whoever reads
it, by count, and whether the numbers in the archive go on to the last. The exit code is 1 when
something grows, or isn't accounted for.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import shutil
import sys
import tempfile
import threading
import time
import urllib.request
from collections import defaultdict
from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from rsenf.bus.keys import node_of
from rsenf.config import load_graph
from rsenf.errors import RsenfError
from rsenf.messages import Header, Mark, RowBlock
from rsenf.model import GridPath, synthetic_grid
from rsenf.record.archive.layout import archived_files
from rsenf.record.reader import open_recording
from rsenf.record.writer import Recorder
from rsenf.rows.stage import blocks_from_luminance
from rsenf.run.graph_run import GraphRun
from rsenf.run.metrics import serving_metrics
from rsenf.run.restart_policy import NodeState
from rsenf.run.supervisor import check_ended, start_graph

RATE_HZ, ROWS, BLOCK = 30, 48, 8
AT_ONCE_S = 600  # of feed, that is made at once
T0_NS = 1_767_225_600_000_000_000
ARCHIVE_MB = 40.0  # that the archive may take
KEEPS_H = 1.0  # of feed, in the stages with a memory
GRAPH = """\
version: 1
site: soak
nodes:
  play:  {{kind: replay, input: "{folder}/rows.mcap", topics: [cam/rows], rate: 0}}
  grid:  {{kind: reference, grid: ce, input: "{folder}/grid.csv"}}
  track: {{kind: track, cameras: [cam], track: {{nominal_hz: 50}}}}
  idle:  {{kind: idle, cameras: [cam]}}
  match: {{kind: match, cameras: [cam], grid: ce, interim_every_s: 1800,
           keep_hours: {keeps_h}}}
  live:  {{kind: live, cameras: [cam], grid: ce, start: 2026-01-01T00:00:00Z,
           live: {{keep_hours: {keeps_h}}}}}
  record:
    kind: record
    archive: "{folder}/archive"
    rotation: {{size_mb: 5}}
    retention: {{disk_share: {share}}}
"""
# What each node reads, by the nodes that send it. Health words come beside: to the recorder alone.
READS = {
    "track": ("play",),
    "idle": ("play",),
    "match": ("track", "grid"),
    "live": ("play", "track", "idle", "grid"),
    "record": ("play", "grid", "track", "idle", "match", "live"),
}
FATES = ("taken", "dropped", "missed", "rejected")
HELD = ("memory_mb", "files", "threads")
Kept = dict[str, tuple[int, int, int, bool]]
# More than this from the second quarter to the last is growth, of the least that was held in each:
# what is free in a heap comes, and is given back once a minute, in which hours of the feed go by.
MOST_MORE = {"memory_mb": 8.0, "files": 3.0, "threads": 2.0}


def write_feed(folder: Path, hours: float, seed: int) -> None:
    """Write the rows of some hours as a recording, and the grid's table beside it."""
    total_s = round(3600 * hours)
    grid = synthetic_grid(seed, total_s + 60.0)
    write_grid(folder / "grid.csv", grid, total_s + 30)
    key, last = "rsenf/soak/cam/rows", Header()
    with Recorder(folder / "rows.mcap", run_info={"run_id": "soak"}, clock_ns=time.time_ns) as out:
        for block in _rows(grid, total_s, seed):
            last = block.header
            out.write(key, block)
        out.write(key, RowBlock(header=last.numbered(last.seq + 1, Mark.END)))


def write_grid(path: Path, grid: GridPath, seconds: int, skip_s: int = 0) -> None:
    """Write the means of a grid's seconds as a table that begins with the year."""
    whole = np.diff(grid.cycles(np.arange(skip_s, skip_s + seconds + 1.0)))
    begin = datetime(2026, 1, 1)
    lines = [f"{begin + timedelta(seconds=k)},{hz:.6f}" for k, hz in enumerate(whole)]
    path.write_text("\n".join(["time,frequency", *lines, ""]))


def _rows(grid: GridPath, total_s: int, seed: int) -> Any:
    rng, within = np.random.default_rng(seed), np.arange(ROWS) / ROWS * 0.8 / RATE_HZ
    per_part = AT_ONCE_S * RATE_HZ
    for first in range(0, total_s * RATE_HZ, per_part):
        frame = np.arange(first, min(first + per_part, total_s * RATE_HZ))
        t_s = frame[:, None] / RATE_HZ + within
        # Two harmonics, as of a lamp on a bridge rectifier.
        turn = 4 * np.pi * grid.cycles(t_s)
        level = 120 + 20 * np.cos(turn) + 4 * np.cos(2 * turn + 1) + rng.normal(0, 1.5, t_s.shape)
        header = Header(run_id="soak", source="soak/cam", arrival_time_ns=T0_NS)
        for block in blocks_from_luminance(
            level[:, :, None].astype(np.float32), frame / RATE_HZ, header, block_frames=BLOCK
        ):
            yield _moved(block, first)


def _moved(block: RowBlock, frames: int) -> RowBlock:
    """Return a block as what comes after so many frames."""
    header = block.header
    header = replace(
        header.numbered(header.seq + frames // BLOCK),
        frame_first=header.frame_first + frames,
        frame_last=header.frame_last + frames,
    )
    return replace(block, header=header, frame_number=block.frame_number + frames)


class Samples:
    """What the processes held, by how many hours of the feed were played."""

    def __init__(self, run: GraphRun, port: int, folder: Path) -> None:
        self.held: dict[str, list[tuple[float, ...]]] = defaultdict(list)
        self._run, self._port, self._folder = run, port, folder
        self.first_words: dict[str, int] = {}

    def note_first_words(self) -> None:
        """Read the first words of health off the archive, before its oldest files are deleted."""
        if len(self.first_words) == len(self._run.nodes):
            return
        with contextlib.suppress(RsenfError):  # a file that has just begun
            for key, (first, *_) in archived(self._folder).items():
                if key.endswith("/health"):
                    self.first_words.setdefault(node_of(key), first)

    def take(self) -> None:
        """Look at every process once; ask for the metrics, as Prometheus would."""
        url = f"http://127.0.0.1:{self._port}/metrics"
        assert b"rsenf_messages" in urllib.request.urlopen(url, timeout=30).read()
        played = self._run.nodes["track"].health
        if played is None or any(not n.was_ready for n in self._run.nodes.values()):
            return
        self.note_first_words()
        at_h = played.messages_in * BLOCK / RATE_HZ / 3600
        pids = {n.name: n.process.pid for n in self._run.running if n.process}
        for name, pid in {**pids, "run": psutil.Process().pid}.items():
            try:
                of = psutil.Process(pid)
                row = of.memory_info().rss / 1e6, float(of.num_fds()), float(of.num_threads())
            except psutil.Error:
                continue
            if not row[0]:  # it has just ended
                continue
            self.held[name].append((at_h, *row))


def growth(held: list[tuple[float, ...]], hours: float) -> dict[str, dict[str, float]]:
    """Start, least of two quarters, and most of what a process held.

    The first quarter fills what is kept.
    """
    table = np.array(held)
    at_h, out = table[:, 0], {}
    second, last = (at_h >= 0.25 * hours) & (at_h < 0.5 * hours), at_h >= 0.75 * hours
    for k, what in enumerate(HELD, 1):
        value = table[:, k]
        middle, end = (value[of].min() if of.any() else np.nan for of in (second, last))
        out[what] = {
            "start": float(value[0]),
            "middle": float(middle),
            "end": float(end),
            "more": float(end - middle),
            "most": float(value.max()),
        }
    return out


def accounts(run: GraphRun, kept: Kept, first: dict[str, int]) -> dict[str, dict[str, int]]:
    """Of each node that reads: what was sent to it, and what became of that.

    ``first`` has the number of each node's first word of health that was recorded: of what a node
    said before the recorder listened, this gets the last.
    """
    said = {n.name: n.health for n in run.nodes.values() if n.health is not None}
    # Words of health that were recorded; of who has ended long ago all were, and are deleted.
    held = {node_of(key): last for key, (_, last, *_) in kept.items() if key.endswith("/health")}
    words = sum(held.get(n, h.header.seq) + 1 - first[n] for n, h in said.items())
    out = {}
    for name, senders in READS.items():
        of = said[name]
        sent = sum(said[sender].messages_out for sender in senders)
        # The recorder takes the words of all nodes beside, and what the supervisor says of them.
        taken = of.messages_in - (words if name == "record" else 0)
        sent += said_of_others(run) if name == "record" else 0
        counts = {"sent": sent, "taken": taken, "dropped": of.dropped, "missed": of.missed}
        counts |= {"rejected": of.rejected}
        counts["unaccounted"] = sent - sum(counts[k] for k in FATES)
        out[name] = counts
    return out


def said_of_others(run: GraphRun) -> int:
    """Words of health that the supervisor has sent in place of nodes that were held up."""
    assert run._announcer is not None
    return sum(p.sent for key, p in run._announcer._publishers.items() if key.endswith("/health"))


def archived(folder: Path) -> Kept:
    """Of each topic still in the archive: first and last number, how many between are missing.

    What this process, the supervisor, has said of a node is left out.
    """
    numbers: dict[str, list[int]] = defaultdict(list)
    ended: dict[str, bool] = defaultdict(bool)
    for file in sorted(archived_files(folder / "archive"), key=lambda f: str(f.path)):
        for key, message, _ in open_recording(file.path).messages():
            if getattr(message, "pid", 0) == os.getpid():
                continue
            numbers[key].append(message.header.seq)
            ended[key] |= message.header.is_end
    return {
        key: (min(seqs), max(seqs), max(seqs) - min(seqs) + 1 - len(set(seqs)), ended[key])
        for key, seqs in sorted(numbers.items())
    }


def run_graph(folder: Path, every_s: float) -> tuple[GraphRun, Samples, int]:
    """Play it all through the processes."""
    share = ARCHIVE_MB * 1e6 / shutil.disk_usage(folder).total
    path = folder / "soak.yaml"
    path.write_text(GRAPH.format(folder=folder, share=share, keeps_h=KEEPS_H))
    done = threading.Event()

    def say(node: NodeState) -> None:
        if node.state != "running":
            print(f"{time.monotonic() - begun:7.1f} s  {node.name}: {node.state} {node.detail}")

    begun = time.monotonic()
    with start_graph(load_graph(path), path, say) as run, serving_metrics(run, "0") as port:
        samples = Samples(run, port, folder)

        def look() -> None:
            while not done.wait(every_s):
                samples.take()

        thread = threading.Thread(target=look)
        thread.start()
        try:
            run.wait(threading.Event())
        finally:
            done.set()
            thread.join()
        samples.note_first_words()
        return run, samples, check_ended(run)


def report(run: GraphRun, samples: Samples, folder: Path, hours: float) -> bool:
    """Print the tables; returns whether nothing grew and nothing is unaccounted for."""
    flat = True
    print(f"{'':8}{'':12}{'start':>9}{'middle':>9}{'end':>9}{'most':>9}")
    found = {name: growth(held, hours) for name, held in samples.held.items() if len(held) > 3}
    for name, of in found.items():
        for what, row in of.items():
            grows = row["more"] > MOST_MORE[what]
            flat &= not grows
            cells = "".join(f"{row[k]:9.1f}" for k in ("start", "middle", "end", "most"))
            print(f"{name:8}{what:12}{cells}{'  GROWS' if grows else ''}")
    kept = archived(folder)
    table = accounts(run, kept, samples.first_words)
    print(f"\n{'':8}{'sent':>9}{''.join(f'{k:>9}' for k in FATES)}{'unaccounted':>13}")
    for name, counts in table.items():
        cells = "".join(f"{counts[k]:9d}" for k in ("sent", *FATES))
        print(f"{name:8}{cells}{counts['unaccounted']:13d}")
        flat &= counts["unaccounted"] == counts["rejected"] == 0
    print("\nin the archive, after the oldest files were deleted:")
    for key, (first, last, missing, ended) in kept.items():
        print(f"{key:32} numbers {first} to {last}, {missing} missing{', ended' if ended else ''}")
        flat &= not missing
    rows = kept.get("rsenf/soak/cam/rows")
    sent = run.nodes["play"].health
    flat &= rows is not None and sent is not None and rows[1] == sent.messages_out - 1
    (folder / "soak.json").write_text(
        json.dumps({"held": samples.held, "growth": found, "accounts": table})
    )
    return flat


def main() -> int:
    """Make the feed, play it, report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hours", type=float, default=8.0, help="of feed (8)")
    parser.add_argument("--out", type=Path, help="folder to keep; a temporary one otherwise")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--every-s", type=float, default=5.0, help="between two samples (5)")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = args.out or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        write_feed(folder, args.hours, args.seed)
        begun = time.monotonic()
        run, samples, code = run_graph(folder, args.every_s)
        took_s = time.monotonic() - begun
        print(f"{args.hours:g} h of feed in {took_s / 60:.1f} min", flush=True)
        for verdict in run.latest["live"].values():
            print(verdict.in_short)
        for result in run.latest["match"].values():
            print(result.decision, result.reason)
        fine = report(run, samples, folder, args.hours)
    print("\nflat, and all accounted for" if fine else "\nNOT FLAT, OR NOT ALL ACCOUNTED FOR")
    return code or int(not fine)


if __name__ == "__main__":
    sys.exit(main())

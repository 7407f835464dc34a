"""The same recording, played from every topic at every speed, in one process and in many.

By hand, for a clip of so many seconds: ``python -m tests.run.replay_graphs 60``. All hashes of a
column must be equal.
"""

from __future__ import annotations

import os
import sys
import tempfile
import threading
import time
from collections import defaultdict
from pathlib import Path

# As `rsenf` and every node do, before NumPy is there: with more threads sums round otherwise.
os.environ["OPENBLAS_NUM_THREADS"] = os.environ["OMP_NUM_THREADS"] = "1"
sys.path.insert(0, str(Path(__file__).parent))

from conftest import Film, made_film
from replay_samples import RESULTS, Streams, hashes, in_one_process, record

from rsenf.config import load_graph
from rsenf.record.reader import open_recording
from rsenf.run.replay.player import Replayed
from rsenf.run.supervisor import check_ended, start_graph

BEGIN = ("frames", "rows", "track")
RATES = (0.0, 1.0, 10.0)
STAGES = {
    "rows": "  rows: {kind: rows, cameras: [cam]}\n",
    "track": "  track: {kind: track, cameras: [cam], track: {nominal_hz: 50}}\n",
}
GRAPH = """\
version: 1
site: lab
nodes:
{made}  grid: {{kind: reference, grid: ce, input: "{reference}"}}
  match: {{kind: match, cameras: [cam], grid: ce}}
  record: {{kind: record, out: "{out}", topics: [cam/track, cam/match], overwrite: true}}
"""


def graph(film: Film, made: str, out: Path) -> Path:
    """Write a graph that ends in a match, with what makes its input."""
    path = out.with_suffix(".yaml")
    path.write_text(GRAPH.format(made=made, reference=film.reference, out=out))
    return path


def from_topic(recording: Path, begin: str, rate: float) -> str:
    """Nodes that play a topic, and make of it what a match needs."""
    play = f"  play: {{kind: replay, input: {recording}, topics: [cam/{begin}], rate: {rate}}}\n"
    return play + "".join(STAGES[stage] for stage in ("rows", "track")[BEGIN.index(begin) :])


def in_many_processes(
    path: Path, out: Path, replayed: dict[str, str]
) -> tuple[dict[str, str], int]:
    """Run a graph; returns a hash of each topic it recorded, and its exit code."""
    with start_graph(load_graph(path, replayed), path) as run:
        run.wait(threading.Event())
        code = check_ended(run)
    streams: Streams = defaultdict(list)
    for key, message, _ in open_recording(out).messages():
        streams[key.split("/")[-1]].append(message)
    return {topic: sha for topic, sha in hashes(streams).items() if topic in RESULTS}, code


def main(seconds: float) -> int:
    """Play everything; returns how many hashes differ from the first."""
    found: list[dict[str, str]] = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        film = made_film(folder, seconds)
        recording, out = record(film, folder / "film.mcap"), folder / "out.mcap"
        for begin in BEGIN:
            for rate in RATES:
                for many in (False, True):
                    begun = time.monotonic()
                    if many:
                        path = graph(film, from_topic(recording, begin, rate), out)
                        sha, _ = in_many_processes(path, out, {})
                    else:
                        sha = in_one_process(
                            Replayed(open_recording(recording), begin=begin, rate=rate), film
                        )
                    found.append({topic: sha[topic] for topic in RESULTS})
                    words = "  ".join(f"{t} {sha[t][:16]}" for t in RESULTS)
                    where = "many processes" if many else "one process"
                    took_s = time.monotonic() - begun
                    print(
                        f"{begin:6} rate {rate:4g} {where:14} {took_s:6.1f} s  {words}", flush=True
                    )
    return sum(sha != found[0] for sha in found)


if __name__ == "__main__":
    sys.exit(main(float(sys.argv[1])))

"""A graph with processes as of ``rsenf run``, and an observer of its messages."""

from __future__ import annotations

import threading
import time
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import yaml

from rsenf.bench.harness import PEAK, memory_mb
from rsenf.bench.pipeline import START, reference_of
from rsenf.bus.inbox import CallbackInbox, Received
from rsenf.bus.keys import LOOKING, source_of, topic_of
from rsenf.bus.zenoh_bus import BusSettings, open_bus
from rsenf.config import load_graph
from rsenf.decode.source import Effort
from rsenf.messages import Header, Health
from rsenf.run.graph_run import GraphRun
from rsenf.run.supervisor import check_ended, start_graph

SITE = "bench"
LOOK_S, NOTICE_S = 0.25, 0.1
HEARD = ("rows", "track")  # rows first
# Blocks in one batch arrive at nearly the same time; the next batch after as much video.
AT_ONCE_NS = 10_000_000


@dataclass(frozen=True)
class Split:
    """How the work on some cameras is split among processes."""

    frames: str = "fused"  # rows by the decoder; ring, tcp: by a process of their own
    record: bool = True  # everything, the video included
    cameras: int = 1  # each with a decoder
    threads: int = 0  # of a decoder; 0 lets FFmpeg choose
    pace: bool = False  # played in real time
    effort: Effort = "full"

    def graph(self, film: Path, out: Path) -> dict[str, object]:
        """Return the graph, with a reference and live verdicts on every camera."""
        names = [f"cam{k}" for k in range(1, self.cameras + 1)]
        shared: dict[str, dict[str, object]] = {
            "track": {"kind": "track", "cameras": names, "idle": {}},
            "mains": {"kind": "reference", "grid": "mains", "input": str(reference_of(film)),
                      "timezone": "UTC"},
            "live": {"kind": "live", "cameras": names, "grid": "mains",
                     "start": f"{START:%Y-%m-%dT%H:%M:%S}Z"},
        }  # fmt: skip
        if self.frames != "fused":
            shared["rows"] = {"kind": "rows", "cameras": names}
        if self.record:
            shared["record"] = {"kind": "record", "out": str(out), "overwrite": True}
        decode = {
            "kind": "decode", "input": str(film), "frames": self.frames, "threads": self.threads,
            "pace": self.pace, "record_video": self.record, "effort": self.effort,
        }  # fmt: skip
        nodes = {f"decode-{name}": {**decode, "camera": name} for name in names}
        return {"version": 1, "site": SITE, "nodes": {**nodes, **shared}}


@dataclass(frozen=True)
class Heard:
    """A received message: time, camera, topic and header."""

    at_ns: int
    source: str
    topic: str
    header: Header


@dataclass
class Ran:
    """A graph that has run: its nodes, and ``run``, which starts them and routes messages."""

    # Rows and estimates, and their ends. Without `pace` only up to the first block of rows, since
    # an observer takes processor time.
    heard: list[Heard] = field(default_factory=list)
    first: dict[str, Health] = field(default_factory=dict)  # when a node was ready
    last: dict[str, Health] = field(default_factory=dict)  # at its end
    peak_mb: dict[str, float] = field(default_factory=dict)
    run_cpu_s: float = 0.0  # while the nodes worked
    exit_code: int = 0

    @property
    def cpu_s(self) -> dict[str, float]:
        """Processor time of each node since it was ready, s."""
        spent = {n: self.last[n].cpu_s - health.cpu_s for n, health in self.first.items()}
        return {**spent, "run": self.run_cpu_s}

    @property
    def begun(self) -> Heard:
        """Last block of rows in the first batch: all frames up to it are done."""
        rows = [h for h in self.heard if h.topic == "rows" and not h.header.is_end]
        return [h for h in rows if h.at_ns - rows[0].at_ns <= AT_ONCE_NS][-1]

    @property
    def lost(self) -> int:
        """Number of messages dropped, missed or rejected by any node."""
        return sum(h.dropped + h.missed + h.rejected for h in self.last.values())


def run_split(split: Split, film: Path) -> Ran:
    """Run a graph over a film to its end; no node may be lost or fail."""
    ran = Ran()
    with ExitStack() as stack:
        folder = Path(stack.enter_context(TemporaryDirectory(prefix="rsenf-bench-")))
        path = folder / "graph.yaml"
        path.write_text(yaml.safe_dump(split.graph(film, folder / "out.mcap")), encoding="utf-8")
        run = stack.enter_context(start_graph(load_graph(path), path))
        ear = stack.enter_context(ExitStack())
        bus = ear.enter_context(open_bus(BusSettings(connect=(run.endpoint,))))
        done = threading.Event()
        drum = CallbackInbox(partial(_hear, ran))
        for topic in HEARD:
            bus.subscribe(drum, f"rsenf/{SITE}/*/{topic}", LOOKING)

        def listen() -> None:
            with ear:
                while not done.wait(NOTICE_S) and (split.pace or not ran.heard):
                    pass

        for work in (listen, lambda: _look(run, ran, done)):
            thread = threading.Thread(target=work)
            thread.start()
            stack.callback(thread.join)
        stack.callback(done.set)
        run.wait(threading.Event())
        ran.exit_code = check_ended(run)
        for name, node in run.nodes.items():
            if node.health:
                ran.last[name] = node.health
    return ran


def _hear(ran: Ran, received: Received) -> None:
    key = received.key
    at_ns, header = time.time_ns(), received.message.header
    ran.heard.append(Heard(at_ns, source_of(key), topic_of(key), header))


def _look(run: GraphRun, ran: Ran, done: threading.Event) -> None:
    begun_s = None
    while not done.wait(LOOK_S):
        for name, node in run.nodes.items():
            if node.health and node.was_ready:
                ran.first.setdefault(name, node.health)
            if node.process:
                ran.peak_mb[name] = memory_mb(PEAK, node.process.pid) or ran.peak_mb.get(name, 0.0)
        if len(ran.first) == len(run.nodes):
            begun_s = begun_s or time.process_time()
            ran.run_cpu_s = time.process_time() - begun_s
        ran.peak_mb["run"] = memory_mb(PEAK) or 0.0

"""Throughput of the pipeline beside a bare decoder, and how many feeds a machine carries.

Here: the videos that are decoded, some seconds rendered by the capture model, and repeated without
re-encoding; and a graph with processes as of ``rsenf run``, with an observer of its messages.
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from fractions import Fraction
from itertools import count, product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import yaml

from rsenf import __version__
from rsenf.bench.harness import SHARE, BenchRun, known_names, memory_mb
from rsenf.bench.tables import Column
from rsenf.bus.inbox import CallbackInbox, Received
from rsenf.bus.keys import LOOKING, source_of, topic_of
from rsenf.bus.zenoh_bus import BusSettings, open_bus
from rsenf.config import load_graph
from rsenf.decode.source import Effort
from rsenf.messages import Header, Health
from rsenf.messages.schema import FloatArray
from rsenf.model import CaptureModel, GridPath, Light, Shutter, render_frames, synthetic_grid
from rsenf.model.video_file import Codec, write_video
from rsenf.run.graph_run import GraphRun
from rsenf.run.supervisor import check_ended, start_graph
from rsenf.whole_file import whole_file

SIZES = {"480p": (854, 480), "720p": (1280, 720), "1080p": (1920, 1080), "2160p": (3840, 2160)}
CODECS = ("h264", "h265")
FRAME_RATE = Fraction(30)
# Usual of network cameras at 30 frames/s; half of it for H.265.
BITRATES_BPS = {"480p": 1_000_000, "720p": 2_000_000, "1080p": 4_000_000, "2160p": 12_000_000}
GOP_FRAMES, FILMED = 60, 300
START = datetime(2026, 1, 1)  # of the first frame, UTC
VERSION, FILMS = 4, "films"  # of records; folder
SITE = "bench"
LOOK_S, NOTICE_S, SIZED_LOOKS = 0.25, 0.1, 20  # every so many looks, at memory, too: it takes ms
HEARD = ("rows", "track")  # rows first


@dataclass(frozen=True)
class Film:
    """A video of some number of frames."""

    size: str  # of SIZES
    codec: str  # of CODECS
    frames: int  # a multiple of those filmed
    filmed: int = FILMED  # whole seconds, so that the flicker continues at a repetition
    seed: int = 0  # of the scene and the noise

    @property
    def name(self) -> str:
        """Unique file name."""
        return f"{self.size}-{self.codec}-{self.frames}-{self.filmed}-{self.seed}.mp4"

    @property
    def once(self) -> str:
        """File name of the rendered part."""
        return f"once-{self.size}-{self.codec}-{self.filmed}-{self.seed}.mp4"

    @property
    def bitrate_bps(self) -> int:
        """Mean bit rate."""
        return BITRATES_BPS[self.size] // (2 if self.codec == "h265" else 1)

    @property
    def freq_hz(self) -> FloatArray:
        """Grid's frequency in each rendered second, Hz; its sum is a whole number of cycles."""
        seconds = round(self.filmed / FRAME_RATE)
        freq_hz = synthetic_grid(self.seed, seconds).freq_hz[:seconds]
        total = float(freq_hz.sum())
        return np.asarray(freq_hz + (round(total) - total) / seconds)


def made(film: Film, folder: Path) -> Path:
    """Return a film's file, created if necessary, with a table of the grid beside it."""
    path, once = folder / film.name, folder / film.once
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        times = film.frames // film.filmed
        lines = (
            f"{START + timedelta(seconds=k):%Y-%m-%d %H:%M:%S},{freq_hz:.6f}"
            for k, freq_hz in enumerate(np.tile(film.freq_hz, times))
        )
        table = "\n".join(["time,frequency", *lines, ""])
        reference_of(path).write_text(table, encoding="utf-8")
        if not once.exists():
            _shoot(film, once)
        _repeat(once, path, times)
    return path


def reference_of(path: Path) -> Path:
    """Return the table of the grid's frequency of a film."""
    return path.with_suffix(".csv")


def _shoot(film: Film, path: Path) -> None:
    width, height = SIZES[film.size]
    model = CaptureModel(
        light=Light(lamp="led"),
        shutter=Shutter(frame_rate=FRAME_RATE, rows=height, columns=width),
        codec=Codec(name=film.codec, bitrate_bps=film.bitrate_bps, gop_frames=GOP_FRAMES),
    )
    freq_hz = film.freq_hz
    grid = GridPath(np.append(freq_hz, freq_hz[:1]))  # the last row is read after the last second
    frames = render_frames(model, grid, float(film.filmed / FRAME_RATE), film.seed)
    write_video(path, frames, model.codec)


def _repeat(once: Path, path: Path, times: int) -> None:
    """Write a video that repeats another one, by copying its packets."""
    import av

    with whole_file(path) as part, av.open(str(once)) as source, av.open(str(part), "w") as out:
        stream = source.streams.video[0]
        copy = out.add_stream_from_template(stream)
        packets = [packet for packet in source.demux(stream) if packet.size]
        length = sum(packet.duration or 0 for packet in packets)
        for offset in range(0, length * times, length):
            for packet in packets:
                again = av.Packet(bytes(packet))
                again.time_base, again.is_keyframe = packet.time_base, packet.is_keyframe
                assert packet.pts is not None
                assert packet.dts is not None
                again.pts, again.dts = packet.pts + offset, packet.dts + offset
                again.duration, again.stream = packet.duration, copy
                out.mux(again)


def film_facts(film: Film, others: Callable[[], float]) -> dict[str, Any]:
    """Return what the records of all turns on a film have, and how busy others were meanwhile."""
    return {
        "version": VERSION, "size": film.size, "codec": film.codec,
        "bitrate_bps": film.bitrate_bps, "others_ratio": others(), "cores": os.cpu_count(),
        "rsenf": __version__,
    }  # fmt: skip


FILM: Column = (
    "film", lambda r: f"{r['size']} {r['codec'].upper().replace('H', 'H.')}",
)  # fmt: skip
BITRATE: Column = ("Mb/s", lambda r: f"{r['bitrate_bps'] / 1e6:g}")


def films_of(
    run: BenchRun, sizes: Sequence[str], codecs: Sequence[str], frames: dict[str, int]
) -> list[Film]:
    """Return the films of the options; sizes and codecs where these name no others.

    Parameters
    ----------
    frames : dict
        Number of frames by size, rounded down to whole repetitions.
    """
    sizes, codecs = run.options.sizes or sizes, run.options.codings or codecs
    known_names(sizes, SIZES, "size")
    known_names(codecs, CODECS, "codec")
    return [
        Film(size, codec, max(frames[size] // FILMED, 1) * FILMED, seed=run.options.seed)
        for size, codec in product(sizes, codecs)
    ]


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
        of_split = {name: getattr(self, name) for name in ("frames", "threads", "pace", "effort")}
        decode = {"kind": "decode", "input": str(film), "record_video": self.record, **of_split}
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
    def rows(self) -> list[Heard]:
        """The blocks of rows."""
        return [h for h in self.heard if h.topic == "rows" and not h.header.is_end]

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
        observer = stack.enter_context(ExitStack())
        bus = observer.enter_context(open_bus(BusSettings(connect=(run.endpoint,))))
        done = threading.Event()

        def receive(received: Received) -> None:
            at_ns, key, header = time.time_ns(), received.key, received.message.header
            ran.heard.append(Heard(at_ns, source_of(key), topic_of(key), header))

        inbox = CallbackInbox(receive)
        for topic in HEARD:
            bus.subscribe(inbox, f"rsenf/{SITE}/*/{topic}", LOOKING)

        def listen() -> None:
            with observer:
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


def _look(run: GraphRun, ran: Ran, done: threading.Event) -> None:
    begun_s = None
    for look in count():
        if done.wait(LOOK_S):
            return
        for name, node in run.nodes.items():
            if node.health and node.was_ready:
                ran.first.setdefault(name, node.health)
        if len(ran.first) == len(run.nodes):
            begun_s = begun_s or time.process_time()
            ran.run_cpu_s = time.process_time() - begun_s
        if look % SIZED_LOOKS == 0:
            there = {name: node.process.pid for name, node in run.nodes.items() if node.process}
            for name, pid in {**there, "run": os.getpid()}.items():
                ran.peak_mb[name] = max(ran.peak_mb.get(name, 0.0), memory_mb(SHARE, pid) or 0.0)

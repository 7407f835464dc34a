"""Four cameras at once, of which three turn bad: what the graph says of each, and how soon.

By hand: ``python -m tests.run.four_feeds --minutes 6 --out DIR``. Two 720p films of one grid are
made beforehand (and kept in DIR), and served as four feeds by real RTSP servers, a process each.
After half of the time one feed repeats its last half minute for ever, one stands still, and one's
server is killed, to come back ten seconds later. The reference is a table that a logger writes a
line a second to. With ``--honest`` all four stay honest: whatever is said against them is false.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
from av.bitstream import BitStreamFilterContext

from rsenf.bus.inbox import Inbox
from rsenf.bus.keys import LOOKING, camera_key, source_of
from rsenf.bus.zenoh_bus import BusSettings, open_bus
from rsenf.config import load_graph
from rsenf.messages import Alarm, Liveness
from rsenf.model import synthetic_grid
from rsenf.run.supervisor import NodeState, start_graph
from tests.decode.rtsp_server import SYSTEM_PYTHON, missing

SERVER = Path(__file__).with_name("feed_server.py")
GOP, RATE = 30, Fraction(30000, 1001)
AWAY_S, LOOP_S = 10.0, 30.0
MODEL = """\
version: 2
name: feed
light: {lamp: led}
shutter: {frame_rate: 30000/1001, rows: 720, columns: 1280, idle_ratio: 0.25}
codec: {bitrate_bps: 3000000, preset: ultrafast, gop_frames: 30}
effects:
  - exposure: {exposure_s: 0.002}
"""
# What becomes of each camera after half of the time.
FEEDS = {"honest": "live", "looped": "loop", "frozen": "frozen", "restarted": "live"}
GRAPH = """\
version: 1
site: four
nodes:
{decodes}
  track:  {{kind: track, cameras: [{cameras}], track: {{nominal_hz: 50}}}}
  idle:   {{kind: idle, cameras: [{cameras}], idle: {{nominal_hz: 50}}}}
  mains:  {{kind: reference, grid: mains, input: "{table}", follow: true}}
  live:   {{kind: live, cameras: [{cameras}], grid: mains}}
  record: {{kind: record, out: "{out}", overwrite: true,
           topics: ["*/rows", "*/track", "*/idle", "*/live", "*/alarm", "reference/*"]}}
"""
DECODE = (
    '  {name}: {{kind: decode, camera: {name}, input: "{url}", frames: fused, threads: 1, '
    "read_timeout_s: 5, backoff_max_s: 4}}"
)


# --- beforehand -----------------------------------------------------------------------------


def grid_hz(folder: Path, seconds: int) -> list[float]:
    """Return the grid's frequency in each second; the reference and the films are of it."""
    path = folder / "grid.csv"
    freq_hz = synthetic_grid(8, seconds).freq_hz[:seconds]
    path.write_text("frequency\n" + "".join(f"{f:.6f}\n" for f in freq_hz), encoding="utf-8")
    return [float(f"{f:.6f}") for f in freq_hz]


def film(folder: Path, seed: int, seconds: int) -> Path:
    """Film a clip and cut it into its pictures, unless that has been done."""
    path = folder / f"film{seed}_{seconds}.h264"
    if path.with_suffix(".json").exists():
        return path
    clip, model = path.with_suffix(".mp4"), folder / "feed.yaml"
    model.write_text(MODEL, encoding="utf-8")
    words = ["simulate", "--out", clip, "--model", model, "--reference", folder / "grid.csv",
             "--step-s", 1, "--duration-s", seconds - 2, "--seed", seed]  # fmt: skip
    subprocess.run([sys.executable, "-m", "rsenf.cli", *map(str, words)], check=True)
    begins, size = [], 0
    with av.open(str(clip)) as container, path.open("wb") as out:
        stream = container.streams.video[0]
        annex_b = BitStreamFilterContext("h264_mp4toannexb", stream)
        for packet in container.demux(stream):
            if not packet.size:
                continue
            if packet.is_keyframe != (len(begins) % GOP == 0):
                raise ValueError(f"picture {len(begins)}: a key frame is not where it should be")
            data = b"".join(bytes(p) for p in annex_b.filter(packet))
            begins.append(size)
            size += out.write(data)
    clip.unlink()
    about = {"begins": begins, "gop_frames": GOP, "period_s": float(1 / RATE)}
    path.with_suffix(".json").write_text(json.dumps(about), encoding="utf-8")
    return path


# --- meanwhile ------------------------------------------------------------------------------


@dataclass
class Server:
    """One camera."""

    film: Path
    began_s: float
    mode: str
    after_s: float
    port: int = 0
    process: subprocess.Popen[str] = field(init=False)

    def start(self) -> None:
        """Begin to serve, at the same address as before."""
        words = [SYSTEM_PYTHON, SERVER, self.film, "--began-s", self.began_s, "--mode", self.mode,
                 "--after-s", self.after_s, "--loop-s", LOOP_S, "--port", self.port]  # fmt: skip
        self.process = subprocess.Popen(
            list(map(str, words)), stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
        )
        assert self.process.stdout is not None
        self.port = int(self.process.stdout.readline())

    def kill(self) -> None:
        """End at once."""
        self.process.kill()
        self.process.wait()


@contextmanager
def logger(table: Path, freq_hz: list[float], began_s: float) -> Iterator[None]:
    """Write a line to the reference's table as soon as each second is over."""
    over = threading.Event()
    table.write_text("time,frequency\n", encoding="utf-8")

    def write() -> None:
        for k, f in enumerate(freq_hz):
            if over.wait(max(began_s + k + 1 - time.time(), 0.0)):
                return
            with table.open("a", encoding="utf-8") as file:
                file.write(f"{began_s + k:.3f},{f:.6f}\n")

    thread = threading.Thread(target=write, daemon=True)
    thread.start()
    yield
    over.set()
    thread.join()


@dataclass
class Heard:
    """What was said of the feeds: seconds since they began, camera, and words."""

    began_s: float
    verdicts: list[tuple[float, str, str]] = field(default_factory=list)
    alarms: list[tuple[float, str, str]] = field(default_factory=list)

    def take(self, inbox: Inbox, until_s: float) -> None:
        """Listen until so many seconds after the beginning."""
        while (left_s := self.began_s + until_s - time.time()) > 0:
            received = inbox.receive(min(left_s, 1.0))
            if received is None or received.message.header.is_end:
                continue
            at_s = time.time() - self.began_s
            camera, message = source_of(received.key).split("/")[1], received.message
            if isinstance(message, Liveness):
                said = [what for _, of, what in self.verdicts if of == camera]
                if said[-1:] != [message.verdict]:
                    self.verdicts.append((at_s, camera, message.verdict))
                    say(f"{at_s:6.1f} s  {camera:10} {message.verdict}: {message.evidence}")
            elif isinstance(message, Alarm):
                state = "" if message.active else " is over"
                self.alarms.append((at_s, camera, f"{message.kind}{state}"))
                say(f"{at_s:6.1f} s  {camera:10} alarm {message.kind}{state}: {message.text}")

    def between(self, camera: str, from_s: float, to_s: float) -> str:
        """Return what was said of a camera, each with how long after the first of two times."""
        found = [
            f"{what} {at_s - from_s:.0f} s"
            for at_s, of, what in sorted(self.verdicts + self.alarms)
            if of == camera and from_s <= at_s < to_s
        ]
        return ", ".join(found) or "-"

    def sum_up(self, turn_s: float) -> None:
        """Print what was said before and after the turn."""
        say("\nfeed        since the beginning | since the turn")
        for name in FEEDS:
            before, after = self.between(name, 0, turn_s), self.between(name, turn_s, 1e9)
            say(f"{name:10}  {before} | {after}")

    @property
    def is_bad(self) -> bool:
        """Whether anything was said against a feed."""
        return bool(self.alarms) or any(w in ("stale", "frozen") for *_, w in self.verdicts)


def say(line: str) -> None:
    """Print at once."""
    print(line, flush=True)


def told(node: NodeState) -> None:
    """Print what the sources say of themselves, and who of the others has not gone on."""
    if node.kind == "decode" or node.state != "running":
        say(f"          {node.name}: {node.state} {node.detail}")


def main() -> int:
    """Make the films, run the graph beside the feeds, and say what came of it."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--minutes", type=float, default=6.0)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--honest", action="store_true", help="nothing happens to any feed")
    args = parser.parse_args()
    if lacking := missing():
        sys.exit(lacking)
    args.out.mkdir(parents=True, exist_ok=True)
    seconds, turn_s = round(60 * args.minutes), 30.0 * args.minutes
    long_s = seconds + 60
    freq_hz = grid_hz(args.out, long_s)
    films = [film(args.out, seed, long_s) for seed in (1, 2)]
    began_s = float(np.ceil(time.time() + 1.0))
    servers = {
        name: Server(films[k % 2], began_s, "live" if args.honest else mode, turn_s)
        for k, (name, mode) in enumerate(FEEDS.items())
    }
    table, path, inbox = args.out / "mains.csv", args.out / "graph.yaml", Inbox()
    with ExitStack() as stack:
        for server in servers.values():
            server.start()
            stack.callback(server.kill)
        stack.enter_context(logger(table, freq_hz, began_s))
        urls = {name: f"rtsp://127.0.0.1:{server.port}/cam" for name, server in servers.items()}
        decodes = "\n".join(DECODE.format(name=name, url=url) for name, url in urls.items())
        path.write_text(
            GRAPH.format(
                decodes=decodes,
                cameras=", ".join(FEEDS),
                table=table,
                out=args.out / "feeds.mcap",
            ),
            encoding="utf-8",
        )
        run = stack.enter_context(start_graph(load_graph(path), path, told))
        bus = stack.enter_context(open_bus(BusSettings(connect=(run.endpoint,))))
        for topic in ("live", "alarm"):
            bus.subscribe(inbox, camera_key("four", "*", topic), LOOKING)
        watching = threading.Event()
        watcher = threading.Thread(target=run.wait, args=(watching,), daemon=True)
        watcher.start()
        heard = Heard(began_s)
        heard.take(inbox, turn_s)
        if not args.honest:
            say(f"{turn_s:6.1f} s  the feeds turn bad")
            servers["restarted"].kill()
            heard.take(inbox, turn_s + AWAY_S)
            servers["restarted"].start()
        heard.take(inbox, seconds)
        watching.set()
        watcher.join(60)
    heard.sum_up(turn_s)
    return int(args.honest and heard.is_bad)


if __name__ == "__main__":
    sys.exit(main())

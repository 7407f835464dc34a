"""A day of eight feeds as fast as the machine goes, with a fault every ten minutes from a seed.

By hand: ``python -m tests.run.day --hours 24 --seed 1``, or ``--honest`` for a day without faults.
Two feeders (:mod:`tests.run.day_feeds`) send the rows of eight cameras to ``rsenf run``: track,
idle, match, live, record. Feeds repeat, stand still, are spliced, stall, and have their clocks set;
nodes are killed and stopped, the recorder's writes fail, links are cut. Printed: what was told of
each kind of fault and how late, false alarms, memory, lines of the log, and what was lost of rows
and estimates beside what the nodes counted. The exit code is 1 when an alarm is missed or false, a
node grows, or a loss isn't counted.
"""

from __future__ import annotations

import argparse
import math
import os
import resource
import signal
import sys
import tempfile
import time
from pathlib import Path

import psutil

from rsenf.bus.inbox import Inbox
from rsenf.bus.keys import LOOKING, camera_key, health_key
from rsenf.bus.zenoh_bus import BusSettings, open_bus

sys.path.append(str(Path(__file__).parent))
from live_run import LINE, LiveRun

from tests.run.day_feeds import (
    HOST_FAULTS,
    MARGIN_S,
    SITE,
    Camera,
    Fault,
    cameras_of,
    faults,
    grid_of,
)
from tests.run.day_report import Blow, Heard, report
from tests.run.soak import write_grid

GRAPH = """\
version: 1
site: day
restart: {{limit: 1000, within_s: 60, backoff_max_s: 2}}
nodes:
  east: {{kind: external, command: [{command}], sends: [{east}]}}
  west: {{kind: external, command: [{command}], sends: [{west}]}}
  grid:  {{kind: reference, grid: ce, input: "{folder}/grid.csv"}}
  track: {{kind: track, cameras: [{cameras}], track: {{nominal_hz: 50}}}}
  idle:  {{kind: idle, cameras: [{cameras}], idle: {{nominal_hz: 50}}}}
  match: {{kind: match, cameras: [{cameras}], grid: ce, interim_every_s: 1800, keep_hours: 1}}
  live:  {{kind: live, cameras: [{cameras}], grid: ce, live: {{keep_hours: 1}}}}
  record: {{kind: record, archive: "{folder}/archive", rotation: {{size_mb: 100}}}}
"""


def strike(fault: Fault, run: LiveRun, heard: Heard, inbox: Inbox) -> Blow:
    """Apply a fault of the host, and wait until the node runs again."""
    blow, name, begun = Blow(fault), fault.of, time.monotonic()
    pid, lines, since_s = run.pids[name], len(run.lines), dict(heard.until_s)
    if fault.kind == "kill":
        os.kill(pid, signal.SIGKILL)
    elif fault.kind == "stop":
        os.kill(pid, signal.SIGSTOP)
    elif fault.kind == "disk full":  # every further write fails
        psutil.Process(pid).rlimit(resource.RLIMIT_FSIZE, (0, 0))
    while (took_s := time.monotonic() - begun) < 60 and blow.back_s == math.inf:
        heard.take(inbox)
        said = [m for line in run.lines[lines:] if (m := LINE.match(line)) and m[2] == name]
        if said and blow.told_s == math.inf:
            blow.told_s = took_s
        is_over = took_s > fault.value_s + 5 if fault.kind == "link cut" else run.pids[name] != pid
        if is_over or run.process.poll() is not None:
            blow.back_s = took_s
    heard.disturbed.append((since_s, dict(heard.until_s)))
    return blow


def play(
    folder: Path, args: argparse.Namespace, found: tuple[Fault, ...]
) -> tuple[LiveRun, Heard, list[Blow]]:
    """Run the graph to its end; returns it, what it said, and what was done to it."""
    total_s = round(3600 * args.hours)
    write_grid(folder / "grid.csv", grid_of(args.seed, total_s), total_s + 30, skip_s=MARGIN_S)
    words = [sys.executable, "-m", "tests.run.day_feeds", folder, args.seed, total_s, args.cameras]
    both = {feeder: cameras_of(feeder, args.cameras) for feeder in ("east", "west")}
    path = folder / "day.yaml"
    path.write_text(
        GRAPH.format(
            folder=folder,
            command=", ".join(f'"{word}"' for word in [*words, int(args.honest)]),
            cameras=", ".join(both["east"] + both["west"]),
            **{name: ", ".join(f"{c}/rows" for c in cameras) for name, cameras in both.items()},
        )
    )
    run, heard, inbox, blows = LiveRun(path), Heard(), Inbox(), list[Blow]()
    due = [fault for fault in found if fault.kind in HOST_FAULTS]
    run.until("running", "track", "live", "record")
    sampled_s = said_s = time.monotonic()
    with open_bus(BusSettings(connect=(run.endpoint,))) as bus:
        for topic in ("live", "alarm"):
            bus.subscribe(inbox, camera_key(SITE, "*", topic), LOOKING)
        bus.subscribe(inbox, health_key(SITE, "*"), LOOKING)
        while run.process.poll() is None:
            heard.take(inbox)
            if due and max(heard.until_s.values(), default=0.0) >= due[0].at_s:
                blows.append(strike(due.pop(0), run, heard, inbox))
            if time.monotonic() - sampled_s > 2:
                sampled_s = time.monotonic()
                heard.sample({**run.pids, "run": run.process.pid})
            if time.monotonic() - said_s > 60:
                said_s = time.monotonic()
                (folder / "log.txt").write_text("\n".join(run.lines))
                print(f"  {min(heard.until_s.values(), default=0) / 3600:.2f} h", flush=True)
        heard.take(inbox)
    run.wait()
    return run, heard, blows


def main() -> int:
    """Play the day, and report."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--hours", type=float, default=24.0, help="of the stream (24)")
    parser.add_argument("--cameras", type=int, default=8)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--honest", action="store_true", help="without any fault")
    parser.add_argument("--out", type=Path, help="folder to keep; a temporary one otherwise")
    args = parser.parse_args()
    total_s = round(3600 * args.hours)
    found = () if args.honest else faults(args.seed, total_s, args.cameras)
    names = cameras_of("east", args.cameras) + cameras_of("west", args.cameras)
    with tempfile.TemporaryDirectory() as temporary:
        folder = (args.out or Path(temporary)).absolute()
        folder.mkdir(parents=True, exist_ok=True)
        begun = time.monotonic()
        run, heard, blows = play(folder, args, found)
        (folder / "log.txt").write_text("\n".join(run.lines))
        took_min = (time.monotonic() - begun) / 60
        print(f"{args.hours:g} h of {args.cameras} feeds in {took_min:.1f} min, exit {run.wait()}")
        cameras = [Camera(name, args.seed, total_s, found) for name in names]
        fine = report(found, cameras, heard, blows, run.lines, folder / "archive")
    print("\nas it should be" if fine else "\nNOT AS IT SHOULD BE")
    return int(not fine)


if __name__ == "__main__":
    sys.exit(main())

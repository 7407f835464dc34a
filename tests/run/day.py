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
import contextlib
import os
import re
import resource
import signal
import sys
import tempfile
import time
from collections import Counter, defaultdict
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import psutil

from rsenf.bus.inbox import Inbox
from rsenf.bus.keys import LOOKING, camera_key, health_key, source_of
from rsenf.bus.zenoh_bus import BusSettings, open_bus
from rsenf.messages import Alarm, Health
from rsenf.record.archive.layout import archived_files
from rsenf.record.reader import open_recording

sys.path.append(str(Path(__file__).parent))
from live_run import LINE, LiveRun

from tests.run.day_feeds import (
    FEED_FAULTS,
    HOST_FAULTS,
    MARGIN_S,
    RATE_HZ,
    SITE,
    T0_NS,
    Camera,
    Fault,
    cameras_of,
    faults,
    grid_of,
)
from tests.run.soak import write_grid

SILENT_S = 5.0
GRAPH = """\
version: 1
site: day
restart: {{limit: 1000, within_s: 60, backoff_s: 0.1, backoff_max_s: 0.5, silent_s: {silent_s}}}
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
# What is told of a fault of the feed, and how soon, s: see rsenf/help/live.md and results.md (nine
# of ten times). A stall is told by the next picture, as no clock but the stream's goes on meanwhile.
TELLS = {
    "loop": (("loop", "stale"), 5.0),
    "freeze": (("frozen",), 9.0),
    "splice": (("phase_jump", "stale"), 71.0),
    "stall": (("lost",), 5.0),
}
AFTER_S = 180  # a fault's end may be told so long after it: the feed changes once more
LIVE_AGAIN_S = 60.0  # after a clock was set
TOLD_S = 10.0  # of the host, in which a hung or cut node is told, and a killed one runs again
WARM, MIDDLE, END = 0.1, 0.5, 1.0
MOST_GROWTH, NOISE_MB = 1.1, 3.0


@dataclass
class Heard:
    """What a run said: times in seconds of the stream.

    Attributes
    ----------
    alarms : list of (float, str, Alarm)
    verdicts : dict
        Of each camera: when it changed, and to which.
    health : dict
        The last of each process, by node and restarts.
    memory : dict
        Of each node: when, MB.
    disturbed : list of (float, float)
        When a process was away, with a margin.
    """

    at_s: float = 0.0
    alarms: list[tuple[float, str, Alarm]] = field(default_factory=list)
    verdicts: dict[str, list[tuple[float, str]]] = field(default_factory=lambda: defaultdict(list))
    health: dict[tuple[str, int], Health] = field(default_factory=dict)
    memory: dict[str, list[tuple[float, float]]] = field(default_factory=lambda: defaultdict(list))
    disturbed: list[tuple[float, float]] = field(default_factory=list)

    def take(self, inbox: Inbox) -> None:
        """Take what is there, or wait a little."""
        timeout_s = 0.05
        while received := inbox.receive(timeout_s):
            timeout_s, message = 0.0, received.message
            if isinstance(message, Health):
                if not message.header.is_end and message.pid:
                    self.health[message.node, message.restarts] = message
                continue
            if message.header.is_end or not message.header.arrival_time_ns:
                continue
            at_s = (message.header.arrival_time_ns - T0_NS) / 1e9
            camera = source_of(received.key).split("/")[1]
            if isinstance(message, Alarm):
                # Of what isn't of the stream (no arrival there) the time is that of the others.
                at_s = at_s if at_s < 1e7 else self.at_s
                self.alarms.append((at_s, camera, message))
                continue
            self.at_s = max(self.at_s, at_s)
            if self.verdicts[camera][-1:] != [] and self.verdicts[camera][-1][1] == message.verdict:
                continue
            self.verdicts[camera].append((at_s, message.verdict))

    def sample(self, run: LiveRun) -> None:
        """Note the memory of every process."""
        for name, pid in {**run.pids, "run": run.process.pid}.items():
            with contextlib.suppress(psutil.Error):
                mb = psutil.Process(pid).memory_info().rss / 1e6
                self.memory[name].append((self.at_s, mb))


@dataclass
class Blow:
    """A fault of a process that was applied: seconds until it was told, and until all ran again."""

    fault: Fault
    told_s: float = np.inf
    back_s: float = np.inf


def strike(fault: Fault, run: LiveRun, heard: Heard, inbox: Inbox) -> Blow:
    """Apply a fault of the host, and wait until the node runs again."""
    blow, name, begun = Blow(fault), fault.of, time.monotonic()
    pid, lines, since_s = run.pids[name], len(run.lines), heard.at_s
    if fault.kind == "kill":
        os.kill(pid, signal.SIGKILL)
    elif fault.kind == "stop":
        os.kill(pid, signal.SIGSTOP)
    elif fault.kind == "disk full":  # every further write fails
        psutil.Process(pid).rlimit(resource.RLIMIT_FSIZE, (0, 0))
    while (took_s := time.monotonic() - begun) < 60 and np.isinf(blow.back_s):
        heard.take(inbox)
        said = [m for line in run.lines[lines:] if (m := LINE.match(line)) and m[2] == name]
        if said and np.isinf(blow.told_s):
            blow.told_s = took_s
        is_over = took_s > fault.value_s + 5 if fault.kind == "link cut" else run.pids[name] != pid
        if is_over or run.process.poll() is not None:
            blow.back_s = took_s
    heard.disturbed.append((since_s - 5, heard.at_s + AFTER_S))
    return blow


def play(folder: Path, args: argparse.Namespace, found: tuple[Fault, ...]) -> tuple:
    """Run the graph to its end; returns it, what it said, and what was done to it."""
    total_s = round(3600 * args.hours)
    write_grid(folder / "grid.csv", grid_of(args.seed, total_s), total_s + 30, skip_s=MARGIN_S)
    words = [sys.executable, "-m", "tests.run.day_feeds", folder, args.seed, total_s, args.cameras]
    both = {feeder: cameras_of(feeder, args.cameras) for feeder in ("east", "west")}
    path = folder / "day.yaml"
    path.write_text(
        GRAPH.format(
            folder=folder,
            silent_s=SILENT_S,
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
            if due and heard.at_s >= due[0].at_s:
                blows.append(strike(due.pop(0), run, heard, inbox))
            if time.monotonic() - sampled_s > 2:
                sampled_s = time.monotonic()
                heard.sample(run)
            if time.monotonic() - said_s > 60:
                said_s = time.monotonic()
                print(f"  {heard.at_s / 3600:.2f} h, {len(blows)} blows", flush=True)
        heard.take(inbox)
    run.wait()
    return run, heard, blows


# --- afterwards -----------------------------------------------------------------------------


def judge_feeds(found: tuple[Fault, ...], heard: Heard) -> bool:
    """Print what was told of the faults of feeds, and what without cause; returns whether fine."""
    table: dict[str, Counter[str]] = {kind: Counter() for kind in FEED_FAULTS}
    bad = list[str]()
    soon: dict[str, list[float]] = defaultdict(list)
    for fault in found:
        if fault.kind not in FEED_FAULTS:
            continue
        count, words = table[fault.kind], f"{fault.kind} of {fault.of} at {fault.at_s} s"
        count["made"] += 1
        until_s = fault.at_s + fault.lasts_s + 30
        if fault.kind in TELLS:
            kinds, limit_s = TELLS[fault.kind]
            limit_s += fault.lasts_s * (fault.kind == "stall")
            told = [t for t, of, a in heard.alarms if of == fault.of and a.kind in kinds and a.active]
        else:
            limit_s, until_s = LIVE_AGAIN_S, fault.at_s + AFTER_S
            said = heard.verdicts[fault.of]
            told = [t for t, v in said if v == "live"]
        # What a silence begins with is told at the time of the last picture.
        told = [t - fault.at_s for t in told if fault.at_s - 2 <= t <= until_s]
        count["told"] += bool(told)
        count["late"] += bool(told) and told[0] > limit_s
        count["missed"] += not told
        soon[fault.kind] += told[:1]
        if not told or told[0] > limit_s:
            bad.append(f"{words}: {f'after {told[0]:.0f} s' if told else 'missed'}")
    print(f"\n{'of feeds':12}" + "".join(f"{k:>8}" for k in ("made", "told", "late", "missed")))
    for kind, count in table.items():
        after = f"   median {np.median(soon[kind]):.0f} s, last {max(soon[kind]):.0f} s" if soon[kind] else ""
        print(f"{kind:12}" + "".join(f"{count[k]:8d}" for k in ("made", "told", "late", "missed")) + after)
    false = false_alarms(found, heard)
    for line in [*bad, *(f"FALSE {line}" for line in false)]:
        print(f"  {line}")
    return not false and not any(count["missed"] for count in table.values())


def false_alarms(found: tuple[Fault, ...], heard: Heard) -> list[str]:
    """Return the alarms without a cause."""
    out, by_speed = list[str](), 0
    for at_s, of, alarm in heard.alarms:
        if not alarm.active or alarm.severity == "info":
            continue
        words = f"{alarm.kind} of {of} at {at_s:.0f} s: {alarm.text}"
        near = [f for f in found if f.of == of and -2 <= at_s - f.at_s <= f.lasts_s + AFTER_S]
        if any(fault.kind in TELLS for fault in near):
            continue
        is_away = any(a <= at_s <= b for a, b in heard.disturbed)
        if alarm.kind in ("lost", "unrecorded") and is_away:
            by_speed += 1
            continue
        out.append(words + (" (a node was away)" if is_away else "") + "".join(f" ({f.kind})" for f in near))
    print(f"\nalarms {sum(a.active for *_, a in heard.alarms)}, false {len(out)}; 'lost' while a process was away {by_speed}")
    return out


def judge_hosts(blows: list[Blow]) -> bool:
    """Print how soon nodes that were hit were named and ran again; returns whether all were."""
    print(f"\n{'of hosts':12}{'made':>8}{'told':>8}{'late':>8}{'back':>8}")
    fine = True
    for kind in HOST_FAULTS:
        of = [blow for blow in blows if blow.fault.kind == kind]
        told = [blow.told_s for blow in of if np.isfinite(blow.told_s)]
        back = [blow.back_s for blow in of if np.isfinite(blow.back_s)]
        late = sum(t > TOLD_S for t in told)
        after = f"   told {np.median(told):.1f} s, last {max(told):.1f} s" if told else ""
        after += f"; back {np.median(back):.1f} s, last {max(back):.1f} s" if back else ""
        print(f"{kind:12}{len(of):8d}{len(told):8d}{late:8d}{len(back):8d}{after}")
        fine &= len(back) == len(of) and (kind == "link cut" or len(told) == len(of))
    return fine


def judge_memory(heard: Heard, total_s: float) -> bool:
    """Print memory at three times; returns whether no process grew after the first."""
    print(f"\n{'MB':8}" + "".join(f"{100 * share:7.0f} %" for share in (WARM, MIDDLE, END)) + f"{'most':>9}")
    flat = True
    for name, samples in heard.memory.items():
        at, mb = np.array(samples).T
        parts = [mb[(at >= (s - 0.1) * total_s) & (at <= (s + 0.02) * total_s)] for s in (WARM, MIDDLE, END)]
        most = [float(part.max()) if part.size else np.nan for part in parts]
        grows = most[2] > MOST_GROWTH * most[1] + NOISE_MB
        flat &= not grows
        cells = "".join(f"{value:9.1f}" for value in most)
        print(f"{name:8}{cells}{mb.max():9.1f}{'  GROWS' if grows else ''}")
    return flat


def judge_losses(folder: Path, cameras: list[Camera], run: LiveRun, heard: Heard) -> bool:
    """Print what is not in the archive beside what was counted; returns whether all was."""
    there: dict[str, dict[tuple[str, int], set[int]]] = defaultdict(lambda: defaultdict(set))
    covered: dict[str, dict[int, set[int]]] = defaultdict(lambda: defaultdict(set))
    for file in archived_files(folder / "archive"):
        for key, message, _ in open_recording(file.path).messages():
            header, topic = message.header, key.rpartition("/")[2]
            if header.is_end or topic not in ("rows", "track"):
                continue
            there[key][header.run_id, header.epoch].add(header.seq)
            if topic == "rows" or getattr(message, "rank", 0) == 0:
                covered[key][header.epoch] |= set(range(header.frame_first // RATE_HZ, header.frame_last // RATE_HZ + 1))
    missed: dict[str, Counter[str]] = defaultdict(Counter)
    for (name, _), health in heard.health.items():
        for what in ("missed", "dropped", "rejected"):
            missed[name][what] += getattr(health, what)
    lost: Counter[str] = Counter()
    for camera in cameras:
        for topic in ("rows", "track"):
            of = covered[camera_key(SITE, camera.name, topic)]
            for epoch in np.unique(camera.epoch):
                sent = set(range(int((camera.is_sent & (camera.epoch == epoch)).sum())))
                lost[topic] += len(sent - of[int(epoch)])
                lost[f"all {topic}"] += len(sent)
    told: Counter[str] = Counter()
    for text in {h.detail for h in heard.health.values()} | {line for line in run.lines}:
        for count, topic in re.findall(r"(\d+) frames have no (rows|track)", text):
            told[topic] = max(told[topic], int(count))
    print(f"\nseconds sent {lost['all rows']}, without rows in the archive {lost['rows']}, "
          f"without estimate {lost['track']} of {lost['all track']}")
    print("frames that nodes said to lack: " + ", ".join(f"{t} {n}" for t, n in told.items()))
    for name, count in missed.items():
        print(f"{name:8}" + "".join(f"{what} {n:6d}  " for what, n in count.items()))
    return lost["rows"] <= missed["record"]["missed"] + missed["record"]["dropped"]


def judge_lines(run: LiveRun, hours: float) -> None:
    """Print how many lines the log has, by what they tell of."""
    kinds: Counter[str] = Counter()
    for line in run.lines:
        name = line.split(" s  ")[-1].partition(":")[0]
        kinds["verdicts and alarms" if "/" in name else "nodes"] += 1
    print(f"\nlines of the log: {len(run.lines)}, {24 * len(run.lines) / hours:.0f} a day; "
          + ", ".join(f"{k} {n}" for k, n in kinds.items()))


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
        print(f"{args.hours:g} h of {args.cameras} feeds in {took_min:.1f} min, exit {run.process.returncode}")
        fine = judge_feeds(found, heard)
        fine &= judge_hosts(blows)
        fine &= judge_memory(heard, total_s)
        judge_lines(run, args.hours)
        cameras = [Camera(name, args.seed, total_s, found) for name in names]
        fine &= judge_losses(folder, cameras, run, heard)
    print("\nas it should be" if fine else "\nNOT AS IT SHOULD BE")
    return int(not fine)


if __name__ == "__main__":
    sys.exit(main())

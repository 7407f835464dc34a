"""What a run of a day said (:class:`Heard`), and whether that is right of every fault.

Times are seconds of the stream, but for faults of the host: these are told by its clock.
"""

from __future__ import annotations

import contextlib
import re
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import psutil

from rsenf.bus.inbox import Inbox
from rsenf.bus.keys import camera_key, source_of, topic_of
from rsenf.messages import Alarm, Health
from rsenf.record.archive.layout import archived_files
from rsenf.record.reader import open_recording
from tests.run.day_feeds import FEED_FAULTS, HOST_FAULTS, RATE_HZ, SITE, T0_NS, Camera, Fault

# Which alarms tell of a fault, and how soon, s: see rsenf/help/live.md and results.md (nine of
# ten). A stall is told by the next picture: meanwhile no clock of the stream goes on.
TELLS = {
    "loop": (("loop", "stale"), 5.0),
    "freeze": (("frozen",), 9.0),
    "splice": (("phase_jump", "stale"), 71.0),
    "stall": (("lost",), 5.0),
}
LIVE_AGAIN_S = 60.0  # after a clock was set, which is no alarm
AFTER_S = 180  # a fault's end changes the feed once more, and may be told so long
EARLY_S = 2.0  # an alarm has the time of the picture that its verdict is of
TOLD_S = 25.0  # of the host: a node is silent after 20 s
SHARES = (0.1, 0.5, 1.0)  # of the day, at which memory is compared
MOST_GROWTH, NOISE_MB = 1.1, 3.0
LACKS = re.compile(r"(\d+) frames have no (rows|track)")
FATES = ("missed", "dropped", "rejected")
COLUMNS = ("made", "told", "late", "missed")


@dataclass
class Heard:
    """What a run said.

    Attributes
    ----------
    until_s : dict
        Newest verdict of each camera.
    alarms : list of (float, str, Alarm)
        When, of which camera.
    verdicts : dict
        Of each camera: when it changed, and to which.
    counts : dict
        Most of each count that each process said, by node and restarts.
    memory : dict
        Of each node: when, MB.
    disturbed : list of (dict, dict)
        ``until_s`` when a process was hit, and when it ran again.
    """

    until_s: dict[str, float] = field(default_factory=dict)
    alarms: list[tuple[float, str, Alarm]] = field(default_factory=list)
    verdicts: dict[str, list[tuple[float, str]]] = field(default_factory=lambda: defaultdict(list))
    counts: dict[tuple[str, int], Counter[str]] = field(
        default_factory=lambda: defaultdict(Counter)
    )
    memory: dict[str, list[tuple[float, float]]] = field(default_factory=lambda: defaultdict(list))
    disturbed: list[tuple[dict[str, float], dict[str, float]]] = field(default_factory=list)

    def take(self, inbox: Inbox) -> None:
        """Take what is there, or wait a little."""
        timeout_s = 0.05
        while received := inbox.receive(timeout_s):
            timeout_s, message = 0.0, received.message
            if message.header.is_end:
                continue
            if isinstance(message, Health):
                self._count(message)
                continue
            camera = source_of(received.key).split("/")[1]
            at_s = (message.header.arrival_time_ns - T0_NS) / 1e9
            if isinstance(message, Alarm):
                # The run's own alarms, of recorders, have the host's time.
                is_own = message.kind == "unrecorded"
                at_s = self.until_s.get(camera, 0.0) if is_own else at_s
                self.alarms.append((at_s, camera, message))
                continue
            self.until_s[camera] = at_s
            if not self.verdicts[camera] or self.verdicts[camera][-1][1] != message.verdict:
                self.verdicts[camera].append((at_s, message.verdict))

    def _count(self, health: Health) -> None:
        counts = self.counts[health.node, health.restarts]
        said = {fate: getattr(health, fate) for fate in FATES}
        for frames, topic in LACKS.findall(health.detail):
            said[topic] = said.get(topic, 0) + int(frames)
        for what, count in said.items():
            counts[what] = max(counts[what], count)

    def sample(self, pids: Mapping[str, int]) -> None:
        """Note the memory of every process."""
        at_s = min(self.until_s.values(), default=0.0)
        for name, pid in pids.items():
            with contextlib.suppress(psutil.Error):
                mb = psutil.Process(pid).memory_info().rss / 1e6
                self.memory[name].append((at_s, mb))


@dataclass
class Blow:
    """A fault of the host: seconds until it was told, and until the node ran again."""

    fault: Fault
    told_s: float = np.inf
    back_s: float = np.inf


def report(
    found: Sequence[Fault],
    cameras: Sequence[Camera],
    heard: Heard,
    blows: Sequence[Blow],
    lines: Sequence[str],
    archive: Path,
) -> bool:
    """Print everything; returns whether it is as it should be."""
    total_s = cameras[0].is_sent.size
    fine = [
        feeds(found, heard),
        hosts(blows),
        memory(heard, total_s),
        losses(archive, cameras, heard),
    ]
    of_feeds = sum(f"  {SITE}/" in line for line in lines)
    print(f"\nlines of the log: {len(lines)}, of which {of_feeds} of feeds; {len(found)} faults")
    return all(fine)


def feeds(found: Sequence[Fault], heard: Heard) -> bool:
    """Print what was told of the faults of feeds, and alarms without any."""
    count: dict[str, Counter[str]] = defaultdict(Counter)
    delays: dict[str, list[float]] = defaultdict(list)
    bad = [f"FALSE {words}" for words in false_alarms(found, heard)]
    for fault in found:
        if fault.kind not in FEED_FAULTS:
            continue
        kinds, limit_s = TELLS.get(fault.kind, ((), LIVE_AGAIN_S))
        last_s = fault.at_s + (fault.lasts_s + 30 if kinds else AFTER_S)
        times_s = [
            t for t, of, a in heard.alarms if of == fault.of and a.kind in kinds and a.active
        ]
        if not kinds:  # its clock was set: it is live again
            times_s = [t for t, verdict in heard.verdicts[fault.of] if verdict == "live"]
        told = [t - fault.at_s for t in times_s if fault.at_s - EARLY_S <= t <= last_s]
        is_late = bool(told) and told[0] > limit_s + fault.lasts_s * (fault.kind == "stall")
        count[fault.kind] += Counter(made=1, told=bool(told), late=is_late, missed=not told)
        delays[fault.kind] += told[:1]
        if is_late or not told:
            words = f"{fault.kind} of {fault.of} at {fault.at_s} s"
            bad.append(f"{words}: {f'told after {told[0]:.0f} s' if told else 'missed'}")
    print(f"\n{'of feeds':12}" + "".join(f"{k:>8}" for k in COLUMNS))
    for kind in FEED_FAULTS:
        cells = "".join(f"{count[kind][k]:8d}" for k in COLUMNS)
        print(f"{kind:12}{cells}   {_spread(delays[kind])}")
    print(*(f"  {words}" for words in bad), sep="\n")
    return not any(words.startswith("FALSE") or words.endswith("missed") for words in bad)


def _spread(values: Sequence[float]) -> str:
    finite = [v for v in values if np.isfinite(v)]
    return f"median {np.median(finite):.0f} s, last {max(finite):.0f} s" if finite else ""


def false_alarms(found: Sequence[Fault], heard: Heard) -> Iterable[str]:
    """Yield the alarms without a cause.

    While a process is away, pictures may stay away with it: faster than real time, whoever waits
    for it holds up the cameras.
    """
    held_up = 0
    for at_s, of, alarm in heard.alarms:
        if not alarm.active or alarm.severity == "info":
            continue
        near = [f for f in found if f.of == of and -5 <= at_s - f.at_s <= f.lasts_s + AFTER_S]
        # A clock that was set is a jump of the phase that the stamps hide.
        if any(fault.kind in TELLS or alarm.kind == "phase_jump" for fault in near):
            continue
        is_away = any(
            a.get(of, 0.0) - 5 <= at_s <= b.get(of, 0.0) + AFTER_S for a, b in heard.disturbed
        )
        if alarm.kind in ("lost", "unrecorded") and is_away:
            held_up += 1
        else:
            after = "".join(f" after {f.kind}" for f in near) + " while a node was away" * is_away
            yield f"{alarm.kind} of {of} at {at_s:.0f} s{after}: {alarm.text}"
    began = sum(alarm.active for *_, alarm in heard.alarms)
    print(f"\n{began} alarms, {held_up} of them of pictures that a node away held up")


def hosts(blows: Sequence[Blow]) -> bool:
    """Print how soon nodes that were hit were named, and ran again."""
    print(f"\n{'of hosts':12}{'made':>8}{'told':>8}{'late':>8}{'back':>8}")
    for kind in HOST_FAULTS:
        told = [blow.told_s for blow in blows if blow.fault.kind == kind]
        back = [blow.back_s for blow in blows if blow.fault.kind == kind]
        counts = len(told), np.isfinite(told).sum(), sum(TOLD_S < t < np.inf for t in told)
        cells = "".join(f"{n:8d}" for n in (*counts, np.isfinite(back).sum()))
        print(f"{kind:12}{cells}   told: {_spread(told)}; back: {_spread(back)}")
    # A link that is whole again within a lease needs no word.
    bad = [
        blow.fault
        for blow in blows
        if np.isinf(blow.back_s) or (blow.fault.kind != "link cut" and np.isinf(blow.told_s))
    ]
    for fault in bad:
        print(f"  {fault.kind} of {fault.of} at {fault.at_s} s: not told, or not back in a minute")
    return not bad


def memory(heard: Heard, total_s: float) -> bool:
    """Print memory at three times; returns whether no node has grown since the second."""
    print(f"\n{'MB':8}" + "".join(f"{100 * share:7.0f} %" for share in SHARES))
    flat = True
    for name, samples in heard.memory.items():
        at, mb = np.array(samples).T / [[total_s], [1.0]]
        most = [np.nanmax([*mb[(at >= s - 0.1) & (at <= s + 0.02)], 0.0]) for s in SHARES]
        # What is kept for an hour fills up meanwhile.
        grows = total_s >= 2 * 3600 and bool(most[2] > MOST_GROWTH * most[1] + NOISE_MB)
        flat &= not grows
        print(f"{name:8}" + "".join(f"{m:9.1f}" for m in most) + "  GROWS" * grows)
    return flat


def losses(archive: Path, cameras: Sequence[Camera], heard: Heard) -> bool:
    """Print what isn't in the archive, beside what the nodes counted."""
    covered: dict[tuple[str, int], set[int]] = defaultdict(set)
    for file in archived_files(archive):
        for key, message, _ in open_recording(file.path).messages():
            header = message.header
            if topic_of(key) in ("rows", "track") and not header.is_end and header.frame_first >= 0:
                seconds = range(header.frame_first // RATE_HZ, header.frame_last // RATE_HZ + 1)
                covered[key, header.epoch].update(seconds)
    lost: Counter[str] = Counter()
    for camera in cameras:
        for epoch in np.unique(camera.epoch).tolist():
            sent = set(range(int((camera.is_sent & (camera.epoch == epoch)).sum())))
            rows, track = (
                covered[camera_key(SITE, camera.name, topic), epoch] for topic in ("rows", "track")
            )
            # Of what has no rows there can be no estimate.
            lost += Counter(sent=len(sent), rows=len(sent - rows), track=len((sent & rows) - track))
    print(
        f"\n{lost['sent']} seconds sent; {lost['rows']} without rows in the archive, "
        f"{lost['track']} with rows and without estimate"
    )
    counted: Counter[str] = Counter()
    for name in dict.fromkeys(name for name, _ in heard.counts):
        of = sum((c for (n, _), c in heard.counts.items() if n == name), Counter[str]())
        print(f"{name:8}" + ", ".join(f"{what} {n}" for what, n in of.items()))
        if name == "record":
            counted = of
    # A block, and an estimate, is of a second; what a restarted tracker lacks is told in frames.
    messages = counted["missed"] + counted["dropped"]
    return lost["rows"] + lost["track"] <= messages + counted["track"] / RATE_HZ

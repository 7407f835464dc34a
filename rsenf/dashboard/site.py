"""The state of all feeds, nodes and alarms, updated by every message. Thread-safe with its lock.

A graph file tells which cameras and nodes there are, and whether liveness is judged; an archive has
recordings of the alarms.
"""

from __future__ import annotations

import shlex
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rsenf.bus.keys import ROOT, SILENT_S, source_of, topic_of
from rsenf.config import Graph, redact
from rsenf.dashboard.alarm_board import AlarmBoard, Raised
from rsenf.dashboard.enf_series import References, in_ms, rounded
from rsenf.dashboard.feed import Feed
from rsenf.messages import Alarm, Health, Liveness, ReferenceBlock
from rsenf.record.archive.alarms import AlarmLog
from rsenf.record.archive.layout import ArchivedFile, archived_files
from rsenf.timebase import NS_PER_S


@dataclass(frozen=True)
class Wiring:
    """Contents of a graph file; the defaults stand for no graph file.

    Attributes
    ----------
    nodes : dict
        Names of the nodes that serve each feed, in the order of the file.
    judged : frozenset of str or None
        Feeds whose liveness a node judges; None if unknown.
    in_ring : tuple of str
        Feeds whose frames are in shared memory of some host.
    archive : Path or None
        Folder with recordings of alarms.
    claimed_ns : dict
        Claimed start times, UTC in ns, of feeds that aren't live (files or simulations).
    """

    nodes: dict[str, list[str]] = field(default_factory=dict)
    judged: frozenset[str] | None = None
    in_ring: tuple[str, ...] = ()
    archive: Path | None = None
    claimed_ns: dict[str, int] = field(default_factory=dict)


def key_expressions(wiring: Wiring) -> list[str]:
    """Return further keys to subscribe to: frames in shared memory, which cost no bandwidth."""
    return [f"{ROOT}/{feed}/frames" for feed in wiring.in_ring]


def wiring_of(graph: Graph, archive: str | None = None) -> Wiring:
    """Return the wiring of a graph.

    Parameters
    ----------
    graph : Graph
    archive : str, optional
        Folder of recordings; by default that of the graph's record node.
    """
    nodes: dict[str, list[str]] = {}
    for name, node in graph.nodes.items():
        sent = [of for topic, of in node.outputs() if topic != "reference"]
        for camera in dict.fromkeys([*node.feeds, *sent]):
            nodes.setdefault(f"{graph.site}/{camera}", []).append(name)
    nodes_of = list(graph.nodes.values())
    every = [stream for node in nodes_of for stream in node.outputs()]
    folders = [archive, *(getattr(node, "archive", None) for node in nodes_of)]
    folder = next(filter(None, folders), None)
    return Wiring(
        nodes,
        frozenset(f"{graph.site}/{camera}" for topic, camera in every if topic == "live"),
        tuple(f"{graph.site}/{of}" for n in nodes_of if n.uses_ring for of in n.feeds),
        Path(folder) if folder else None,
        {
            f"{graph.site}/{camera}": start_utc_ns
            for node in nodes_of
            for camera in node.feeds
            if (start_utc_ns := getattr(node, "start_utc_ns", 0))
        },
    )


MCAP_END = b"\x89MCAP0\r\n"
LEAD_S = 10.0  # replay starts this long before the alarm
AROUND_NS = 60 * NS_PER_S  # the recording of an alarm starts within this time of it
MOST = 8


def files_about(archive: Path, raised: Raised) -> list[dict[str, Any]]:
    """List the files that contain an alarm, for JSON; those recorded for alarms come first.

    Parameters
    ----------
    archive : Path
        Folder of the archive.
    raised : Raised
    """
    of_feed = [file for file in archived_files(archive) if str(file.camera) == raised.feed]
    kept = [f for f in of_feed if f.of_alarm and abs(f.start_ns - raised.start_ns) < AROUND_NS]
    running = _covering([f for f in of_feed if not f.of_alarm], raised)
    return [_file_plain(archive, file, raised) for file in [*kept, *running][:MOST]]


def file_named(archive: Path, name: str) -> Path | None:
    """Return the archive's file with a relative path; None for any other path.

    A link that leads out of the archive is none of its files.
    """
    paths = (file.path for file in archived_files(archive))
    path = next((path for path in paths if path.relative_to(archive).as_posix() == name), None)
    return path if path and path.resolve().is_relative_to(archive.resolve()) else None


def _covering(files: list[ArchivedFile], raised: Raised) -> list[ArchivedFile]:
    """Return the files that overlap with an alarm. Each file lasts until the next one starts."""
    ends_ns = [file.start_ns for file in files[1:]]
    ends_ns += [_written_ns(file.path) for file in files[-1:]]
    return [
        file
        for file, end_ns in zip(files, ends_ns, strict=True)
        if file.start_ns <= raised.end_ns and end_ns >= raised.start_ns
    ]


def _written_ns(path: Path) -> int:
    try:
        return path.stat().st_mtime_ns
    except FileNotFoundError:  # deleted by retention meanwhile
        return 0


def _file_plain(archive: Path, file: ArchivedFile, raised: Raised) -> dict[str, Any]:
    start_s = 0.0
    if not file.of_alarm:  # a file of an alarm starts shortly before it anyway
        start_s = max(0.0, (raised.start_ns - file.start_ns) / NS_PER_S - LEAD_S)
    from_there = f" --start-s {start_s:.0f}" if start_s >= 1 else ""
    size_bytes, is_whole = state_of(file.path)
    return {
        "name": file.path.name,
        "url": "recordings/" + file.path.relative_to(archive).as_posix(),
        "size_mb": round(size_bytes / 1e6, 1),
        "is_whole": is_whole,
        "of_alarm": file.of_alarm,
        "replay": f"rsenf replay {shlex.quote(str(file.path))}{from_there}",
    }


def state_of(path: Path) -> tuple[int, bool]:
    """Return the size of a recording in bytes, and whether it has been closed."""
    try:
        with path.open("rb") as file:
            size_bytes = file.seek(0, 2)
            file.seek(-min(len(MCAP_END), size_bytes), 2)
            return size_bytes, file.read() == MCAP_END
    except FileNotFoundError:
        return 0, False


KEPT_NODES = 256
LAST_WORDS = ("done", "failed", "lost")


class NodeBoard:
    """The latest health message of each node."""

    def __init__(self) -> None:
        self._latest: dict[str, Health] = {}
        self._heard_ns: dict[str, int] = {}  # local clock: another host's may be wrong

    def update(self, message: Health, now_ns: int) -> None:
        """Take a health message that arrived at ``now_ns``."""
        if message.node in self._latest or len(self._latest) < KEPT_NODES:
            self._latest[message.node], self._heard_ns[message.node] = message, now_ns

    def state(self, name: str, now_ns: int) -> str:
        """Return a node's state; 'silent' if its health message is overdue, '' if it is unknown."""
        health = self._latest.get(name)
        if health is None:
            return ""
        is_late = now_ns - self._heard_ns[name] > SILENT_S * NS_PER_S
        return "silent" if is_late and health.state not in LAST_WORDS else health.state

    def plain(self, now_ns: int) -> list[dict[str, Any]]:
        """Return all nodes for JSON."""
        return [
            {
                "name": name,
                "kind": health.kind,
                "state": self.state(name, now_ns),
                "detail": redact(health.detail),
                "host": health.host,
                "rate_hz": rounded(health.rate_hz, 1),
                "latency_s": rounded(health.latency_s, 2) if health.last_input_ns else None,
                "dropped": health.dropped,
                "missed": health.missed,
                "rejected": health.rejected,
                "queue": health.queue_depth,
                "memory_mb": rounded(health.memory_bytes / 1e6, 0),
                "cpu_s": rounded(health.cpu_s, 0),
                "restarts": health.restarts,
                "heard_ms": in_ms(self._heard_ns[name]),
                "lost_peers": list(health.lost_peers),
            }
            for name, health in sorted(self._latest.items())
        ]


KEPT_FEEDS = 64


class Site:
    """The state of all feeds and nodes.

    Parameters
    ----------
    wiring : Wiring
        Contents of the graph file.
    clock_ns : callable
        Wall clock, UTC since 1970, in ns.
    """

    def __init__(self, wiring: Wiring, clock_ns: Callable[[], int]) -> None:
        self.wiring, self.clock_ns = wiring, clock_ns
        self.lock = threading.RLock()
        self.alarms, self.nodes = AlarmBoard(AlarmLog(wiring.archive)), NodeBoard()
        self._references = References()
        self._feeds: dict[str, Feed] = {}
        self.feeds_left_out = 0
        for name in wiring.nodes:
            self._feed(name)

    def __enter__(self) -> Site:
        return self

    def __exit__(self, *error: object) -> None:
        with self.lock:
            self.alarms.log.catch_up()
        for feed in self._feeds.values():
            feed.close()

    def update(self, key: str, message: Any) -> None:
        """Take a message from the bus."""
        with self.lock:
            if isinstance(message, Health):
                self.nodes.update(message, self.clock_ns())
            elif isinstance(message, ReferenceBlock):
                self._references.add(message)
            elif topic_of(key) != "health" and (feed := self._feed(source_of(key))):
                if isinstance(message, Alarm):
                    self.alarms.update(
                        feed.name, message, lambda: feed.timeline.log_time_ns(Alarm, message.header)
                    )
                else:
                    feed.update(message)
                    if isinstance(message, Liveness) and message.verdict == "live":
                        self.alarms.is_live(feed.name, message.header)

    def _feed(self, name: str) -> Feed | None:
        if name not in self._feeds:
            if len(self._feeds) >= KEPT_FEEDS:
                self.feeds_left_out += 1
                return None
            claimed_ns = self.wiring.claimed_ns.get(name, 0)
            self._feeds[name] = Feed(name, self._references, self.clock_ns, claimed_ns)
        return self._feeds[name]

    def feed(self, name: str) -> Feed | None:
        """Return a feed by name; None if unknown."""
        return self._feeds.get(name)

    @property
    def feed_names(self) -> list[str]:
        """Feeds in the order of the graph file, then of arrival."""
        return list(self._feeds)

    def card(self, name: str) -> dict[str, Any]:
        """Return the summary of a feed, for JSON."""
        now_ns, known = self.clock_ns(), self.wiring.judged
        states = {n: self.nodes.state(n, now_ns) for n in self.wiring.nodes.get(name, [])}
        return {
            **self._feeds[name].card(),
            "is_judged": None if known is None else name in known,
            "nodes": states,
            "alarms": self.alarms.active(name),
        }

    def alarm(self, number: int) -> Raised | None:
        """Return an alarm by its number."""
        with self.lock:
            return self.alarms[number]

    def acknowledge(self, number: int, by: str, note: str) -> bool:
        """Note who has seen an alarm; return whether there is such an alarm.

        Parameters
        ----------
        number : int
            Of the alarm.
        by, note : str
            Name and remark.

        Raises
        ------
        OSError
            When it can't be kept.
        """
        with self.lock:
            return self.alarms.acknowledge(number, by, note, self.clock_ns())

    def picture(self, name: str) -> bytes:
        """Return a feed's newest picture as JPEG; empty for none."""
        with self.lock:
            feed = self._feeds.get(name)
            return feed.preview.jpeg if feed else b""

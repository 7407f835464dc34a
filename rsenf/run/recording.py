"""What a recording says of its run, and when it has everything."""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import yaml

from rsenf.bus.delivery import LOOKING, Delivery
from rsenf.bus.inbox import Inbox, Received
from rsenf.bus.keys import ROOT, health_key, matches, topic_key
from rsenf.config import shown
from rsenf.config.graph import Graph
from rsenf.config.recording import RecordSettings
from rsenf.errors import InputError
from rsenf.messages import Header
from rsenf.record.archive import ArchiveRecorder
from rsenf.record.disk import DiskGuard
from rsenf.record.provenance import input_facts
from rsenf.record.writer import Recorder
from rsenf.run.node import NodeProcess
from rsenf.run.pump import POLL_S

# Recording waits for the disk, and its senders wait for it.
DELIVERY = Delivery(lossless=True, queue=512, history=600)
# How long a recording that is told to stop waits for streams to end; and for a sender that is gone.
STOP_LINGER_S = 0.5
GONE_LINGER_S = 1.0
HASH_POLL_S = 0.05
# Nobody waits for what is written: to be woken by every message takes longer than to write it.
LULL_S = 0.05


def run_info(node: NodeProcess) -> dict[str, str]:
    """Run, site and graph, as they go into the recording. Secrets are hidden."""
    config = yaml.safe_dump(shown(node.graph), sort_keys=False, allow_unicode=True, width=1000)
    return {"run_id": node.run_id, "site": node.graph.site, "config": config}


class InputHashes:
    """Hashes the files that a graph reads, beside the recording.

    Parameters
    ----------
    graph : Graph
        The graph.
    """

    def __init__(self, graph: Graph) -> None:
        named = {n: getattr(c, "input", None) for n, c in graph.nodes.items()}
        self._paths = {n: Path(i) for n, i in named.items() if isinstance(i, str)}
        self._facts: dict[str, dict[str, str]] = {}
        self._thread = threading.Thread(target=self._hash, name="hashes", daemon=True)
        self._thread.start()

    def _hash(self) -> None:
        for node, path in self._paths.items():
            if path.is_file():
                try:
                    self._facts[node] = input_facts(path)
                except InputError as exc:
                    self._facts[node] = {"input": path.name, "input_sha256": "", "why": str(exc)}

    def facts(self, stop: threading.Event) -> dict[str, dict[str, str]]:
        """Wait for the hashes, unless told to stop; returns what is known of each node's input."""
        while self._thread.is_alive() and not stop.is_set():
            self._thread.join(HASH_POLL_S)
        why = "the recording was stopped before its hash was known"
        return {
            node: self._facts.get(node, {"input": path.name, "input_sha256": "", "why": why})
            for node, path in self._paths.items()
            if path.is_file()
        }


class Ending:
    """Knows which streams are still open: those of the graph's own nodes, until their END mark.

    A node that is gone without an END mark is not waited for.

    Parameters
    ----------
    node : NodeProcess
        The recording node.
    key_exprs : list of str
        What it records.
    """

    def __init__(self, node: NodeProcess, key_exprs: list[str]) -> None:
        self._node = node
        self._open: dict[str, str] = {}  # who sends each stream
        self._heard: dict[str, float] = {}
        self._stop_by = float("inf")
        site = node.graph.site
        for name, config in node.graph.nodes.items():
            for topic, of in config.outputs():
                key = topic_key(site, of, topic)
                if any(matches(expr, key) for expr in key_exprs):
                    self._open[key] = name
        # What only others send has no end that could be known.
        self._endless = not self._open

    def note(self, key: str, header: Header) -> None:
        """Take in a message that was recorded."""
        self._heard[key] = time.monotonic()
        if header.is_end:
            self._open.pop(key, None)

    def reached(self) -> bool:
        """Whether there is nothing more to wait for."""
        now, node = time.monotonic(), self._node
        for key, name in list(self._open.items()):
            quiet_s = now - self._heard.setdefault(key, now)
            if quiet_s > GONE_LINGER_S and node.peers.gone_for_s(name) > GONE_LINGER_S:
                del self._open[key]
        if node.stop.is_set():
            self._stop_by = min(self._stop_by, now + STOP_LINGER_S)
            return now > self._stop_by or (not self._open and node.inbox.depth == 0)
        return not self._open and not self._endless and node.inbox.depth == 0


def look_until_ended(
    node: NodeProcess,
    topics: Sequence[str],
    take: Callable[[Received], None],
    ready: str,
    more: Sequence[str] = (),
) -> None:
    """Show what is on the bus until every stream of the graph has ended, or until told to stop.

    Parameters
    ----------
    node : NodeProcess
    topics : sequence of str
        Key expressions below the site.
    take : callable
        Given each message, and the health of the nodes. Nobody waits for it.
    ready : str
        What the node says once it listens.
    more : sequence of str, optional
        Whole keys to listen to beside, whose ends don't count.
    """
    key_exprs = [f"{ROOT}/{node.graph.site}/{below}" for below in topics]
    for key_expr in (*key_exprs, *more, health_key(node.graph.site, "*")):
        node.subscribe(key_expr, LOOKING)
    ending = Ending(node, key_exprs)
    node.ready()
    node.say("running", ready)
    while not ending.reached():
        received = node.inbox.receive(POLL_S)
        if received is not None:
            node.note_input(received.message.header)
            take(received)
            ending.note(received.key, received.message.header)


def of_run(config: RecordSettings, restarts: int) -> RecordSettings:
    """Return what a recorder that was started again writes to: a new file beside the one it left.

    What an earlier run left there is kept, too.

    Parameters
    ----------
    config : RecordSettings
        What it was told.
    restarts : int
        Times it was started before in this run.
    """
    if config.out is None or not restarts:
        return config
    path = Path(config.out)
    beside = (path.with_suffix(f".{n}{path.suffix}") for n in itertools.count(restarts))
    return config.model_copy(update={"out": str(next(p for p in beside if not p.exists()))})


def open_sink(
    config: RecordSettings, info: dict[str, str], warn: Callable[[str], None]
) -> Recorder | ArchiveRecorder:
    """Open what a node records to: a file, or an archive, which warns of what stops nothing.

    Raises
    ------
    UsageError, RecordingError
        When it can't be.
    """
    if config.archive is None:
        return Recorder(
            str(config.out),
            run_info=info,
            clock_ns=time.time_ns,
            flush_every_s=config.flush_every_s,
            compress=config.compress,
            overwrite=config.overwrite,
        )
    return ArchiveRecorder(
        config.archive,
        run_info=info,
        clock_ns=time.time_ns,
        rotation=config.rotation,
        retention=config.retention,
        alarms=config.alarms,
        disk=config.disk,
        warn=warn,
        flush_every_s=config.flush_every_s,
        compress=config.compress,
    )


def disk_guard(config: RecordSettings, warn: Callable[[str], None]) -> DiskGuard:
    """Look after the disk that an open sink is on."""
    folder = Path(config.archive) if config.archive else Path(str(config.out)).absolute().parent
    return DiskGuard(folder, config.disk, warn)


def record_until(
    sink: Recorder | ArchiveRecorder,
    inbox: Inbox,
    ended: Callable[[], bool],
    guard: DiskGuard,
    on_message: Callable[[Received], None] = lambda received: None,
) -> None:
    """Write what an inbox receives until ``ended()`` says so.

    Parameters
    ----------
    sink : Recorder or ArchiveRecorder
        The open recording.
    inbox : Inbox
        Where messages arrive.
    ended : callable
        Asked between messages.
    guard : DiskGuard
        Looks after the disk.
    on_message : callable, optional
        Called after each message was written.

    Raises
    ------
    RecordingError
        When the recording can't be written, or the disk is nearly full.
    """
    while not ended():
        received = inbox.receive(0.0)
        if received is None:
            time.sleep(LULL_S)
        else:
            header = received.message.header
            sink.write_encoded(received.key, type(received.message), received.payload, header)
            on_message(received)
        guard.check()
        sink.tick()

"""The loop of a recording node: metadata of the run, input hashes, and the end of its streams.

An archive keeps the minutes around alarms: those that come as messages, or as SIGUSR1.
"""

from __future__ import annotations

import itertools
import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

import yaml

from rsenf.bus.inbox import Inbox, Received
from rsenf.bus.keys import LOOKING, ROOT, Delivery, health_key, matches, topic_key
from rsenf.config import shown
from rsenf.config.graph import Graph
from rsenf.config.schemas import RecordSettings
from rsenf.errors import InputError
from rsenf.messages import Header, Mark
from rsenf.record.archive import ArchiveRecorder
from rsenf.record.limits import DiskGuard
from rsenf.record.provenance import input_facts
from rsenf.record.writer import Recorder, continuity_after
from rsenf.run.node import NodeProcess
from rsenf.run.pump import POLL_S


class AlarmWatch:
    """Reports alarms to an archive. A single-file recording keeps everything, so it needs none.

    Parameters
    ----------
    sink : Recorder or ArchiveRecorder
        The open recording.
    key_exprs : list of str
        Messages of these keys are alarms, unless their ``active`` is false.
    """

    def __init__(self, sink: Recorder | ArchiveRecorder, key_exprs: list[str]) -> None:
        self._archive = sink if isinstance(sink, ArchiveRecorder) else None
        self._key_exprs = key_exprs
        self._is_trigger: dict[str, bool] = {}
        self._asked = False

    def note(self, received: Received) -> None:
        """Check a recorded message; raise the alarm if it triggers one."""
        key, message = received.key, received.message
        if key not in self._is_trigger:
            self._is_trigger[key] = any(matches(expr, key) for expr in self._key_exprs)
        alarming = message.header.mark == Mark.DATA and getattr(message, "active", True)
        if self._archive and self._is_trigger[key] and alarming:
            self._archive.alarm(key, " ".join(filter(None, (key, getattr(message, "text", "")))))

    def check(self) -> None:
        """Raise the alarm that a signal has requested since the last call."""
        if self._archive and self._asked:
            self._asked = False
            self._archive.alarm(None, "SIGUSR1")

    @contextmanager
    def on_signal(self) -> Iterator[None]:
        """Make SIGUSR1 an alarm of all cameras. Does nothing outside the main thread."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return

        def ask(_number: int, _frame: object) -> None:
            self._asked = True

        before = signal.signal(signal.SIGUSR1, ask)
        try:
            yield
        finally:
            signal.signal(signal.SIGUSR1, before)


def alarm_keys(config: RecordSettings, site: str) -> list[str]:
    """Return the key expressions of the alarms that a recording of a site heeds."""
    return [f"{ROOT}/{site}/{config.alarms.trigger}"] if config.archive else []


# A slow disk exerts backpressure on the senders.
DELIVERY = Delivery(lossless=True, queue=512, history=600)
# How long to wait for streams to end when told to stop, and for the END mark of a sender that left.
STOP_LINGER_S = 0.5
GONE_LINGER_S = 1.0
HASH_POLL_S = 0.05
# Pause when the inbox is empty: waking up for every message costs more than writing it.
LULL_S = 0.05


def run_info(node: NodeProcess) -> dict[str, str]:
    """Return run id, site and graph for the recording's metadata, with credentials redacted."""
    config = yaml.safe_dump(shown(node.graph), sort_keys=False, allow_unicode=True, width=1000)
    return {"run_id": node.run_id, "site": node.graph.site, "config": config}


class InputHashes:
    """Hashes the input files of a graph in a thread, while the recording runs.

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
        """Wait for the hashes until stopped; return metadata of each node's input file."""
        while self._thread.is_alive() and not stop.is_set():
            self._thread.join(HASH_POLL_S)
        why = "the recording was stopped before its hash was known"
        return {
            node: self._facts.get(node, {"input": path.name, "input_sha256": "", "why": why})
            for node, path in self._paths.items()
            if path.is_file()
        }


class Ending:
    """Tells when all recorded streams of the graph have ended, by their END marks.

    A stream whose node is gone without an END mark counts as ended.

    Parameters
    ----------
    node : NodeProcess
        The recording node.
    key_exprs : list of str
        Key expressions that it records.
    """

    def __init__(self, node: NodeProcess, key_exprs: list[str]) -> None:
        self._node, self._key_exprs = node, key_exprs
        self._graph = node.graph
        self._open = self._streams()  # sending node of each open stream
        self._heard: dict[str, float] = {}
        self._stop_by = float("inf")
        # Nothing is sent by this graph: the end of streams from outside can't be known.
        self._endless = not self._open

    def _streams(self) -> dict[str, str]:
        """Return the sender of each stream that is recorded; of all, if none of them is."""
        sent = {
            topic_key(self._graph.site, of, topic): name
            for name, config in self._graph.nodes.items()
            for topic, of in config.outputs()
        }
        return {k: n for k, n in sent.items() if self._is_recorded(k)} or sent

    def _is_recorded(self, key: str) -> bool:
        return any(matches(expr, key) for expr in self._key_exprs)

    def _follow_graph(self) -> None:
        """Expect the streams of another graph, once it has been exchanged."""
        before, self._graph = self._streams(), self._node.graph
        now = self._streams()
        self._open = {k: n for k, n in now.items() if k in self._open or before.get(k) != n}

    def note(self, key: str, header: Header) -> None:
        """Note a recorded message."""
        self._heard[key] = time.monotonic()
        if header.is_end:
            self._open.pop(key, None)

    def reached(self) -> bool:
        """Whether nothing more is to be expected."""
        now, node = time.monotonic(), self._node
        if node.graph is not self._graph:
            self._follow_graph()
        for key, name in list(self._open.items()):
            quiet_s = now - self._heard.setdefault(key, now)
            if quiet_s > GONE_LINGER_S and node.peers.gone_for_s(name) > GONE_LINGER_S:
                del self._open[key]
                if node.restarts and node.config.records and self._is_recorded(key):
                    node.note_cut_off(key)
        if node.stop.is_set():
            self._stop_by = min(self._stop_by, now + STOP_LINGER_S)
            is_open = any(map(self._is_recorded, self._open))
            return now > self._stop_by or not (is_open or node.inbox.depth)
        return not self._open and not self._endless and node.inbox.depth == 0


def look_until_ended(
    node: NodeProcess,
    topics: Sequence[str],
    take: Callable[[Received], None],
    ready: str,
    more: Sequence[str] = (),
    delivery: Delivery = LOOKING,
) -> None:
    """Observe the bus until every stream of the graph has ended, or until told to stop.

    Parameters
    ----------
    node : NodeProcess
    topics : sequence of str
        Key expressions below the site.
    take : callable
        Called with each message, and with the health of the nodes.
    ready : str
        Health detail of the node once it listens.
    more : sequence of str, optional
        Further full keys to subscribe to, whose ends don't count.
    delivery : Delivery, optional
    """
    key_exprs = [f"{ROOT}/{node.graph.site}/{below}" for below in topics]
    for key_expr in (*key_exprs, *more, health_key(node.graph.site, "*")):
        node.subscribe(key_expr, delivery)
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
    """Return the settings of a restarted recorder: a new file beside the one it left.

    Files of earlier runs are kept as well.

    Parameters
    ----------
    config : RecordSettings
        Settings of the first start.
    restarts : int
        Number of earlier starts in this run.
    """
    if config.out is None or not restarts:
        return config
    beside = itertools.islice(_files(Path(config.out)), restarts, None)
    return config.model_copy(update={"out": str(next(p for p in beside if not p.exists()))})


def _files(path: Path) -> Iterator[Path]:
    """Yield the files of a recorder: the first, and without end those of its restarts."""
    yield path
    yield from (path.with_suffix(f".{n}{path.suffix}") for n in itertools.count(1))


def open_sink(
    config: RecordSettings, info: Mapping[str, str], warn: Callable[[str], None], restarts: int = 0
) -> Recorder | ArchiveRecorder:
    """Open the output of a recording node: a file, or an archive.

    Parameters
    ----------
    config : RecordSettings
        Settings of the first start.
    info : mapping
        Metadata of the run.
    warn : callable
        Called with warnings of an archive that don't end the recording.
    restarts : int
        Number of earlier starts in this run. What these have recorded is sent again as far as it is
        kept, and is not recorded again.

    Raises
    ------
    UsageError, RecordingError
        When it can't be opened.
    """
    if config.archive is None:
        out = of_run(config, restarts).out
        before = itertools.takewhile(lambda path: str(path) != out, _files(Path(str(config.out))))
        return Recorder(
            str(out),
            run_info=info,
            clock_ns=time.time_ns,
            flush_every_s=config.flush_every_s,
            compress=config.compress,
            overwrite=config.overwrite,
            continuity=continuity_after(before if restarts else (), time.time_ns),
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
        resumed=restarts > 0,
    )


def disk_guard(config: RecordSettings, warn: Callable[[str], None]) -> DiskGuard:
    """Return the guard of free space on the disk that a recording is written to."""
    folder = Path(config.archive) if config.archive else Path(str(config.out)).absolute().parent
    return DiskGuard(folder, config.disk, warn)


def record_until(
    sink: Recorder | ArchiveRecorder,
    inbox: Inbox,
    ended: Callable[[], bool],
    guard: DiskGuard,
    on_message: Callable[[Received], None] = lambda received: None,
) -> None:
    """Write what an inbox receives until ``ended()`` is true.

    Parameters
    ----------
    sink : Recorder or ArchiveRecorder
        The open recording.
    inbox : Inbox
    ended : callable
        Called between messages, every ``LULL_S``.
    guard : DiskGuard
        Checks the free space.
    on_message : callable, optional
        Called after each message was written.

    Raises
    ------
    RecordingError
        When the recording can't be written, or the disk is nearly full.
    """
    checked_s = 0.0
    while True:
        received = inbox.receive(0.0)
        if received is not None:
            header = received.message.header
            sink.write_encoded(received.key, type(received.message), received.payload, header)
            on_message(received)
        if received is None or time.monotonic() - checked_s >= LULL_S:
            if ended():
                return
            guard.check()
            sink.tick()
            if received is None:
                time.sleep(LULL_S)
            checked_s = time.monotonic()


def record_backlog(
    sink: Recorder | ArchiveRecorder,
    inbox: Inbox,
    guard: DiskGuard,
    on_message: Callable[[Received], None],
) -> None:
    """Write and flush what waits in an inbox.

    To be called before a restarted recorder says that it is back: senders that have ended wait for
    this, and then leave with what they have kept for it. Takes what :func:`record_until` does.
    """
    received, waiting = inbox.counters.received, inbox.depth

    def written() -> bool:
        return not inbox.depth or inbox.counters.received - received >= waiting

    record_until(sink, inbox, written, guard, on_message)
    sink.flush()

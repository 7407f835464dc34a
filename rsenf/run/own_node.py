"""Runs an external node written in Python: bus, health, signals and shutdown are taken care of.

The environment tells it the bus and its name, as set by ``kind: external`` in a graph and by
``rsenf contract``. ``rsenf new-node`` writes an example, :mod:`rsenf.run.node_template`.

Also the conformance test of any node's program: it runs alone, on a private bus, against the
contract.
"""

from __future__ import annotations

import os
import secrets
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import NoReturn

from rsenf.bus.inbox import Inbox, Received
from rsenf.bus.keys import LOOKING, ROOT, TOPICS, alive_key, delivery_of, health_key, topic_of
from rsenf.bus.sequence import Envelope
from rsenf.bus.zenoh_bus import BusSettings, ZenohBus, free_endpoint, open_bus
from rsenf.config import Graph
from rsenf.errors import EXIT_FAILED, RsenfError, UsageError
from rsenf.messages import Header, Health, encode, encoding_of
from rsenf.run.heartbeat import PIPE, inherited_pipe
from rsenf.run.log import complain
from rsenf.run.node import NodeProcess, install_signals
from rsenf.run.process import end_process, wait_until


def run_own_node(body: Callable[[NodeProcess], None]) -> NoReturn:
    """Run an external node until its body returns, and end the process.

    Parameters
    ----------
    body : callable
        Opens the node's streams, calls ``node.ready()``, and loops until ``node.stop`` is set.
    """
    code = EXIT_FAILED
    try:
        code = _run(body)
    except RsenfError as exc:
        complain(f"rsenf: {exc}", str(exc), node=os.environ.get("RSENF_NODE", ""))
        code = exc.exit_code
    finally:
        end_process(code)


def _run(body: Callable[[NodeProcess], None]) -> int:
    environ = os.environ
    if "RSENF_CONNECT" not in environ:
        raise UsageError("which bus? RSENF_CONNECT isn't set", "'rsenf run' tells its endpoint")
    name = environ.get("RSENF_NODE", "own")
    config = {
        "kind": "external",
        "command": sys.argv,
        "reads": environ.get("RSENF_READS", "").split(),
        "sends": environ.get("RSENF_SENDS", "").split(),
    }
    graph = Graph.model_validate(
        {"version": 1, "site": environ.get("RSENF_SITE", "own"), "nodes": {name: config}}
    )
    run_id = environ.get("RSENF_RUN_ID") or secrets.token_hex(4)
    restarts = int(environ.get("RSENF_RESTARTS", "0"))
    with open_bus(BusSettings(connect=(environ["RSENF_CONNECT"],))) as bus:
        node = NodeProcess(graph, name, run_id, bus, restarts)
        install_signals(node)
        # Started by a graph, it ends with its parent process; started by hand, it doesn't.
        parent = os.getppid() if "RSENF_NODE" in environ else 0
        with node.beating(parent, inherited_pipe(environ.get(PIPE, ""))), node.reporting():
            return node.live(body)


SITE, NODE, RUN = "contract", "node", "c0ffee00"
# Time limits on an idle machine; a slower machine gets proportionally more.
READY_S = 15.0
STOP_S = 2.0
TWO_WORDS_S = 4.0  # for two health messages; a node sends one a second
SAMPLES = 20


@dataclass(frozen=True)
class Check:
    """One point of the contract."""

    name: str
    passed: bool
    detail: str = ""


@dataclass
class HeardNode:
    """What the program has sent: its token, health messages (``words``) and all others."""

    alive: bool = False
    words: list[Health] = field(default_factory=list)
    sent: list[Received] = field(default_factory=list)

    def on_alive(self, _key: str, alive: bool) -> None:
        """Note that its liveliness token appeared or vanished."""
        self.alive = alive

    def take(self, inbox: Inbox) -> None:
        """Empty the inbox."""
        while received := inbox.receive(0):
            if isinstance(received.message, Health):
                self.words.append(received.message)
            else:
                self.sent.append(received)


def check_contract(
    command: Sequence[str], reads: Sequence[str], sends: Sequence[str]
) -> list[Check]:
    """Start a program, send it valid and invalid messages, stop it; return the results.

    Parameters
    ----------
    command : sequence of str
        Program and arguments.
    reads, sends : sequence of str
        Topics that it reads and sends, below the site, such as ``cam/track``.

    Returns
    -------
    list of Check
        One for each point of the contract, in order.

    Raises
    ------
    UsageError
        When the program can't be started.
    """
    endpoint = free_endpoint()
    with open_bus(BusSettings(mode="router", listen=(endpoint,))) as bus:
        inbox, heard = Inbox(), HeardNode()
        bus.watch_alive(alive_key(SITE, NODE), heard.on_alive)
        for key in (health_key(SITE, NODE), *(f"{ROOT}/{SITE}/{topic}" for topic in sends)):
            bus.subscribe(inbox, key, LOOKING)
        with _running(command, endpoint, reads, sends) as process:
            return list(_checks(bus, process, inbox, heard, reads))


def _checks(
    bus: ZenohBus,
    process: subprocess.Popen[bytes],
    inbox: Inbox,
    heard: HeardNode,
    reads: Sequence[str],
) -> Iterator[Check]:
    def ended() -> bool:
        return process.poll() is not None

    def said(state: str) -> bool:
        heard.take(inbox)
        return any(word.state == state for word in heard.words)

    def wait(reached: Callable[[], bool], limit_s: float) -> bool:
        return wait_until(lambda: reached() or ended(), limit_s) and reached()

    def speaks() -> bool:
        due = len(heard.words) + 2
        return wait(lambda: said("running") and len(heard.words) >= due, TWO_WORDS_S)

    yield Check("shows its liveliness token", wait(lambda: heard.alive, READY_S))
    yield Check("says by its health that it runs", wait(lambda: said("running"), TWO_WORDS_S))
    yield Check("says so every second", speaks())
    for topic in reads:
        _feed(bus, f"{ROOT}/{SITE}/{topic}")
    speaks()
    yield Check("lives through broken, foreign and oversized messages", not ended())
    begun_s = time.monotonic()
    process.send_signal(signal.SIGTERM)
    code = process.poll() if wait_until(ended, STOP_S) else None
    took = f"exit code {code} after {time.monotonic() - begun_s:.1f} s"
    yield Check("stops within 2 s of SIGTERM, with exit code 0", code == 0, took)
    wait_until(lambda: said("done"), TWO_WORDS_S)
    last = heard.words[-1].state if heard.words else "nothing"
    yield Check("its last word is 'done'", last == "done", f"it was {last!r}")
    missed, rejected = inbox.counters.missed, inbox.counters.rejected
    yield Check("all it sends can be read", not rejected, f"{rejected} can't")
    yield Check("numbers what it sends without a gap", not missed, f"{missed} are missing")


def _feed(bus: ZenohBus, key: str) -> None:
    """Send valid messages with invalid ones between them."""
    topic = topic_of(key)
    cls = TOPICS[topic]
    publisher = bus.publisher(key, delivery_of(topic))
    right = encoding_of(cls)
    good = cls(header=Header(run_id=RUN, source=f"{SITE}/cam"))
    bad = ((right, b"\xff" * 40), (right + "9", encode(good)), ("text/plain", b"hello"),
           (right, b""), (right, bytes(8_000_000)))  # fmt: skip
    for seq in range(SAMPLES):
        publisher.send(cls(header=good.header.numbered(seq)))
        encoding, payload = bad[seq % len(bad)]
        publisher._put(Envelope(key, encoding, payload, "stranger"))


@contextmanager
def _running(
    command: Sequence[str], endpoint: str, reads: Sequence[str], sends: Sequence[str]
) -> Iterator[subprocess.Popen[bytes]]:
    variables = {
        "RSENF_CONNECT": endpoint, "RSENF_SITE": SITE, "RSENF_NODE": NODE, "RSENF_RUN_ID": RUN,
        "RSENF_RESTARTS": "0", "RSENF_READS": " ".join(reads), "RSENF_SENDS": " ".join(sends),
    }  # fmt: skip
    try:
        process = subprocess.Popen(
            command, env={**os.environ, **variables}, stdin=subprocess.DEVNULL
        )
    except OSError as exc:
        raise UsageError(f"{command[0]} can't be started: {exc.strerror}") from exc
    try:
        yield process
    finally:
        process.kill()
        process.wait()

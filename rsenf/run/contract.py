"""Checks that a program keeps to the contract of nodes: run alone on a bus of its own."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field

from rsenf.bus.delivery import LOOKING, delivery_of
from rsenf.bus.inbox import Inbox, Received
from rsenf.bus.keys import ROOT, TOPICS, alive_key, health_key, topic_of
from rsenf.bus.sequence import Envelope
from rsenf.bus.zenoh_bus import BusSettings, ZenohBus, open_bus
from rsenf.errors import UsageError
from rsenf.messages import Header, Health, encode, encoding_of
from rsenf.run.supervisor import free_endpoint

SITE, NODE, RUN = "contract", "node", "c0ffee00"
STOP_S = 2.0
SAMPLES = 20


@dataclass(frozen=True)
class Check:
    """One point of the contract."""

    name: str
    passed: bool
    detail: str = ""


@dataclass
class Heard:
    """What the program has said."""

    alive: bool = False
    words: list[Health] = field(default_factory=list)
    sent: list[Received] = field(default_factory=list)

    def on_alive(self, _key: str, alive: bool) -> None:
        """Take in its token."""
        self.alive = alive

    def take(self, inbox: Inbox) -> None:
        """Take in what came."""
        while received := inbox.receive(0):
            if isinstance(received.message, Health):
                self.words.append(received.message)
            else:
                self.sent.append(received)


def check_contract(
    command: Sequence[str], reads: Sequence[str], sends: Sequence[str], ready_s: float = 15.0
) -> list[Check]:
    """Start a program, feed it good and bad messages, stop it; return what it kept to.

    Parameters
    ----------
    command : sequence of str
        Program and arguments.
    reads, sends : sequence of str
        Its topics below the site, such as ``cam/track``.
    ready_s : float
        How long it may take until its token is there.

    Raises
    ------
    UsageError
        When it can't be started.
    """
    endpoint = free_endpoint()
    with open_bus(BusSettings(mode="router", listen=(endpoint,))) as bus:
        inbox, heard = Inbox(), Heard()
        bus.watch_alive(alive_key(SITE, NODE), heard.on_alive)
        for key in (health_key(SITE, NODE), *(f"{ROOT}/{SITE}/{topic}" for topic in sends)):
            bus.subscribe(inbox, key, LOOKING)
        with _running(command, endpoint, reads, sends) as process:
            return list(_checks(bus, process, inbox, heard, reads, ready_s))


def _checks(
    bus: ZenohBus,
    process: subprocess.Popen[bytes],
    inbox: Inbox,
    heard: Heard,
    reads: Sequence[str],
    ready_s: float,
) -> Iterator[Check]:
    def wait(reached: Callable[[], bool], timeout_s: float) -> bool:
        deadline = time.monotonic() + timeout_s
        while not reached() and time.monotonic() < deadline and process.poll() is None:
            heard.take(inbox)
            time.sleep(0.02)
        return reached()

    yield Check("shows its liveliness token", wait(lambda: heard.alive, ready_s))
    yield Check("says by its health that it runs", wait(lambda: _says(heard, "running"), 3.0))
    before = len(heard.words)
    yield Check("says so every second", wait(lambda: len(heard.words) >= before + 2, 4.0))
    for topic in reads:
        _feed(bus, f"{ROOT}/{SITE}/{topic}")
    time.sleep(1.0)
    yield Check("lives through broken, foreign and oversized messages", process.poll() is None)
    begun_s = time.monotonic()
    process.send_signal(signal.SIGTERM)
    try:
        code: int | None = process.wait(STOP_S)
    except subprocess.TimeoutExpired:
        code = None
    took = f"exit code {code} after {time.monotonic() - begun_s:.1f} s"
    yield Check("stops within 2 s of SIGTERM, with exit code 0", code == 0, took)
    time.sleep(0.2)
    heard.take(inbox)
    last = heard.words[-1].state if heard.words else "nothing"
    yield Check("its last word is 'done'", last == "done", f"it was {last!r}")
    missed, rejected = inbox.counters.missed, inbox.counters.rejected
    yield Check("all it sends can be read", not rejected, f"{rejected} can't")
    yield Check("numbers what it sends without a gap", not missed, f"{missed} are missing")


def _says(heard: Heard, state: str) -> bool:
    return any(word.state == state for word in heard.words)


def _feed(bus: ZenohBus, key: str) -> None:
    """Send good messages with bad ones among them."""
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
    told = {
        "RSENF_CONNECT": endpoint, "RSENF_SITE": SITE, "RSENF_NODE": NODE, "RSENF_RUN_ID": RUN,
        "RSENF_RESTARTS": "0", "RSENF_READS": " ".join(reads), "RSENF_SENDS": " ".join(sends),
    }  # fmt: skip
    try:
        process = subprocess.Popen(command, env={**os.environ, **told}, stdin=subprocess.DEVNULL)
    except OSError as exc:
        raise UsageError(f"{command[0]} can't be started: {exc.strerror}") from exc
    try:
        yield process
    finally:
        process.kill()
        process.wait()

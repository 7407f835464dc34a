"""Two hosts, each with a router of its own, and the link between them that breaks."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass

import pytest
from bus_samples import TRACK, client, estimate, seqs, take

from rsenf.bus.bus import Bus, Publisher
from rsenf.bus.inbox import Inbox
from rsenf.bus.keys import SIGNALS, VIDEO_LIVE, alive_key
from rsenf.bus.zenoh_bus import BusSettings, free_endpoint, open_bus
from rsenf.run.process import wait_until
from tests.run.link_proxy import LinkProxy

UNKEPT = "rsenf/lab/other/track"
# Zenoh's routers don't tell each other everything again when a link is back within 0.1 s.
BREAK_S = 0.5
TOKEN = alive_key("lab", "decode")


@dataclass
class Hosts:
    """A node's bus on each host, the link, and whether the sender's token is seen."""

    sender: Bus
    receiver: Bus
    link: LinkProxy
    alive: bool = False

    def on_alive(self, key: str, alive: bool) -> None:
        self.alive = alive

    def sees(self, alive: bool) -> bool:
        return wait_until(lambda: self.alive == alive)


@pytest.fixture
def hosts() -> Iterator[Hosts]:
    with ExitStack() as stack:
        near, far = free_endpoint(), free_endpoint()
        port = int(far.rpartition(":")[2])
        link = stack.enter_context(LinkProxy(port, delay_s=0.01))
        # The other host's router comes later: who links to it waits for it.
        there = BusSettings("router", (f"tcp/127.0.0.1:{link.port}",), (near,))
        stack.enter_context(open_bus(there))
        stack.enter_context(open_bus(BusSettings("router", (), (far,))))
        sender = stack.enter_context(client(near))
        receiver = stack.enter_context(client(far))
        hosts = Hosts(sender, receiver, link)
        receiver.watch_alive(alive_key("lab", "*"), hosts.on_alive)
        yield hosts


def test_a_link_that_breaks_loses_no_estimates(hosts: Hosts) -> None:
    """Neither those before the next one, nor the last ones; video is counted as lost."""
    inbox = Inbox()
    track = hosts.sender.publisher(TRACK, SIGNALS)
    video = hosts.sender.publisher(UNKEPT, VIDEO_LIVE)
    other = Inbox()
    hosts.receiver.subscribe(inbox, TRACK, SIGNALS)
    hosts.receiver.subscribe(other, UNKEPT, SIGNALS)
    hosts.sender.declare_alive(TOKEN)
    assert hosts.sees(alive=True)
    wait_until_heard(track, video)
    video.send(estimate(0))
    for seq in range(5):
        track.send(estimate(seq))
    assert seqs(take(inbox, 5)) == [0, 1, 2, 3, 4]

    hosts.link.cut(ending=True)
    assert hosts.sees(alive=False)
    for seq in range(5, 200):
        track.send(estimate(seq))
    time.sleep(BREAK_S)
    hosts.link.mend()
    assert hosts.sees(alive=True)
    inbox.recover_tail(TRACK)  # as a node does whose sender is back
    assert seqs(take(inbox, 195)) == list(range(5, 200))

    hosts.link.cut(ending=True)
    assert hosts.sees(alive=False)
    for seq in range(200, 300):
        track.send(estimate(seq))
    time.sleep(BREAK_S)
    hosts.link.mend()
    assert hosts.sees(alive=True)  # else the sender may not have noticed the break yet
    wait_until_heard(track, video)
    track.send(estimate(300))  # shows by its number that others are missing
    video.send(estimate(100))
    assert seqs(take(inbox, 101)) == list(range(200, 301))
    counters = inbox.counters
    assert (counters.recovered, counters.missed) == (295, 0)
    assert inbox.receive(0.1) is None
    assert seqs(take(other, 2)) == [0, 100]
    assert other.counters.missed == 99


def wait_until_heard(*publishers: Publisher) -> None:
    assert wait_until(lambda: all(publisher.is_heard for publisher in publishers))

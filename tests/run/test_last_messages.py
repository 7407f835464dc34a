"""What a node still sends when its body ends."""

from __future__ import annotations

import pytest
from run_samples import node_on

from rsenf.bus.delivery import SIGNALS
from rsenf.bus.inbox import Inbox
from rsenf.bus.loopback import Loopback
from rsenf.errors import RsenfError
from rsenf.messages import EnfEstimate, Header
from rsenf.run.node import NodeProcess


def test_a_node_that_fails_has_sent_what_it_made() -> None:
    network, inbox = Loopback(), Inbox()
    network.bus("b").subscribe(inbox, "rsenf/lab/cam/track", SIGNALS)
    node = node_on(network, "track")

    def body(node: NodeProcess) -> None:
        publisher = node.publisher("cam", "track")
        publisher.send(EnfEstimate(header=Header(run_id="r", seq=0)), more=True)
        raise RsenfError("no more")

    with pytest.raises(RsenfError):
        node.live(body)
    assert inbox.receive(0) is not None

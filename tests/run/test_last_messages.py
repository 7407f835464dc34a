"""What a node still sends when its body ends."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest
from run_samples import GRAPH, node_on

from rsenf.bus.inbox import Inbox
from rsenf.bus.keys import SIGNALS, VIDEO
from rsenf.decode import source
from rsenf.decode.live import LiveSource
from rsenf.decode.pump import Disconnected, Stop
from rsenf.decode.source import SourceSpec, Stamp, StreamInfo
from rsenf.errors import RsenfError, SourceLost
from rsenf.messages import EnfEstimate, Header, VideoPacket
from rsenf.run.node import NodeProcess
from tests.loopback import Loopback


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


class BreaksOff:
    """A camera that sends a few packets, and then is gone."""

    info = StreamInfo(live=True)
    pump = SimpleNamespace(overrun=0, waiting=0)
    damaged = 0
    warnings: tuple[str, ...] = ()

    def items(self) -> Iterator[VideoPacket]:
        for seq in range(3):
            yield VideoPacket(header=Header(run_id="r", source="lab/cam", seq=seq))
        raise Disconnected("unplugged")

    def close(self) -> None:
        """Nothing is held."""


def test_the_last_pictures_of_a_lost_camera_do_not_wait_for_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """They may be what tells who pulled the plug, and the node may not live to see it back."""
    network, inbox, came = Loopback(), Inbox(), []
    network.bus("b").subscribe(inbox, "rsenf/lab/cam/video", VIDEO)
    decode = {**GRAPH["nodes"]["decode"], "input": "rtsp://camera/1"}
    graph = {**GRAPH, "nodes": {**GRAPH["nodes"], "decode": decode}}
    node = node_on(network, "decode", graph)
    video = node.publisher("cam", "video")

    def connect(epoch: int) -> Any:
        if epoch:  # the camera is looked for
            while received := inbox.receive(0):
                came.append(received.message.header.seq)
            raise Disconnected("still away")
        return BreaksOff()

    def opened(spec: SourceSpec, *, stop: Any, on_event: Any, **_: Any) -> LiveSource:
        spec = dataclasses.replace(spec, max_reconnects=1, backoff_initial_s=0.01)
        stamp = Stamp("lab/cam", "r", lambda: 0)
        return LiveSource(spec, stamp, Stop(stop), connect, on_event)

    monkeypatch.setattr(source, "open_source", opened)
    with node.config._source(node) as camera, contextlib.suppress(SourceLost):
        for item in camera:
            video.send(item, more=True)
    assert came == [0, 1, 2]

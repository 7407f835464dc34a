"""References that go on, by the node's own body on a bus within the process."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from threading import Thread
from typing import Any

import numpy as np
from rsenf_nodes.reference import body
from run_samples import end_after, node_on

from rsenf.bus.delivery import SIGNALS
from rsenf.bus.inbox import Inbox
from rsenf.bus.keys import camera_key, reference_key
from rsenf.bus.loopback import Loopback
from rsenf.reference import Reference
from tests.reference.test_of_camera import camera


def graph(**reference: Any) -> dict[str, Any]:
    return {
        "version": 1,
        "site": "lab",
        "nodes": {
            "decode": {"kind": "decode", "camera": "cam", "input": "none.mp4", "frames": "fused"},
            "track": {"kind": "track", "cameras": ["cam"]},
            "grid": {"kind": "reference", "grid": "ce", **reference},
        },
    }


@contextmanager
def publishing(network: Loopback, **reference: Any) -> Iterator[Inbox]:
    """Run the node, and listen to what it publishes; it must end with the block."""
    node, heard = node_on(network, "grid", graph(**reference)), Inbox()
    network.bus("listener").subscribe(heard, reference_key("lab", "ce"), SIGNALS)
    thread = Thread(target=body, args=(node,), daemon=True)
    thread.start()
    yield heard
    node.stop.set()
    thread.join(10)
    assert not thread.is_alive()


def take(heard: Inbox) -> list[Any]:
    blocks: list[Any] = []
    while received := heard.receive(10):
        blocks.append(received.message)
        if received.message.header.is_end:
            break
    return blocks


def test_another_camera() -> None:
    network = Loopback()
    with publishing(network, input="camera:cam") as heard:
        bus = network.bus("cameras")
        out = {
            topic: bus.publisher(camera_key("lab", "cam", topic), SIGNALS)
            for topic in ("rows", "track")
        }
        last = {}
        for message in camera(30):
            topic = "rows" if type(message).__name__ == "RowBlock" else "track"
            out[topic].send(message)
            last[topic] = message
        for topic, message in last.items():
            out[topic].send(end_after(message))
        blocks = take(heard)
    assert blocks[-1].header.is_end
    reference = Reference.from_blocks(blocks[:-1])
    np.testing.assert_allclose(reference.freq_hz, 50 + 1e-3 * np.arange(30))

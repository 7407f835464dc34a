"""References that go on, by the node's own body on a bus within the process."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np
import pytest
from run_samples import end_after, node_on

from rsenf.bus.inbox import Inbox
from rsenf.bus.keys import SIGNALS, camera_key, health_key, reference_key
from rsenf.run import reference_feeds
from rsenf.run.reference_feeds import Sound
from tests.loopback import Loopback
from tests.reference.joined import joined
from tests.reference.test_followed_files import rows
from tests.reference.test_of_camera import camera
from tests.reference.test_of_topic import T0_NS, block
from tests.reference.test_wav import mains, path_hz


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
    thread = Thread(target=node.config.body, args=(node,), daemon=True)
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


def test_a_file_that_grows(tmp_path: Path) -> None:
    path = tmp_path / "grid.csv"
    path.write_text("time,frequency\n" + rows(0, 8), encoding="utf-8")
    with publishing(Loopback(), input=str(path), follow=True) as heard:
        first = heard.receive(10)
        with path.open("a", encoding="utf-8") as file:
            file.write(rows(8, 2))
        second = heard.receive(10)
    assert first is not None
    assert second is not None
    blocks = [first.message, second.message]
    np.testing.assert_allclose(joined(blocks).freq_hz, 50 + 1e-3 * np.arange(10))
    assert take(heard)[-1].header.is_end


def test_somebody_elses_topic() -> None:
    network, key = Loopback(), reference_key("other", "theirs")
    with publishing(network, input=f"topic:{key}") as heard:
        theirs = network.bus("other").publisher(key, SIGNALS)
        for k in (0, 10):
            theirs.send(block(k))
        theirs.send(block(20, t0_ns=0))
        theirs.send(end_after(block(21)))
        blocks = take(heard)
        words = Inbox()
        network.bus("looker").subscribe(words, health_key("lab", "grid"), SIGNALS)
        said = words.receive(10)
    assert said is not None
    assert said.message.detail == "blocks left out: they tell no time: 1"
    assert [(b.first, b.grid, b.header.source) for b in blocks[:-1]] == [
        (0, "ce", "reference/ce"),
        (10, "ce", "reference/ce"),
    ]
    assert blocks[-1].header.is_end


def test_the_sound_card(monkeypatch: pytest.MonkeyPatch) -> None:
    truth = path_hz(20)
    signal = mains(truth, 1000)

    def sounds(device: str, *_more: Any) -> Iterator[Sound]:
        assert device == "usb"
        for k in range(20):
            yield Sound(signal[1000 * k : 1000 * (k + 1)], T0_NS + (k + 1) * 10**9, 1000, not k)

    monkeypatch.setattr(reference_feeds, "listen", sounds)
    with publishing(Loopback(), input="sound:usb") as heard:
        blocks = take(heard)
    reference = joined(blocks[:-1])
    np.testing.assert_allclose(reference.freq_hz, truth, atol=2e-4)
    assert reference.t0_ns == T0_NS


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
    reference = joined(blocks[:-1])
    np.testing.assert_allclose(reference.freq_hz, 50 + 1e-3 * np.arange(30))

"""Messages with numbers, and buses to send them over, for the tests of the bus."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from rsenf.bus.inbox import Inbox, Received
from rsenf.bus.sequence import Envelope
from rsenf.bus.zenoh_bus import BusSettings, ZenohBus, free_endpoint, open_bus
from rsenf.messages import EnfEstimate, Frame, Header, encode, encoding_of
from rsenf.run.process import Patience

TRACK = "rsenf/lab/cam/track"
FRAMES = "rsenf/lab/cam/frames"


def estimate(seq: int, run_id: str = "r", **more: Any) -> EnfEstimate:
    return EnfEstimate(header=Header(run_id=run_id, source="lab/cam", seq=seq, **more), enf_hz=50.0)


def frame(seq: int, height_px: int = 6, width_px: int = 7) -> Frame:
    """A frame whose every pixel is its number."""
    return Frame(
        header=Header(run_id="r", source="lab/cam", seq=seq, frame_first=seq, frame_last=seq),
        height_px=height_px,
        width_px=width_px,
        luma=np.full((height_px, width_px), seq % 251, np.uint8),
    )


def envelope(message: Any, key: str = TRACK, sender: str = "a", **more: Any) -> Envelope:
    return Envelope(key, encoding_of(type(message)), encode(message), sender, **more)


def drain(inbox: Inbox, first_timeout_s: float = 0.0) -> list[Any]:
    """All messages that wait."""
    out, timeout_s = [], first_timeout_s
    while (received := inbox.receive(timeout_s)) is not None:
        out.append(received.message)
        timeout_s = 0.0
    return out


def next_of(inbox: Inbox) -> Received:
    """The next message, waiting for it."""
    patience = Patience(20.0)
    while (received := inbox.receive(0.5)) is None:
        assert not patience.over, "nothing more came"
    return received


def take(inbox: Inbox, count: int) -> list[Any]:
    """So many messages, waiting for each."""
    out = []
    for _ in range(count):
        out.append(next_of(inbox).message)
    return out


def seqs(messages: list[Any]) -> list[int]:
    return [m.header.seq for m in messages]


@contextmanager
def router() -> Iterator[tuple[str, ZenohBus]]:
    """A router's endpoint and its own bus."""
    endpoint = free_endpoint()
    with open_bus(BusSettings(mode="router", listen=(endpoint,))) as bus:
        yield endpoint, bus


def client(endpoint: str) -> Any:
    return open_bus(BusSettings(connect=(endpoint,)))

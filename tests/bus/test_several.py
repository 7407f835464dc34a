"""Several messages in one envelope."""

from __future__ import annotations

import itertools

import pytest
from bus_samples import TRACK, drain, envelope, estimate, seqs
from google.protobuf.internal.encoder import _VarintBytes
from hypothesis import given
from hypothesis import strategies as st

from rsenf.bus import bus
from rsenf.bus.bus import MOST, SEVERAL, apart, joined
from rsenf.bus.inbox import Inbox
from rsenf.bus.keys import SIGNALS
from rsenf.bus.sequence import Envelope
from rsenf.messages import encode
from tests.loopback import Loopback


def test_one_travels_as_ever() -> None:
    one = envelope(estimate(0))
    assert joined([one]) is one
    assert apart(one) == [one]


@given(st.lists(st.integers(0, 40_000), min_size=2, max_size=MOST))
def test_what_was_joined_comes_apart_as_it_was(sizes: list[int]) -> None:
    items = [Envelope(TRACK, "application/protobuf;x/1", bytes(n), "a", kept=True) for n in sizes]
    together = joined(items)
    assert together.encoding == f"{SEVERAL};x/1"
    assert apart(together) == items
    delimited = b"".join(_VarintBytes(n) + bytes(n) for n in sizes)  # as Protobuf does it
    assert together.payload == delimited


@pytest.mark.parametrize(
    "payload",
    [b"", b"\x05abc", b"\x80", b"\xff" * 9, b"\x03abc\x01", b"\x00" * (MOST + 1)],
    ids=["empty", "short", "no length", "a length of any size", "ends early", "too many"],
)
def test_what_is_broken_is_refused_once_and_what_follows_is_taken(payload: bytes) -> None:
    network, inbox = Loopback(), Inbox()
    network.bus("b").subscribe(inbox, TRACK, SIGNALS)
    publisher = network.bus("a").publisher(TRACK, SIGNALS)
    publisher._put(Envelope(TRACK, f"{SEVERAL};rsenf.EnfEstimate/1", payload, "stranger"))
    publisher.send(estimate(0))
    assert seqs(drain(inbox)) == [0]
    assert inbox.counters.rejected == 1


def test_one_bad_message_costs_no_other() -> None:
    network, inbox = Loopback(), Inbox()
    network.bus("b").subscribe(inbox, TRACK, SIGNALS)
    items = [envelope(estimate(n)) for n in range(3)]
    items[1] = Envelope(TRACK, items[1].encoding, b"\xff" * 40, "a")
    network.bus("a").publisher(TRACK, SIGNALS)._put(joined(items))
    assert seqs(drain(inbox)) == [0, 2]
    assert (inbox.counters.rejected, inbox.counters.missed) == (1, 1)


def test_it_goes_when_it_has_grown_large_or_old_or_nothing_follows_soon(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    puts: list[int] = []
    publisher = Loopback().bus("a").publisher(TRACK, SIGNALS)
    publisher._put = lambda item: puts.append(len(apart(item)))  # type: ignore[method-assign]
    seq, now_s = itertools.count(), [0.0]
    monkeypatch.setattr(bus.time, "monotonic", lambda: now_s[0])

    def send(count: int, *, more: bool = True) -> list[int]:
        puts.clear()
        for _ in range(count):
            publisher.send(estimate(next(seq)), more=more)
        return list(puts)

    assert send(MOST) == [MOST]
    assert send(3) == []
    assert send(1, more=False) == [4]
    assert send(2, more=False) == [1, 1]
    assert send(2) == []
    now_s[0] += publisher.delivery.together_s
    assert send(1) == [3]
    now_s[0] += publisher.delivery.together_s
    assert send(1) == [1]  # so slow a sender's next is too far off
    monkeypatch.setattr(bus, "TOGETHER_BYTES", 2 * len(encode(estimate(99))))
    assert send(4) == [2, 2]  # all their numbers take one byte
    assert publisher.sent == next(seq)

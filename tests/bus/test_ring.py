"""Frames through shared memory: never copied twice, never torn, never left behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rsenf.bus import ring as ring_module
from rsenf.bus.ring import PREFIX, RingReader, RingWriter, remove_abandoned, ring_directory
from rsenf.errors import NodeFailed, SchemaMismatch


def name(suffix: str = "") -> str:
    return f"rsenf-test-{os.getpid()}{suffix}"


def there() -> bool:
    return False


def gone() -> bool:
    return True


@pytest.fixture(autouse=True)
def nothing_left_behind() -> Iterator[None]:
    yield
    assert list(ring_directory().glob(name("*"))) == []


def plane(seed: int, height: int = 5, width: int = 7) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (height, width), np.uint8)


def test_planes_cross_without_a_copy_and_wrap_around() -> None:
    writer = RingWriter(name(), 3, 35, lossless=True)
    reader = RingReader(name())
    for k in range(10):
        slot, ticket = writer.write(plane(k), there)
        assert slot == k % 3
        view = reader.view(slot, ticket, 5, 7)
        assert view is not None
        assert np.array_equal(view, plane(k))
        writer._planes[slot, 0] = 99  # the same memory on both sides
        assert view[0, 0] == 99
        assert not writer.drained()
        assert reader.release(slot, ticket)
        assert writer.drained()
    reader.close()
    writer.close()


def test_padded_lines_and_smaller_planes_fit() -> None:
    """A decoder's lines are padded; a later picture may be smaller than the first."""
    writer = RingWriter(name(), 2, 683 * 11, lossless=True)
    reader = RingReader(name())
    padded = plane(1, 11, 720)[:, :683]
    for luma in (padded, plane(2, 3, 5), plane(3, 1, 1)):
        slot, ticket = writer.write(luma, there)
        view = reader.view(slot, ticket, *luma.shape)
        assert view is not None
        assert view.flags.c_contiguous
        assert np.array_equal(view, luma)
        reader.release(slot, ticket)
    reader.close()
    writer.close()


def test_a_lossless_writer_waits_until_a_plane_is_given_back() -> None:
    writer = RingWriter(name(), 2, 35, lossless=True)
    reader = RingReader(name())
    tickets = [writer.write(plane(k), there) for k in range(2)]
    third: list[tuple[int, int]] = []
    asked = threading.Event()

    def waiting() -> bool:
        asked.set()
        return False

    writing = threading.Thread(target=lambda: third.append(writer.write(plane(2), waiting)))
    writing.start()
    assert asked.wait(10)
    assert third == []
    assert np.array_equal(reader.view(*tickets[0], 5, 7), plane(0))  # untouched meanwhile
    reader.release(*tickets[0])
    writing.join(10)
    assert third == [(0, 3)]
    assert np.array_equal(reader.view(*tickets[1], 5, 7), plane(1))
    assert np.array_equal(reader.view(0, 3, 5, 7), plane(2))
    reader.close()
    writer.close()


def test_a_writer_whose_reader_is_gone_goes_on_alone() -> None:
    writer = RingWriter(name(), 2, 35, lossless=True)
    for k in range(7):
        writer.write(plane(k), gone)
    reader = RingReader(name())  # the reader is back: it gets what comes from now on
    slot, ticket = writer.write(plane(7), gone)
    assert np.array_equal(reader.view(slot, ticket, 5, 7), plane(7))
    reader.close()
    writer.close()


def test_a_reader_that_went_before_the_first_plane_takes_none_of_the_next_ones_along() -> None:
    departures = iter([True])
    writer = RingWriter(name(), 3, 35, lossless=True)
    tickets = [writer.write(plane(k), lambda: next(departures, False)) for k in range(3)]
    reader = RingReader(name())
    more = threading.Thread(target=writer.write, args=(plane(3), lambda: next(departures, False)))
    more.start()  # the ring is full
    for k, (slot, ticket) in enumerate(tickets):
        assert np.array_equal(reader.view(slot, ticket, 5, 7), plane(k))
        assert reader.release(slot, ticket)
    more.join(10)
    assert not more.is_alive()
    reader.close()
    writer.close()


def test_a_live_writer_overwrites_and_the_reader_notices() -> None:
    writer = RingWriter(name(), 2, 35, lossless=False)
    reader = RingReader(name())
    assert not reader.lossless
    tickets = [writer.write(plane(k), there) for k in range(3)]
    assert reader.view(*tickets[0], 5, 7) is None
    assert np.array_equal(reader.view(*tickets[1], 5, 7), plane(1))
    writer.write(plane(3), there)  # while it is being read
    assert not reader.release(*tickets[1])
    assert reader.release(*tickets[2])
    reader.close()
    writer.close()


@pytest.mark.parametrize(
    ("slot", "height", "width"), [(2, 5, 7), (-1, 5, 7), (0, 6, 6), (0, 0, 7), (0, -5, -7)]
)
def test_descriptors_that_can_not_be_true_are_refused(slot: int, height: int, width: int) -> None:
    writer = RingWriter(name(), 2, 35, lossless=True)
    reader = RingReader(name())
    with pytest.raises(SchemaMismatch):
        reader.view(slot, 1, height, width)
    reader.close()
    writer.close()


@given(st.integers(1, 40), st.integers(1, 40), st.integers(1, 5), st.integers(1, 12))
def test_any_size_any_number(height: int, width: int, slots: int, frames: int) -> None:
    writer = RingWriter(name(), slots, height * width, lossless=True)
    reader = RingReader(name())
    for k in range(frames):
        slot, ticket = writer.write(plane(k, height, width), there)
        assert np.array_equal(reader.view(slot, ticket, height, width), plane(k, height, width))
        reader.release(slot, ticket)
    reader.close()
    writer.close()


def test_views_outlive_the_ring() -> None:
    writer = RingWriter(name(), 1, 35, lossless=True)
    reader = RingReader(name())
    view = reader.view(*writer.write(plane(0), there), 5, 7)
    reader.close()
    writer.close()
    assert np.array_equal(view, plane(0))
    with pytest.raises(FileNotFoundError):
        RingReader(name())


def test_only_this_user_may_look() -> None:
    writer = RingWriter(name(), 1, 35, lossless=True)
    assert writer.path.stat().st_mode & 0o777 == 0o600
    writer.close()


def test_no_room_is_one_clear_error_and_leaves_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(ring_module.os, "posix_fallocate", full)
    with pytest.raises(NodeFailed, match="no room for 64 MiB of frames") as caught:
        RingWriter(name(), 8, 8 << 20, lossless=True)
    assert "ring_slots" in caught.value.hint


@pytest.mark.parametrize("content", [b"", b"abc", bytes(4096)])
def test_a_file_that_is_no_ring_is_refused(content: bytes) -> None:
    path = ring_directory() / name()
    path.write_bytes(content)
    with pytest.raises(SchemaMismatch, match="not a frame ring"):
        RingReader(name())
    path.unlink()
    with pytest.raises(FileNotFoundError):
        RingReader(name())


@pytest.mark.parametrize("forged", ["", ".", "..", "../../etc/passwd", "/etc/passwd"])
def test_what_names_no_ring_is_refused(forged: str) -> None:
    with pytest.raises(SchemaMismatch, match="not a frame ring"):
        RingReader(forged)


def test_a_ring_shorter_than_it_says_is_refused() -> None:
    writer = RingWriter(name(), 2, 16, lossless=True)
    with writer.path.open("rb+") as file:
        file.truncate(8 * 9 + 16)
    with pytest.raises(SchemaMismatch, match="not a frame ring"):
        RingReader(name())
    writer.close()


WRITER = """
import sys, numpy as np
from rsenf.bus.ring import RingWriter
writer = RingWriter(sys.argv[1], 2, 35, lossless=True)
print(*writer.write(np.full((5, 7), 42, np.uint8), lambda: False), flush=True)
sys.stdin.read()
"""


def test_rings_of_killed_writers_are_removed_and_no_others() -> None:
    alive, dead = (f"{PREFIX}test-{os.getpid()}-{k}" for k in range(2))
    writer = RingWriter(alive, 2, 35, lossless=True)
    process = subprocess.Popen(
        [sys.executable, "-c", WRITER, dead], stdout=subprocess.PIPE, stdin=subprocess.PIPE
    )
    assert process.stdout is not None
    process.stdout.readline()
    stranger = ring_directory() / f"{PREFIX}test-{os.getpid()}-stranger"
    stranger.write_bytes(b"somebody's own")
    rings = [ring_directory() / name for name in (alive, dead)]
    for path in (*rings, stranger):
        os.utime(path, (0, 0))
    remove_abandoned()
    assert [path.exists() for path in (*rings, stranger)] == [True, True, True]
    process.kill()
    process.communicate()
    remove_abandoned()
    assert [path.exists() for path in (*rings, stranger)] == [True, False, True]
    stranger.unlink()
    writer.close()


def test_killed_writer_leaves_planes_readable_and_a_ring_that_can_be_removed() -> None:
    """The supervisor removes the rings of its run; the reader's views stay whole."""
    process = subprocess.Popen(
        [sys.executable, "-c", WRITER, name()],
        stdout=subprocess.PIPE,
        stdin=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    slot, ticket = map(int, process.stdout.readline().split())
    reader = RingReader(name())
    process.send_signal(signal.SIGKILL)
    process.communicate()
    view = reader.view(slot, ticket, 5, 7)
    (ring_directory() / name()).unlink()
    assert view is not None
    assert (view == 42).all()
    reader.close()


def test_a_killed_reader_does_not_take_the_ring_with_it(tmp_path: Path) -> None:
    """Python's own shared memory removes the segment when any process attached to it ends."""
    writer = RingWriter(name(), 2, 35, lossless=True)
    code = f"from rsenf.bus.ring import RingReader; RingReader({name()!r}); import os; os._exit(9)"
    subprocess.run([sys.executable, "-c", code], check=False)
    slot, ticket = writer.write(plane(1), there)
    reader = RingReader(name())
    assert np.array_equal(reader.view(slot, ticket, 5, 7), plane(1))
    reader.close()
    writer.close()


def test_a_reader_that_gives_nothing_back_is_not_waited_for_without_limit(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("rsenf.bus.ring.PATIENCE_S", 0.05)
    writer = RingWriter(name(), 1, 35, lossless=True)
    luma = np.zeros((5, 7), np.uint8)
    writer.write(luma, lambda: False)
    with pytest.raises(NodeFailed, match="has given back no frame"):
        writer.write(luma, lambda: False)
    with pytest.raises(NodeFailed, match="has given back no frame"):
        writer.drain(lambda: False)
    writer.close()

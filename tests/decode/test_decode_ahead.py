"""A file is decoded ahead of whoever takes its frames: the same, in order, and not too far."""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from threading import Event
from typing import Any

import numpy as np
import pytest
from decode_clips import cut_short, make_clip, pictures, source_of

from rsenf.decode import SourceSpec
from rsenf.decode.file import (
    BATCH_BYTES,
    BATCH_FRAMES,
    BATCHES,
    DecodedStep,
    FileSource,
    _threads,
    ahead,
)
from rsenf.decode.pump import Stop
from rsenf.messages import Frame, VideoPacket
from rsenf.run.process import wait_until

MOST = (BATCHES + 2) * BATCH_FRAMES  # one batch more is being made, one taken


def threads() -> list[threading.Thread]:
    return [t for t in threading.enumerate() if t.name == "rsenf-decode-pump"]


@pytest.fixture(autouse=True)
def no_thread_stays() -> Iterator[None]:
    yield
    assert wait_until(lambda: not threads())


def step(number: int, luma_bytes: int = 100) -> DecodedStep:
    """A frame whose plane takes no memory, whatever its size."""
    luma = np.broadcast_to(np.uint8(0), (1, luma_bytes))
    return DecodedStep([Frame(luma=luma)], f"lost {number}", [])


class Steps:
    """An endless source that counts what was asked of it."""

    def __init__(self, luma_bytes: int = 100) -> None:
        self.made = 0
        self._luma_bytes = luma_bytes

    def __call__(self) -> Iterator[DecodedStep]:
        while True:
            self.made += 1
            yield step(self.made, self._luma_bytes)


@pytest.mark.parametrize("broken", [False, True])
def test_items_loss_and_warnings_are_those_of_one_thread(tmp_path: Path, broken: bool) -> None:
    path = make_clip(
        tmp_path / "whole.mp4",
        pictures(60),
        options={"qp": "20"},
        rate_hz=Fraction(1000),  # so that pacing takes no time
        container_options={"movflags": "faststart"},
    )
    if broken:
        path = cut_short(path, tmp_path / "part.mp4")
    seen = []
    for paced in (True, False):  # what is paced stays in one thread
        with source_of(path, with_packets=True, pace=paced, threads=3) as source:
            seen.append([_told(item, source) for item in source])
            seen[-1].append((source.loss, source.warnings))
    assert seen[0] == seen[1]
    assert bool(seen[0][-1][0]) == broken


def _told(item: object, source: object) -> tuple[object, ...]:
    assert isinstance(source, FileSource)
    assert isinstance(item, Frame | VideoPacket)
    data = item.data if isinstance(item, VideoPacket) else np.asarray(item.luma).tobytes()
    return type(item), item.header.seq, item.header.pts_ns, data, source.loss, source.warnings


@pytest.mark.parametrize(("luma_bytes", "most"), [(100, MOST), (BATCH_BYTES, BATCHES + 2)])
def test_it_waits_when_it_is_far_enough_ahead(luma_bytes: int, most: int) -> None:
    source = Steps(luma_bytes)
    steps = ahead(source, Stop())
    next(steps)
    assert wait_until(lambda: source.made == most)
    time.sleep(0.1)
    assert source.made == most
    for _ in range(MOST):
        next(steps)
    assert wait_until(lambda: source.made > most)
    steps.close()


def test_what_is_raised_comes_after_what_was_before_it() -> None:
    def breaks() -> Iterator[DecodedStep]:
        yield from (step(n) for n in range(BATCH_FRAMES + 1))
        raise ZeroDivisionError

    steps = ahead(breaks, Stop())
    taken = [next(steps).loss for _ in range(BATCH_FRAMES + 1)]
    assert taken == [f"lost {n}" for n in range(BATCH_FRAMES + 1)]
    with pytest.raises(ZeroDivisionError):
        next(steps)


def test_a_stop_ends_both_sides_though_nobody_takes_any_more() -> None:
    source, outside = Steps(), Event()
    steps = ahead(source, Stop(outside))
    next(steps)
    assert wait_until(lambda: source.made == MOST)
    outside.set()
    assert wait_until(lambda: not threads())
    assert len(list(steps)) < BATCH_FRAMES  # at most the rest of a batch


def test_leaving_a_loop_or_closing_from_anywhere_ends_the_thread(tmp_path: Path) -> None:
    path = make_clip(tmp_path / "clip.mp4", pictures(200))
    with source_of(path) as source:
        items = iter(source)
        next(items), next(items)
        assert threads()
        closing = threading.Thread(target=source.close)
        closing.start()
        closing.join(10)
        assert list(items) == []
    source = source_of(path)
    for item in source:
        if item.header.seq == 3:
            break
    assert wait_until(lambda: not threads())  # before it is closed
    source.close()


def test_a_paced_file_is_not_decoded_before_its_time(tmp_path: Path) -> None:
    path = make_clip(tmp_path / "clip.mp4", pictures(4))
    with source_of(path, pace=True) as source:
        for _ in source:
            assert not threads()


@pytest.mark.parametrize("how", ["pass", "raise SystemExit(3)", "1 / 0"])
def test_a_program_ends_though_it_closed_nothing(tmp_path: Path, how: str) -> None:
    path = make_clip(tmp_path / "clip.mp4", pictures(200))
    program = (
        "from rsenf.decode import SourceSpec, open_source\n"
        f"spec = SourceSpec(url={str(path)!r}, kind='file')\n"
        "source = open_source(spec, source='a/b', run_id='r', clock_ns=lambda: 0)\n"
        "items = iter(source)\n"
        "print(next(items).header.seq, next(items).header.seq)\n" + how
    )
    ran = subprocess.run([sys.executable, "-c", program], capture_output=True)
    assert ran.stdout.split() == [b"0", b"1"]
    assert ran.returncode == {"pass": 0, "1 / 0": 1}.get(how, 3), ran.stderr


@pytest.mark.parametrize(
    ("spec", "of_cores", "threads"),
    [({}, 2, 4), ({}, 1, 0), ({}, 64, 16), ({"pace": True}, 2, 0), ({"threads": 1}, 2, 1)],
)
def test_only_what_is_decoded_ahead_has_a_picture_more_begun(
    monkeypatch: pytest.MonkeyPatch,
    spec: dict[str, Any],
    of_cores: int,
    threads: int,
) -> None:
    monkeypatch.setattr("rsenf.decode.file.cores", lambda: of_cores)
    assert _threads(SourceSpec(url="clip.mp4", kind="file", **spec)) == threads

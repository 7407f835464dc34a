"""Processes that measure clips side by side; a clip is one process's from end to end."""

from __future__ import annotations

import multiprocessing
import signal
import traceback
from collections.abc import Iterator, Sequence
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

from rsenf.bench.plan import Clip
from rsenf.errors import NodeFailed


def measure_all(clips: Sequence[Clip], grids: Path | None, jobs: int) -> Iterator[dict[str, Any]]:
    """Measure clips in so many processes; yields each record as it is done.

    Closing the iterator, or an exception in its user, ends the processes at once.

    Raises
    ------
    NodeFailed
        When a process dies, or a clip can't be measured.
    """
    # A fresh interpreter each: a fork would share the threads' locks of FFmpeg and OpenCV.
    context = multiprocessing.get_context("spawn")
    left = list(reversed(clips))
    processes: dict[Connection, Any] = {}
    busy: dict[Connection, Clip] = {}
    try:
        for _ in range(min(jobs, len(clips))):
            ours, theirs = context.Pipe()
            processes[ours] = context.Process(target=_work, args=(theirs, grids), daemon=True)
            processes[ours].start()
            theirs.close()
            _give(ours, left.pop(), busy)
        while busy:
            for ready in wait(list(busy)):
                assert isinstance(ready, Connection)
                record = _received(ready, busy.pop(ready))
                if left:
                    _give(ready, left.pop(), busy)
                yield record
    finally:
        for connection, process in processes.items():
            connection.close()
            process.terminate()
            process.join()


def _give(connection: Connection, clip: Clip, busy: dict[Connection, Clip]) -> None:
    connection.send(clip)
    busy[connection] = clip


def _received(connection: Connection, clip: Clip) -> dict[str, Any]:
    try:
        record, trouble = connection.recv()
    except EOFError:
        raise NodeFailed(
            f"the process that measured '{clip.key}' died", "not enough memory? try --jobs 1"
        ) from None
    if trouble:
        raise NodeFailed(f"'{clip.key}' can't be measured: {trouble}")
    assert isinstance(record, dict)
    return record


def _work(connection: Connection, grids: Path | None) -> None:
    """Measure what comes, until nothing more does."""
    # Ctrl-C reaches every process of a terminal; the parent ends this one.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    import cv2

    from rsenf.bench.measure import measure

    cv2.setNumThreads(1)
    while True:
        try:
            clip = connection.recv()
        except EOFError:
            return
        try:
            connection.send((measure(clip, grids), ""))
        except Exception as exc:  # noqa: BLE001  # told to the parent, which stops the run
            traceback.print_exc()
            connection.send((None, f"{type(exc).__name__}: {exc}"))

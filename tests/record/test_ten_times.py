"""Twenty seconds of the study of fast writing: nothing is lost, and memory stays flat."""

from __future__ import annotations

import multiprocessing
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from tests.record.ten_times import write


def test_as_fast_as_it_goes_nothing_is_lost(tmp_path: Path) -> None:
    seconds = 20
    # In a process of its own: other tests' memory comes and goes.
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as own:
        found = own.submit(write, tmp_path, seconds, 0.0, seed=1).result()
    assert found.sent == found.read == seconds * 30 + seconds * 30 // 8
    assert found.in_order
    assert found.size_mb > 8.0
    # A fifth of what was written would show: nothing is kept of it but its index.
    assert found.memory_mb[-1] - found.memory_mb[2] < 0.2 * found.size_mb + 2.0

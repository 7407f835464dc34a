"""A node that is told to stop while it reads its reference stops; it doesn't fail."""

from __future__ import annotations

import os
import signal
import threading
import time
from pathlib import Path

import numpy as np

from tests.reference.reference_files import read_text


def test_a_signal_in_the_middle_is_the_process_s_own_affair(tmp_path: Path) -> None:
    """The library that splits the lines would take the signal, and raise an error of its own."""
    text = "time_s,frequency\n" + "".join(f"{k},{50 + 0.01 * np.sin(k)}\n" for k in range(60_000))
    heard: list[int] = []
    before = signal.signal(signal.SIGTERM, lambda number, _frame: heard.append(number))
    ended = threading.Event()

    def tell() -> None:
        while not ended.wait(0.003):
            os.kill(os.getpid(), signal.SIGTERM)

    teller = threading.Thread(target=tell)
    teller.start()
    try:
        until = time.monotonic() + 1.0
        while time.monotonic() < until or len(heard) < 20:
            assert len(read_text(tmp_path, text).freq_hz) == 60_000
    finally:
        ended.set()
        teller.join()
        signal.signal(signal.SIGTERM, before)
    assert heard

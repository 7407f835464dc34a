"""Memory of a process, as the system tells it.

How much of the machine other programs took while something was timed.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from rsenf.batch.journal import Record

PEAK, HELD = "VmHWM", "VmRSS"


def memory_mb(which: str = HELD, pid: int | str = "self") -> float | None:
    """Resident memory of a process in MB, now or at its most; None where it isn't told."""
    try:
        lines = Path(f"/proc/{pid}/status").read_text(encoding="ascii").splitlines()
    except OSError:
        return None
    return next(
        (int(line.split()[1]) / 1024 for line in lines if line.startswith(f"{which}:")), None
    )


def restart_peak() -> None:
    """Begin anew to watch for the most memory that this process holds."""
    # The peak of getrusage() can't begin anew, and of a new process it is that of its parent.
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")


# With more of it gone, frame rates say who has more processes to ask for the rest.
BUSY_RATIO = 0.1

_IDLE = (3, 4)  # idle, and waiting for the disk
_NOT_COUNTED_TWICE = 8  # guests are in user time already


def watch_others() -> Callable[[], float | None]:
    """Begin to watch; returns what tells the share of all cores that others have taken since.

    Ours are this process and those of its children that have ended. None where the system doesn't
    tell.
    """
    begun_s, busy_s, own_s = time.monotonic(), _busy_s(), _own_s()

    def share() -> float | None:
        now_s = _busy_s()
        if busy_s is None or now_s is None:
            return None
        whole_s = (time.monotonic() - begun_s) * (os.cpu_count() or 1)
        return max(now_s - busy_s - (_own_s() - own_s), 0.0) / whole_s

    return share


def _busy_s() -> float | None:
    """Processor time of everything that runs here."""
    try:
        first = Path("/proc/stat").read_text(encoding="ascii").splitlines()[0]
    except OSError:
        return None
    ticks = [int(word) for word in first.split()[1:]][:_NOT_COUNTED_TWICE]
    return sum(t for k, t in enumerate(ticks) if k not in _IDLE) / os.sysconf("SC_CLK_TCK")


def _own_s() -> float:
    return sum(os.times()[:4])


def most_of_others(records: Sequence[Record]) -> float | None:
    """Return the most that others took while any of these was timed."""
    return max((r["others_ratio"] for r in records if r["others_ratio"] is not None), default=None)


def undisturbed(pairs: Sequence[tuple[Record, Record]]) -> Sequence[tuple[Record, Record]]:
    """Return those of which others took little of the machine from either; all if there are none.

    What is left out is told by others' share alone, not by what came of it.
    """
    return [pair for pair in pairs if (most_of_others(pair) or 0.0) <= BUSY_RATIO] or pairs


def others_said(document: dict[str, Any]) -> str:
    """Say of a table that the machine wasn't its own; empty when it was."""
    ratio = document["others_ratio"]
    if ratio is None or ratio <= BUSY_RATIO:
        return ""
    taken = f"{100 * ratio:.0f} %"
    return f"; other programs took up to {taken} of the machine: go by processor time alone"

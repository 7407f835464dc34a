"""Memory of a process, as the system tells it."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

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

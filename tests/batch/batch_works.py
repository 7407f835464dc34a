"""Work for the pool's tests, which other processes import by its name."""

from __future__ import annotations

import os
import signal
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class Order:
    """What to do, and where to leave a mark each time."""

    name: str
    does: str
    folder: Path


def obey(order: Order) -> dict[str, Any]:
    """Do it; the answer tells in which process."""
    mark = order.folder / order.name
    first = not mark.exists()
    with mark.open("a") as marks:
        marks.write(f"{os.getpid()}\n")
    if order.does == "die" or (order.does == "die once" and first):
        os.kill(os.getpid(), signal.SIGSEGV)
    if order.does == "exit":
        os._exit(7)
    if order.does == "raise":
        raise ValueError(order.name)
    if order.does == "wait" or (order.does == "wait once" and first):
        time.sleep(3600)
    return {"name": order.name, "pid": os.getpid()}


def status_name(dask_worker: Any) -> str:
    """Return what a worker, or a nanny, says it is doing; Dask gives it by the argument's name."""
    return str(dask_worker.status.name)

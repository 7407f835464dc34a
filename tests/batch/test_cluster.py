"""A Dask cluster of two worker processes, one of which is killed: all is done, and once."""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from rsenf.batch.pool import Trouble, worked_on_cluster
from rsenf.errors import UsageError
from rsenf.run.process import slowness
from tests.batch.batch_works import Order, obey, status_name
from tests.conftest import ROOT

pytest.importorskip("distributed")


@pytest.fixture
def scheduler(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Address of the scheduler of two workers, one thread each, in processes of their own."""
    folder = tmp_path_factory.mktemp("dask")
    where = folder / "scheduler.json"
    surroundings = os.environ | {
        "PYTHONPATH": str(ROOT),
        "DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "1",
    }
    dask = [sys.executable, "-m", "dask"]
    words = ["--scheduler-file", str(where), "--no-dashboard", "--host", "127.0.0.1"]
    more = ["--nworkers", "2", "--nthreads", "1", "--local-directory", str(folder)]
    with (folder / "log").open("w") as log:
        started = [
            subprocess.Popen([*dask, *command], env=surroundings, stdout=log, stderr=log)
            for command in (["scheduler", "--port", "0", *words], ["worker", *words, *more])
        ]
    try:
        while not where.exists():
            assert started[0].poll() is None, (folder / "log").read_text()
            time.sleep(0.05)
        address = json.loads(where.read_text())["address"]
        wait_for_nannies(address, 2)
        yield address
    finally:
        for process in reversed(started):  # workers that look for their scheduler end late
            process.terminate()
            try:
                process.wait(20)
            except subprocess.TimeoutExpired:
                process.kill()


def wait_for_nannies(address: str, count: int) -> None:
    """Wait until so many can start their worker anew: one whose worker dies before gives up."""
    from distributed import Client

    with Client(address, set_as_default=False) as client:
        while list(client.run(status_name, nanny=True).values()) != ["running"] * count:
            time.sleep(0.05)


Ended = tuple[str, int | None]


def done_on(
    scheduler: str, does: dict[str, str], folder: Path, timeout_s: float = math.inf
) -> dict[str, Ended]:
    """Return what has become of orders, each of which has to come back once, by which try."""
    orders = [Order(name, what, folder) for name, what in does.items()]
    done = list(worked_on_cluster(orders, obey, scheduler, print, timeout_s))
    assert sorted(one.task.name for one in done) == sorted(does)
    return {
        one.task.name: (
            one.answer.text if isinstance(one.answer, Trouble) else "done",
            one.tries,
        )
        for one in done
    }


@pytest.mark.processes
def test_a_killed_worker_costs_no_more_than_a_deadly_task(scheduler: str, tmp_path: Path) -> None:
    mark = tmp_path / "killed"

    def kill() -> None:
        while not (mark.exists() and mark.read_text().endswith("\n")):
            time.sleep(0.02)
        os.kill(int(mark.read_text()), signal.SIGKILL)

    killer = threading.Thread(target=kill, daemon=True)
    killer.start()
    easy = dict.fromkeys("abcdef", "")
    found = done_on(scheduler, {"killed": "wait once", "wrong": "raise", **easy}, tmp_path)
    fine = dict.fromkeys(easy, ("done", 1))
    assert found == fine | {"killed": ("done", 2), "wrong": ("ValueError: wrong", 1)}
    assert len(set(mark.read_text().split())) == 2

    found = done_on(scheduler, {"deadly": "die", **easy}, tmp_path)
    died = "2 workers died while they worked on it"
    assert found == fine | {"deadly": (died, 2)}
    assert len((tmp_path / "deadly").read_text().split()) == 2

    limit_s = round(2 * slowness())
    found = done_on(scheduler, {"late": "wait", **easy}, tmp_path, limit_s)
    assert found == fine | {"late": (f"not done within {limit_s} s", 1)}
    (late,) = (tmp_path / "late").read_text().split()
    with pytest.raises(ProcessLookupError):
        os.kill(int(late), 0)


def test_a_scheduler_that_is_not_there() -> None:
    with pytest.raises(UsageError, match="no Dask scheduler"):
        list(worked_on_cluster([], obey, "tcp://127.0.0.1:9", print))

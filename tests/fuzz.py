"""Damages what rsenf reads, and counts what comes of it; reads run within limits, in a process.

``python -m tests.fuzz --count 10000 --seed 1 [--reader NAME]`` exits with 1 if a read raised
anything but an error of rsenf, took too long or too much memory, or died. With ``--case N`` one
case is read in this process, and its traceback shown; its files are kept in ``--folder``.
"""

from __future__ import annotations

import argparse
import contextlib
import math
import multiprocessing
import os
import resource
import shutil
import signal
import sys
import tempfile
import traceback
import warnings
import zlib
from collections import Counter
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np

from tests.damage import damaged

CPU_S, MEMORY_BYTES, SPACE_BYTES = 20, 1 << 30, 6 << 30
WAIT_S = 600.0  # by the wall clock, for a read that neither ends nor computes
READ, REFUSED, TRACEBACK, SLOW, LARGE, DIED = OUTCOMES = (
    "read", "refused", "traceback", "too slow", "too much memory", "died",
)  # fmt: skip
Files = dict[str, bytes]


@dataclass
class Tally:
    """What came of a reader's cases."""

    outcomes: Counter[str] = field(default_factory=Counter)
    failures: dict[str, list[str]] = field(default_factory=dict)  # by outcome and place
    peak_bytes: int = 0
    slowest_s: float = 0.0  # of CPU time, as all times here
    cpu_s: float = 0.0

    def add(self, case: int, outcome: str, detail: str, peak_bytes: int, cpu_s: float) -> None:
        self.outcomes[outcome] += 1
        self.peak_bytes, self.slowest_s = (
            max(self.peak_bytes, peak_bytes),
            max(self.slowest_s, cpu_s),
        )
        self.cpu_s += cpu_s
        if outcome not in (READ, REFUSED):
            place, _, words = detail.partition(": ")
            self.failures.setdefault(f"{outcome}: {place}", []).append(f"case {case}: {words}")


class Case:
    """Writes the files of a reader's cases, all in one folder, and reads them."""

    def __init__(self, name: str, folder: Path, seed: int, files: Files | None = None) -> None:
        from tests.fuzz_readers import READERS

        self._name, self._folder, self._seed, self._reader = name, folder, seed, READERS[name]
        self.files = self._made() if files is None else files

    def _made(self) -> Files:
        shutil.rmtree(self._folder, ignore_errors=True)
        self._folder.mkdir(parents=True)
        self._reader.make(self._folder)
        paths = sorted(path for path in self._folder.rglob("*") if path.is_file())
        return {str(path.relative_to(self._folder)): path.read_bytes() for path in paths}

    def write(self, number: int) -> None:
        """Write the files of a case; number -1 is without damage."""
        from tests.fuzz_readers import DATED_NS

        rng = np.random.default_rng([self._seed, zlib.crc32(self._name.encode()), number + 1])
        shutil.rmtree(self._folder, ignore_errors=True)
        self._folder.mkdir(parents=True)
        for name, content in self.files.items():
            path = self._folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
        if number >= 0:
            found = [p for p in self._folder.glob(self._reader.damaged) if p.is_file()]
            path = sorted(found)[rng.integers(len(found))]
            path.write_bytes(damaged(path.name, path.read_bytes(), rng))
        for path in self._folder.rglob("*"):
            os.utime(path, ns=(DATED_NS, DATED_NS))

    def read(self) -> object:
        return self._reader.read(self._folder)


def work(connection: Connection, name: str, folder: Path, seed: int, files: Files | None) -> None:
    """In a process of its own: read the cases that are asked for, one after the other."""
    nowhere = os.open(os.devnull, os.O_RDWR)
    for stream in (0, 1, 2):
        os.dup2(nowhere, stream)
    warnings.simplefilter("error", RuntimeWarning)  # NumPy's: it would stand on a user's screen
    cases = Case(name, folder, seed, files)
    cases.write(-1)
    outcome, detail = _outcome(cases)
    connection.send((cases.files, outcome, detail))
    used_bytes = _status("VmSize")
    resource.setrlimit(resource.RLIMIT_AS, (used_bytes + SPACE_BYTES,) * 2)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    while (number := connection.recv()) is not None:
        cases.write(number)
        Path("/proc/self/clear_refs").write_text("5")
        before_bytes, before_s = _status("VmRSS"), _cpu_s()
        resource.setrlimit(
            resource.RLIMIT_CPU, (math.ceil(before_s) + CPU_S, resource.RLIM_INFINITY)
        )
        outcome, detail = _outcome(cases)
        peak_bytes = _status("VmHWM") - before_bytes
        if peak_bytes > MEMORY_BYTES:
            outcome, detail = LARGE, f"{peak_bytes / 2**30:.1f} GiB; {detail}"
        connection.send((number, outcome, detail, peak_bytes, _cpu_s() - before_s))


def _outcome(cases: Case) -> tuple[str, str]:
    from rsenf.errors import RsenfError

    try:
        cases.read()
    except RsenfError as exc:
        return REFUSED, str(exc)
    except BaseException as exc:  # noqa: BLE001 - what is looked for
        frames = traceback.extract_tb(exc.__traceback__)
        ours = [f for f in frames if "/rsenf/" in f.filename and "site-packages" not in f.filename]
        at = (ours or frames)[-1]
        where = f"{Path(at.filename).parent.name}/{Path(at.filename).name}:{at.lineno}"
        return TRACEBACK, f"{where}: {type(exc).__name__}: {str(exc)[:120]}"
    return READ, ""


def _cpu_s() -> float:
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def _status(name: str) -> int:
    """Return a memory figure of this process in bytes."""
    (line,) = (s for s in Path("/proc/self/status").read_text().splitlines() if s.startswith(name))
    return int(line.split()[1]) << 10


class Worker:
    """A process that reads cases; made anew when it has died."""

    def __init__(self, name: str, folder: Path, seed: int) -> None:
        self._given = name, folder, seed
        self._files: Files | None = None
        self._begin()

    def _begin(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._connection, theirs = context.Pipe()
        given = (theirs, *self._given, self._files)
        self._process = context.Process(target=work, args=given, daemon=True)
        self._process.start()
        theirs.close()
        self._files, outcome, detail = self._connection.recv()
        if outcome != READ:
            raise SystemExit(f"{self._given[0]}: the undamaged files are {outcome}: {detail}")

    def read(self, number: int) -> tuple[int, str, str, int, float]:
        """Return a case's number, outcome, details, peak memory and CPU time."""
        self._connection.send(number)
        try:
            if self._connection.poll(WAIT_S):
                answer: tuple[int, str, str, int, float] = self._connection.recv()
                return answer
        except (EOFError, ConnectionError):
            pass
        self._process.join(1.0)
        code = self._process.exitcode
        self.close()
        self._begin()
        if code in (None, -signal.SIGXCPU):
            return number, SLOW, "waits" if code is None else f"{CPU_S} s", 0, float(CPU_S)
        return number, DIED, f"exit code {code}", 0, 0.0

    def close(self) -> None:
        self._process.kill()
        self._process.join()
        self._connection.close()


def fuzz(name: str, count: int, seed: int, folder: Path, most_s: float = math.inf) -> Tally:
    """Read cases of a reader.

    Parameters
    ----------
    name : str
        Of the reader.
    count, seed : int
    folder : Path
        For the files; emptied at each case.
    most_s : float
        CPU time after which no further case is begun.
    """
    tally, worker = Tally(), Worker(name, folder, seed)
    with contextlib.closing(worker):
        for number in range(count):
            if tally.cpu_s > most_s:
                break
            tally.add(*worker.read(number))
    return tally


def main() -> int:
    from tests.fuzz_readers import READERS

    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--most-s", type=float, default=math.inf, help="CPU time of a reader")
    parser.add_argument("--reader", action="append", choices=list(READERS))
    parser.add_argument("--case", type=int)
    parser.add_argument("--folder", type=Path)
    args = parser.parse_args()
    folder = args.folder or Path(tempfile.mkdtemp(prefix="fuzz-"))
    if args.case is not None:
        case = Case(args.reader[0], folder, args.seed)
        case.write(args.case)
        case.read()
        return 0
    failed = False
    for name in args.reader or READERS:
        tally = fuzz(name, args.count, args.seed, folder, args.most_s)
        counts = ", ".join(f"{tally.outcomes[o]} {o}" for o in OUTCOMES if tally.outcomes[o])
        used = f"{tally.peak_bytes >> 20} MiB, {tally.cpu_s:.0f} s, at most {tally.slowest_s:.1f} s"
        print(f"{name}: {tally.outcomes.total()} cases: {counts}; {used}", flush=True)
        for place, cases in tally.failures.items():
            print(f"    {len(cases)} × {place}, {'; '.join(cases[:3])}", flush=True)
        failed |= bool(tally.failures)
    if not args.folder:
        shutil.rmtree(folder, ignore_errors=True)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())

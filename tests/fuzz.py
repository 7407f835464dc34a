"""Damages what rsenf reads, and counts what comes of it; reads run within limits, in a process.

``python -m tests.fuzz --count 10000 --seed 1 [--reader NAME]`` exits with 1 if a read raised
anything but an error of rsenf, took too long or too much memory, or died. With ``--case N`` one
case is read in this process, and its traceback shown; its files are kept in ``--folder``.
"""

from __future__ import annotations

import argparse
import contextlib
import gzip
import io
import math
import multiprocessing
import os
import re
import resource
import shutil
import signal
import struct
import sys
import tempfile
import traceback
import zipfile
import zlib
from collections import Counter
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np

CPU_S, MEMORY_BYTES, SPACE_BYTES = 20, 1 << 30, 6 << 30
WAIT_S = 600.0  # by the wall clock, for a read that neither ends nor computes
READ, REFUSED, TRACEBACK, SLOW, LARGE, DIED = OUTCOMES = (
    "read", "refused", "traceback", "too slow", "too much memory", "died",
)  # fmt: skip
Files = dict[str, bytes]

TEXT = (".csv", ".yaml", ".json", ".jsonl")
NUMBER = re.compile(rb"-?\d+(?:\.\d+)?")
WORD = re.compile(rb"[\w.+-]+")
EXTREMES = (
    b"nan", b"inf", b"-inf", b"0", b"-0", b"-1", b"1e308", b"-1e308", b"1e-320", b"1e999", b"2147483648",
    b"9223372036854775807", b"-9223372036854775808", b"1" + b"0" * 400, b"0.1e1", b"1_000", b"0x10",
)  # fmt: skip
ODD = (b"null", b"true", b"[]", b"{}", b'""', b"~", b"- -", b"\xff\xfe", b"\0", "é".encode(), b"..", b"/",
       b"!!python/object:os.system", b"2026-13-45", b"''", b"*b1", b"${HOME}", b"${NOT_SET}")  # fmt: skip


def damaged(name: str, content: bytes, rng: np.random.Generator) -> bytes:
    """Damage a file at one to four places; half of the time within what checksums protect."""
    if rng.random() < 0.5:
        if name.endswith(".npz"):
            return _in_zip(content, rng)
        if name.endswith(".gz"):
            return gzip.compress(damaged(name.removesuffix(".gz"), gzip.decompress(content), rng))
        if name.endswith(".mcap"):
            content = without_checksums(content)
    for _ in range(min(4, rng.geometric(0.5))):
        textual = name.endswith(TEXT) and rng.random() < 0.7
        kinds = OF_TEXT if textual else OF_BYTES
        content = kinds[rng.integers(len(kinds))](content or b"0", rng)
    return content


def _in_zip(content: bytes, rng: np.random.Generator) -> bytes:
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    name = list(parts)[rng.integers(len(parts))]
    parts[name] = damaged(name, parts[name], rng)
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for part, inside in parts.items():
            archive.writestr(part, inside)
    return out.getvalue()


def without_checksums(content: bytes) -> bytes:
    """Zero the checksum of every chunk of an MCAP file: 'there is none'."""
    changed, at = bytearray(content), 8
    while at + 9 <= len(changed):
        kind, length = struct.unpack_from("<BQ", changed, at)
        if kind == 6:
            changed[at + 33 : at + 37] = bytes(4)
        at += 9 + length
    return bytes(changed)


def _stretch(content: bytes, rng: np.random.Generator) -> tuple[int, int]:
    """Any place, and a length that is of any order of magnitude."""
    start = int(rng.integers(len(content)))
    length = int(math.exp(rng.uniform(0, math.log(len(content) + 1))))
    return start, min(start + length, len(content))


def flip(content: bytes, rng: np.random.Generator) -> bytes:
    changed = bytearray(content)
    for at in rng.integers(0, len(content), int(rng.integers(1, 9))):
        changed[at] ^= 1 << int(rng.integers(8))
    return bytes(changed)


def extreme(content: bytes, rng: np.random.Generator) -> bytes:
    """An integer becomes the largest, the smallest, or one near 0."""
    size = int(rng.choice([1, 2, 4, 8]))
    value = [b"\xff" * size, b"\xff" * (size - 1) + b"\x7f", bytes(size), b"\1" + bytes(size - 1),
             bytes(size - 1) + b"\x80", rng.bytes(size)][rng.integers(6)]  # fmt: skip
    at = int(rng.integers(len(content)))
    return content[:at] + value[:: int(rng.choice([1, -1]))] + content[at + size :]


def cut(content: bytes, rng: np.random.Generator) -> bytes:
    return content[: rng.integers(len(content))]


def delete(content: bytes, rng: np.random.Generator) -> bytes:
    start, stop = _stretch(content, rng)
    return content[:start] + content[stop:]


def blank(content: bytes, rng: np.random.Generator) -> bytes:
    start, stop = _stretch(content, rng)
    return content[:start] + bytes(stop - start) + content[stop:]


def repeat(content: bytes, rng: np.random.Generator) -> bytes:
    start, stop = _stretch(content, rng)
    return content[:stop] + content[start:stop] * int(rng.integers(1, 4)) + content[stop:]


def splice(content: bytes, rng: np.random.Generator) -> bytes:
    """A stretch comes to lie over another."""
    (start, stop), to = _stretch(content, rng), int(rng.integers(len(content)))
    return content[:to] + content[start:stop] + content[to + stop - start :]


def _replaced(content: bytes, pattern: re.Pattern[bytes], by: bytes, rng: np.random.Generator) -> bytes:
    places = list(pattern.finditer(content))
    if not places:
        return content + by
    place = places[rng.integers(len(places))]
    return content[: place.start()] + by + content[place.end() :]


def number(content: bytes, rng: np.random.Generator) -> bytes:
    return _replaced(content, NUMBER, EXTREMES[rng.integers(len(EXTREMES))], rng)


def word(content: bytes, rng: np.random.Generator) -> bytes:
    """A word becomes another one of the file, or something odd."""
    words = WORD.findall(content)
    by = words[rng.integers(len(words))] if words and rng.random() < 0.5 else ODD[rng.integers(len(ODD))]
    return _replaced(content, WORD, by, rng)


def nested(content: bytes, rng: np.random.Generator) -> bytes:
    opening, closing = [(b"[", b"]"), (b'{"a":', b"}"), (b"{a: ", b"}"), (b'"', b'"')][rng.integers(4)]
    depth = int(rng.choice([1, 2, 40, 3000, 100_000]))
    return _replaced(content, WORD, opening * depth + b"1" + closing * depth, rng)


def aliases(content: bytes, rng: np.random.Generator) -> bytes:
    """Aliases of aliases (of YAML) in place of a value."""
    depth = int(rng.choice([2, 9, 30]))
    bomb = b"[&b0 [1,1,1,1,1,1,1,1,1],"
    bomb += b",".join(b"&b%d [%s]" % (k, b",".join([b"*b%d" % (k - 1)] * 9)) for k in range(1, depth))
    return _replaced(content, WORD, bomb + b"]", rng)


def lines(content: bytes, rng: np.random.Generator) -> bytes:
    """A line (or a key of JSON with its value) is repeated, left out, or moved."""
    mark = b"\n" if content.count(b"\n") > 2 else b","
    parts = content.split(mark)
    at, to = (int(n) for n in rng.integers(0, len(parts), 2))
    kept = [] if rng.random() < 0.3 else [parts[at]]
    if rng.random() < 0.5:
        parts[to:to] = [parts[at]] * int(rng.choice([1, 2, 1000]))
    else:
        del parts[at]
        parts[to:to] = kept
    return mark.join(parts)


OF_BYTES = (flip, extreme, cut, delete, blank, repeat, splice)
OF_TEXT = (number, number, word, word, nested, aliases, lines)


@dataclass
class Tally:
    """What came of a reader's cases."""

    outcomes: Counter[str] = field(default_factory=Counter)
    places: dict[str, list[int]] = field(default_factory=dict)  # of failures: their cases
    peak_bytes: int = 0
    slowest_s: float = 0.0  # of CPU time, as all times here
    cpu_s: float = 0.0

    def add(self, case: int, outcome: str, detail: str, peak_bytes: int, cpu_s: float) -> None:
        self.outcomes[outcome] += 1
        self.peak_bytes, self.slowest_s = max(self.peak_bytes, peak_bytes), max(self.slowest_s, cpu_s)
        self.cpu_s += cpu_s
        if outcome not in (READ, REFUSED):
            self.places.setdefault(f"{outcome}: {detail}", []).append(case)


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
        return TRACEBACK, f"{where}: {type(exc).__name__}: {str(exc)[:200]}"
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
        peak = f"peak {tally.peak_bytes >> 20} MiB, {tally.cpu_s:.0f} s, at most {tally.slowest_s:.1f} s"
        print(f"{name}: {tally.outcomes.total()} cases: {counts}; {peak}", flush=True)
        for place, numbers in tally.places.items():
            print(f"    {len(numbers)} × {place} (case {numbers[0]})", flush=True)
        failed |= bool(tally.places)
    if not args.folder:
        shutil.rmtree(folder, ignore_errors=True)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())

"""What corruption does to recordings, and how often anything but loss that is said.

Not a test by itself: ``python -m tests.record.corruptions 10000 1`` damages a small recording in so
many ways, from seed 1 on, and reads, examines and recovers each. A message that comes out must be
bit for bit one that went in; one that doesn't must be reported lost. Seeds that fail are named.
"""

from __future__ import annotations

import contextlib
import resource
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from mcap.opcode import Opcode
from mcap.reader import make_reader

from rsenf.cli.archive import words
from rsenf.cli.doctor import lost_words
from rsenf.errors import RsenfError
from rsenf.messages import encode
from rsenf.record import Recorder, close_truncated, open_recording
from rsenf.record.archive.holdings import extent_of, holding
from rsenf.record.archive.index import Entry, summarise
from rsenf.record.archive.layout import ArchivedFile, Camera
from rsenf.record.container import HEAD, MAGIC, walk
from rsenf.record.examine import RECOVERED, Examination, examine
from rsenf.record.index import Stretch
from rsenf.record.recover import recover

sys.path.insert(0, str(Path(__file__).parent))
from record_samples import ROWS, VIDEO, Clock, packet, rows

LIMIT_S = 20.0
MEMORY_BYTES = 1 << 30  # beyond what is in use at the start
FRAMES, CHUNK_FRAMES = 20, 4
Key = tuple[str, int]


class Sample(NamedTuple):
    """A recording, closed or killed; what is in it; and where its records lie."""

    content: bytes
    messages: dict[Key, bytes]
    records: list[tuple[int, int, int]]  # opcode, start, end


def make_sample(folder: Path, *, closed: bool, compress: bool = True) -> Sample:
    path = folder / "sample.mcap"
    path.unlink(missing_ok=True)
    recorder = Recorder(path, run_info={"run_id": "r"}, clock_ns=Clock(), compress=compress)
    messages = {}
    for seq in range(FRAMES):
        for topic, message in ((VIDEO, packet(seq, size=120)), (ROWS, rows(seq))):
            recorder.write(topic, message)
            messages[topic, seq] = encode(message)
        if seq % CHUNK_FRAMES == CHUNK_FRAMES - 1:
            recorder.flush()
    killed = path.read_bytes()
    recorder.close()
    content = path.read_bytes() if closed else killed
    with path.open("rb") as stream:
        found = [(r.opcode, r.start, r.end) for r in walk(stream, len(MAGIC), len(content))]
    return Sample(content, messages, found)


def flipped(rng: np.random.Generator, sample: Sample) -> bytes:
    content = bytearray(sample.content)
    for _ in range(rng.integers(1, 9)):
        content[rng.integers(len(content))] ^= 1 << rng.integers(8)
    return bytes(content)


def zeroed(rng: np.random.Generator, sample: Sample) -> bytes:
    start, stop = _stretch(rng, sample)
    return sample.content[:start] + bytes(stop - start) + sample.content[stop:]


def scrambled(rng: np.random.Generator, sample: Sample) -> bytes:
    start, stop = _stretch(rng, sample)
    return sample.content[:start] + rng.bytes(stop - start) + sample.content[stop:]


def truncated(rng: np.random.Generator, sample: Sample) -> bytes:
    content = sample.content[: rng.integers(len(sample.content))]
    return content + bytes(int(rng.integers(5000))) if rng.random() < 0.3 else content


def cut_out(rng: np.random.Generator, sample: Sample) -> bytes:
    start, stop = _stretch(rng, sample)
    return sample.content[:start] + sample.content[stop:]


def repeated(rng: np.random.Generator, sample: Sample) -> bytes:
    start, stop = _stretch(rng, sample)
    return sample.content[:stop] + sample.content[start:]


def swapped(rng: np.random.Generator, sample: Sample) -> bytes:
    """Two chunks change places, with their indexes or without."""
    chunks = [n for n, (opcode, _, _) in enumerate(sample.records) if opcode == Opcode.CHUNK]
    a, b = sorted(int(n) for n in rng.choice(chunks, 2, replace=False))
    more = 3 if rng.random() < 0.5 else 0  # a chunk is followed by the indexes of three channels
    (a0, a1), (b0, b1) = ((sample.records[n][1], sample.records[n + more][2]) for n in (a, b))
    c = sample.content
    return c[:a0] + c[b0:b1] + c[a1:b0] + c[a0:a1] + c[b1:]


def lying(rng: np.random.Generator, sample: Sample) -> bytes:
    """A record says that it is of another length or kind."""
    opcode, start, end = sample.records[rng.integers(len(sample.records))]
    huge = [10**15, 2**63, 2**64 - 1, len(sample.content), int(rng.integers(1 << 20)), 0]
    length = huge[rng.integers(len(huge))]
    if rng.random() < 0.4:
        opcode, length = int(rng.integers(256)), end - start - HEAD.size
    return sample.content[:start] + HEAD.pack(opcode, length) + sample.content[start + HEAD.size :]


def crossed(rng: np.random.Generator, sample: Sample) -> bytes:
    """A stretch comes to lie over another."""
    start, stop = _stretch(rng, sample)
    to = int(rng.integers(len(sample.content) - (stop - start) + 1))
    piece = sample.content[start:stop]
    return sample.content[:to] + piece + sample.content[to + len(piece) :]


CORRUPTIONS: dict[str, Callable[[np.random.Generator, Sample], bytes]] = {
    f.__name__: f
    for f in (flipped, zeroed, scrambled, truncated, cut_out, repeated, swapped, lying, crossed)
}


def _stretch(rng: np.random.Generator, sample: Sample) -> tuple[int, int]:
    start = int(rng.integers(len(sample.content)))
    length = int(np.exp(rng.uniform(0, np.log(len(sample.content)))))
    return start, min(start + length, len(sample.content))


class Wrong(Exception):
    """Something other than loss that is said."""


def trial(seed: int, samples: list[Sample], folder: Path) -> tuple[str, str]:
    """Damage a recording; return how, and what came of it.

    Raises
    ------
    Wrong
        When something comes out that didn't go in, or something is lost without a word.
    """
    rng = np.random.default_rng(seed)
    kind = list(CORRUPTIONS)[seed % len(CORRUPTIONS)]
    sample = samples[rng.integers(len(samples))]
    return kind, outcome(CORRUPTIONS[kind](rng, sample), sample, folder)


def outcome(content: bytes, sample: Sample, folder: Path) -> str:
    """Read, examine and recover damaged content; return what came of it. Raises as `trial`."""
    path, out = folder / "damaged.mcap", folder / "recovered.mcap"
    path.write_bytes(content)
    ask_archive(path)
    try:
        read = read_tolerantly(path, sample)
    except RsenfError:
        return "refused"
    read_strictly(path, sample)
    found = examine(path)
    if found.whole and list(read) != list(sample.messages):
        raise Wrong("called whole, and isn't")
    unnamed = check_losses(found, read, sample)
    if not read:
        with contextlib.suppress(RsenfError):
            recover(path, out, overwrite=True)
            raise Wrong("recovered out of nothing")
        return "nothing left"
    recover(path, out, overwrite=True)
    check_recovered(out, set(read), sample)
    noted = any(n.startswith("lost ") for n in open_recording(out).metadata[RECOVERED])
    if noted != bool(lost_words(found)):
        raise Wrong("the recovered file says something else of what was lost")
    close_truncated(path)
    closed = open_recording(path).messages(tolerant=True)
    # A chunk that came to lie over another is read twice, before and after.
    after = dict.fromkeys(_checked(topic, message, sample) for topic, message, _ in closed)
    if list(after) != list(read):
        raise Wrong("closing in place changes what can be read")
    if found.whole:
        return "whole"
    if unnamed:
        return "unnamed loss"
    return "lost" if len(read) < len(sample.messages) else "all"


def ask_archive(path: Path) -> None:
    """What an archive says of the file may be little, but doesn't fail."""
    for check in (False, True):
        file = ArchivedFile(0, Camera("site", "cam"), False, path)
        entry = Entry(file, summarise(path, check=check))
        asked = extent_of([entry], file.camera) or Stretch(0, 0)
        words(holding([entry], file.camera, asked), path.parent, [])


def read_tolerantly(path: Path, sample: Sample) -> dict[Key, None]:
    """Keys of what can be read, in order."""
    recording = open_recording(path)
    keys = [_checked(topic, message, sample) for topic, message, _ in
            recording.messages(tolerant=True)]  # fmt: skip
    said = bool(recording.loss) or not recording.complete
    if not said and keys != list(sample.messages):
        raise Wrong("lost, doubled or out of order without a word")
    return dict.fromkeys(keys)


def read_strictly(path: Path, sample: Sample) -> None:
    try:
        recording = open_recording(path)
        keys = [_checked(topic, message, sample) for topic, message, _ in recording.messages()]
    except RsenfError:
        return
    if recording.complete and not recording.loss and keys != list(sample.messages):
        raise Wrong("read strictly without a word, and lacks messages")


def _checked(topic: str, message: object, sample: Sample) -> Key:
    key = topic, message.header.seq  # type: ignore[attr-defined]
    if sample.messages.get(key) != encode(message):
        raise Wrong(f"{key} isn't what went in")
    return key


def check_losses(found: Examination, read: dict[Key, None], sample: Sample) -> int:
    """Return how many lost messages aren't named by topic and number."""
    lost = [key for key in sample.messages if key not in read]
    if lost and found.whole:
        raise Wrong("lost, and the examination says nothing")
    states = {state.topic.name: state for state in found.topics}
    unnamed = 0
    for topic, seq in lost:
        state = states.get(topic)
        gaps = state.gaps if state else []
        named = any(gap.first <= seq <= gap.last for gap in gaps)
        after = state is not None and (state.last_seq is None or seq > state.last_seq)
        unnamed += not (named or (after and state is not None and (state.lost_at_end or state.cut)))
    if lost and read and not lost_words(found):
        raise Wrong("lost, and not a word of it")
    return unnamed


def check_recovered(out: Path, keys: set[Key], sample: Sample) -> None:
    recording = open_recording(out)
    back = [_checked(topic, message, sample) for topic, message, _ in recording.messages()]
    if set(back) != keys or len(back) != len(keys):
        raise Wrong("what can be read isn't what is recovered")
    if not examine(out).whole:
        raise Wrong("recovered, and not whole")
    with out.open("rb") as stream:
        stored = list(make_reader(stream, validate_crcs=True).iter_messages())
    if len(stored) != len(back) + sum(topic == VIDEO for topic, _ in back):
        raise Wrong("another reader finds something else")


@contextlib.contextmanager
def bounded() -> Iterator[None]:
    """Make what takes too long or too much memory fail."""

    def too_long(_number: int, _frame: object) -> None:
        raise Wrong(f"took more than {LIMIT_S} s")

    signal.signal(signal.SIGPROF, too_long)
    signal.setitimer(signal.ITIMER_PROF, LIMIT_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)


def study(count: int, first_seed: int, folder: Path) -> tuple[Counter[tuple[str, str]], list[str]]:
    """Damage so many recordings; return what came of them, and what was wrong."""
    samples = [
        make_sample(folder, closed=closed, compress=compress)
        for closed in (True, False)
        for compress in (True, False)
    ]
    outcomes: Counter[tuple[str, str]] = Counter()
    wrong: list[str] = []
    for seed in range(first_seed, first_seed + count):
        try:
            with bounded():
                outcomes[trial(seed, samples, folder)] += 1
        except (Wrong, Exception) as exc:  # noqa: BLE001  # a crash is what is looked for
            wrong.append(f"seed {seed}: {type(exc).__name__}: {exc}")
            print(wrong[-1], file=sys.stderr, flush=True)
    return outcomes, wrong


def main(count: int, first_seed: int) -> None:
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY_BYTES,) * 2)
    begun = time.process_time()
    with tempfile.TemporaryDirectory(dir="/dev/shm") as folder:
        outcomes, wrong = study(count, first_seed, Path(folder))
    for kind in CORRUPTIONS:
        each = Counter({came: n for (k, came), n in outcomes.items() if k == kind})
        print(f"{kind:10s} {', '.join(f'{came} {n}' for came, n in each.most_common())}")
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    print(f"{len(wrong)} of {count} wrong; {time.process_time() - begun:.0f} s of processor time, "
          f"{peak_mb:.0f} MB at most")  # fmt: skip


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))

"""What rsenf reads, each declared once: how small good files are made, which are damaged, the read.

A read returns when it is done, or raises an error; those of rsenf are refusals.
"""

from __future__ import annotations

import contextlib
import functools
import gzip
import io
import json
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple
from unittest import mock

import numpy as np

sys.path.extend(str(Path(__file__).parent / room) for room in ("run", "record"))

from rsenf.cli import main
from rsenf.errors import RsenfError
from tests.fuzz_bus import ask, make_messages, take_messages

ROOT = Path(__file__).resolve().parent.parent
GOLDEN = ROOT / "recordings" / "weak_cfl.mcap"
GOLDEN_SIZE = 90  # frames: three seconds
DATED_NS = 1_768_471_200 * 10**9  # 2026-01-15T10:00:00Z; of all files, too: indexes compare it
FREQ_HZ = np.round(50.0 + 0.01 * np.sin(np.arange(90) / 7.0), 4)


class Reader(NamedTuple):
    """Something that reads: how to make its files in a folder, which to damage, how to read."""

    make: Callable[[Path], object]
    damaged: str  # pattern of names, as of Path.rglob
    read: Callable[[Path], object]


def command(*lines: str) -> Callable[[Path], None]:
    """A read by commands; ``{}`` stands for the folder."""

    def read(folder: Path) -> None:
        for line in lines:
            call(*(word.replace("{}", str(folder)) for word in line.split()))

    return read


def call(*words: str) -> None:
    """Run the command line in this process; a failure it words clearly raises an RsenfError."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main(words)
    if code in (1, 2):
        assert out.getvalue() or err.getvalue(), f"exit code {code} without a word"
        lines = err.getvalue().splitlines()
        assert all(line.startswith(("rsenf: ", "note: ")) for line in lines), err.getvalue()
        raise RsenfError(lines[-1] if lines else out.getvalue())
    assert code in (0, 3), f"exit code {code}"


def rows_of(frames: int = 64, rows: int = 24) -> dict[str, Any]:
    phase = 2 * np.pi * 100 * (np.arange(frames)[:, None] + 0.7 * np.arange(rows) / rows) / 29.97
    level = 120 + 30 * np.cos(phase) + np.random.default_rng(1).normal(0, 1, phase.shape)
    return {"rows": level.astype(np.float32), "frame_time_s": np.arange(frames) / 29.97}


def npz(name: str, arrays: Callable[[], dict[str, Any]]) -> Callable[[Path], None]:
    return lambda folder: np.savez(folder / name, **arrays())


def table() -> str:
    times = (np.datetime64("2026-01-15T10:00:00") + np.arange(90)).astype(str)
    cells = [f"{t}Z,{f}" for t, f in zip(times, FREQ_HZ, strict=True)]
    return "\n".join(["time,frequency", *cells, ""])


def text(name: str, content: Callable[[], str]) -> Callable[[Path], None]:
    return lambda folder: (folder / name).write_text(content(), encoding="utf-8")


def make_parquet(folder: Path) -> None:
    import pyarrow as pa
    import pyarrow.parquet

    columns = {"time": np.datetime64("2026-01-15T10:00:00") + np.arange(90), "frequency": FREQ_HZ}
    pa.parquet.write_table(
        pa.table(columns), folder / "a.parquet", compression="none", use_dictionary=False
    )


def make_wav(folder: Path) -> None:
    import wave

    tone = np.sin(2 * np.pi * 50.02 * np.arange(20 * 400) / 400)
    with wave.open(str(folder / "a.wav"), "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(400)
        file.writeframes((tone * 20_000).astype("<i2").tobytes())


def make_store(folder: Path) -> None:
    text("a.csv", table)(folder)
    call("reference", "import", f"{folder}/a.csv", "--grid", "ce", "--store", f"{folder}/store")


def follow(folder: Path) -> None:
    from rsenf.reference.live.growing import follow_table
    from rsenf.reference.readings import ReadOptions

    list(follow_table(folder / "a.csv", "ce", ReadOptions(), lambda: True))


def video(suffix: str, encoder: str = "libx264") -> Callable[[Path], object]:
    def make(folder: Path) -> object:
        from tests.decode.decode_clips import make_clip, pictures

        options = {"qp": "30", "bf": "2"} if encoder == "libx264" else {}
        return make_clip(folder / f"a.{suffix}", pictures(12), encoder, options=options)

    return make


def make_recording(folder: Path) -> None:
    """The first seconds of a golden recording, uncompressed; and the grid's frequency as CSV."""
    from rsenf.record import Recorder, open_recording
    from rsenf.record.growing import ABOUT

    source = open_recording(GOLDEN)
    path, about = folder / "a.mcap", source.metadata[ABOUT]
    with Recorder(path, run_info=about, clock_ns=lambda: DATED_NS, compress=False) as recorder:
        for topic, message, _ in source.messages():
            if "reference" in topic and not message.header.is_end:
                lines = [f"{(message.t0_ns // 10**9) + k},{f}" for k, f in
                         enumerate(message.freq_hz)]  # fmt: skip
                (folder / "grid.csv").write_text("\n".join(["time,frequency", *lines, ""]))
            if "reference" in topic or message.header.frame_last < GOLDEN_SIZE:
                recorder.write(topic, message)
                if topic.endswith("rows") and message.header.seq % 8 == 7:
                    recorder.flush()


def replay(folder: Path) -> None:
    from rsenf.run.replay.player import Player, Playing

    for topics in ((), ("cam/frames",)):
        playing = Playing(topics=topics, loop=2)
        for _ in Player(folder / "a.mcap", playing, run_id="new", clock_ns=lambda: DATED_NS):
            pass


def make_archive(folder: Path) -> None:
    make_recording(folder)
    day = folder / "archive/golden/cam/2026-01-15"
    day.mkdir(parents=True)
    os.replace(folder / "a.mcap", day / "100000.000000Z.mcap")
    os.utime(day / "100000.000000Z.mcap", ns=(DATED_NS, DATED_NS))
    call("archive", f"{folder}/archive")
    alarm = {"from_ns": DATED_NS, "to_ns": DATED_NS + 10**9, "why": "stale"}
    (day.parent / "alarms.jsonl").write_text(f"{json.dumps(alarm)}\n" * 3)


def read_archive(folder: Path) -> None:
    from rsenf.record.archive.alarms import alarms_of
    from rsenf.record.archive.layout import Camera

    alarms_of(folder / "archive", Camera("golden", "cam"))
    words = ["--camera", "cam", "--from", "2026-01-15T10:00", "--to", "2026-01-15T10:01"]
    call("archive", f"{folder}/archive")
    call("archive", f"{folder}/archive", *words)


@functools.cache
def phone() -> Any:
    """The idle period of a simulated camera."""
    import rsenf

    clip = rsenf.simulate(duration_s=20, seed=3, size=(64, 96), idle_ratio=0.3)
    return rsenf.idle(clip.rows, frame_time_s=clip.frame_time_s)


def make_cameras(folder: Path) -> None:
    from rsenf import add_camera

    for name in ("phone", "door"):
        add_camera(name, phone(), store=folder)


def identify(folder: Path) -> None:
    from rsenf import identify_camera

    call("camera", "list", "--store", str(folder), "--json")
    str(identify_camera(phone(), store=folder))


@contextlib.contextmanager
def in_this_process() -> Iterator[None]:
    """The processes of a batch would cost a second each."""
    from rsenf.batch.pool import Done

    def worked(tasks: Any, work: Any, *_: Any) -> Iterator[Any]:
        return (Done(task, work(task), 1) for task in tasks)

    with mock.patch("rsenf.batch.run.worked", worked):
        yield


def batch(folder: Path) -> None:
    with in_this_process():
        call("batch", "track", f"{folder}/in", "--out", f"{folder}/out", "--jobs", "1")


def make_batch(folder: Path) -> None:
    (folder / "in").mkdir()
    for name in ("a", "b"):
        npz(f"in/{name}.npz", rows_of)(folder)
        os.utime(folder / f"in/{name}.npz", ns=(DATED_NS, DATED_NS))
    batch(folder)


def begun(folder: Path) -> None:
    """The checkpoints of a long run: what can't be read is computed again."""
    from rsenf.api.recordings import Begun

    kept = Begun(folder, "x").kept(b"", rows_of)
    assert kept.keys() == rows_of().keys() or all(isinstance(v, np.ndarray) for v in kept.values())


def make_foreign(folder: Path) -> None:
    from foreign_damage import samples

    for form, content in samples().items():
        (folder / f"{form.replace(' ', '_')}.mcap").write_bytes(content)


def import_foreign(folder: Path) -> None:
    """Each form of picture; what can't be read of one is no reason not to try the next."""
    refused: list[RsenfError] = []
    for path in sorted(folder.glob("[!n]*.mcap")):
        try:
            call("import", str(path), "--out", f"{folder}/new-{path.name}")
        except RsenfError as exc:
            refused.append(exc)
    if refused:
        raise refused[0]


def make_case(folder: Path) -> None:
    fields = ("case", "exhibit", "examiner", "laboratory", "received")
    (folder / "case.yaml").write_text("".join(f"{name}: {name} 7/26\n" for name in fields))


def read_case(folder: Path) -> None:
    from rsenf.config.schemas import load_case

    load_case(folder / "case.yaml")


MODEL = (ROOT / "configs/model/phone_moving.yaml").read_text().replace("720", "24")
GRAPH = (ROOT / "configs/three-hosts.yaml").read_text()
REFERENCE_NAMES = {"csv": "a.csv", "csv.gz": "a.csv.gz", "parquet": "a.parquet", "wav": "a.wav"}


def reference(name: str) -> Callable[[Path], object]:
    from rsenf.reference import read_reference

    return lambda folder: read_reference(folder / name)


def make_days() -> dict[str, Any]:
    values = np.tile(FREQ_HZ[:48], (3, 1))
    return {
        "frequency": values,
        "day": ["2026-01-15", "2026-01-16", "2026-01-17"],
        "step_s": 1800.0,
    }


SIMULATE = "simulate --model {}/a.yaml --duration-s 0.3 --out {}/a.npz"
STORE = tuple(f"reference {words} --store {{}}/store" for words in (
    "list", "info ce", "export ce --out {}/b.csv", "import {}/a.csv --grid ce",
))  # fmt: skip
RECORDING = "a.mcap"

READERS: dict[str, Reader] = {
    "npz": Reader(npz("a.npz", rows_of), "a.npz", command("track {}/a.npz --nominal-hz 50")),
    "csv": Reader(text("a.csv", table), "a.csv", reference("a.csv")),
    "csv.gz": Reader(
        lambda folder: (folder / "a.csv.gz").write_bytes(gzip.compress(table().encode())),
        "a.csv.gz", reference("a.csv.gz"),
    ),
    "parquet": Reader(make_parquet, "a.parquet", reference("a.parquet")),
    "wav": Reader(make_wav, "a.wav", reference("a.wav")),
    "days": Reader(npz("a.npz", make_days), "a.npz", reference("a.npz")),
    "followed csv": Reader(text("a.csv", table), "a.csv", follow),
    "store": Reader(make_store, "store/**/*", command(*STORE)),
    "mp4": Reader(video("mp4"), "a.mp4", command("track {}/a.mp4 --nominal-hz 50")),
    "mkv": Reader(video("mkv"), "a.mkv", command("track {}/a.mkv --nominal-hz 50")),
    "avi": Reader(video("avi", "mjpeg"), "a.avi", command("track {}/a.avi --nominal-hz 50")),
    "ts": Reader(video("ts"), "a.ts", command("track {}/a.ts --nominal-hz 50")),
    "doctor": Reader(make_recording, RECORDING, command("doctor {}/a.mcap")),
    "recover": Reader(make_recording, RECORDING, command("recover {}/a.mcap --out {}/b.mcap")),
    "export": Reader(
        make_recording, RECORDING, command("export {}/a.mcap --topic rows --out {}/b.csv")
    ),
    "replay": Reader(make_recording, RECORDING, replay),
    "regress": Reader(make_recording, RECORDING, command("regress {}/a.mcap")),
    "track": Reader(make_recording, RECORDING, command("track {}/a.mcap --from track")),
    "live": Reader(make_recording, "*.*", command("live {}/a.mcap --reference {}/grid.csv")),
    "verify": Reader(make_recording, "*.*", command("verify {}/a.mcap --reference {}/grid.csv")),
    "archive": Reader(make_archive, "archive/**/*", read_archive),
    "import": Reader(make_foreign, "*.mcap", import_foreign),
    "cameras": Reader(make_cameras, "cameras.json", identify),
    "batch": Reader(make_batch, "**/*.[nj]*", batch),
    "checkpoint": Reader(begun, "*.npz", begun),
    "graph": Reader(text("a.yaml", lambda: GRAPH), "a.yaml", command("validate {}/a.yaml --json")),
    "model": Reader(text("a.yaml", lambda: MODEL), "a.yaml", command(SIMULATE)),
    "case": Reader(make_case, "case.yaml", read_case),
    "bus": Reader(make_messages, "*.*", take_messages),
    "asked": Reader(text("asked.json", lambda: '{"feed": "lab/cam", "series": "recent"}'),
                    "asked.json", ask),
}  # fmt: skip

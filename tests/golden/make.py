"""Makes the golden recordings anew, from their seeds: python -m tests.golden.make [NAME …].

What stages make of a golden recording changes by 'rsenf regress --accept --reason …', which keeps
the video; then only the checksums are to be written anew, with --sums. This is for another scene,
or another form of recording; the history starts anew with it.
"""

from __future__ import annotations

import argparse
import hashlib
import sys
import tempfile
from pathlib import Path

import numpy as np
import yaml

from rsenf.config import Graph, shown
from rsenf.decode.source import SourceSpec, open_source
from rsenf.messages import Frame, Header, Mark, ReferenceBlock, VideoPacket
from rsenf.model import GridPath, render_frames, synthetic_grid, write_video
from rsenf.record import Recorder
from rsenf.reference import Reference, reference_blocks
from rsenf.regress.accept import complete
from rsenf.timebase import NS_PER_S
from rsenf.whole_file import whole_file
from tests.golden.golden_scenes import SCENES, SECONDS, Looped, Scene

FOLDER = Path(__file__).resolve().parents[2] / "recordings"
SUMS = "SHA256SUMS"
RUN_ID, SITE, CAMERA, GRID = "golden", "golden", "cam", "grid"
BEGINS_NS = 1_768_471_200 * NS_PER_S  # 2026-01-15T10:00:00Z, by everybody's clock
REFERENCE_S = 600


def make(scene: Scene, path: Path) -> None:
    """Film a scene, record it with the grid's reference, and run the stages on it."""
    freq_hz = synthetic_grid(scene.seed, REFERENCE_S, nominal_hz=scene.nominal_hz).freq_hz
    freq_hz = freq_hz[:REFERENCE_S].round(6)
    grid = GridPath(freq_hz, 1.0, start_of(scene), scene.nominal_hz)
    frames = render_frames(scene.model, grid, SECONDS, scene.seed)
    film = Looped(frames, scene.loops_s) if scene.loops_s else frames
    with tempfile.TemporaryDirectory() as folder:
        clip = Path(folder) / "clip.mp4"
        write_video(clip, film, scene.model.codec)
        with Recorder(
            path, run_info=_about(scene), clock_ns=lambda: BEGINS_NS, overwrite=True
        ) as recorder:
            recorder.add_metadata("rsenf.golden", {"scene": scene.name, "seed": scene.seed})
            _record_reference(recorder, freq_hz, scene.nominal_hz)
            _record_video(recorder, clip)
    complete(path)


def start_of(scene: Scene) -> float:
    """Seconds into the reference at which a scene's film begins: the truth about it."""
    return float(np.random.default_rng(scene.seed).uniform(0, REFERENCE_S - SECONDS - 1))


def _about(scene: Scene) -> dict[str, str]:
    cameras = {"cameras": [CAMERA]}
    graph = Graph.model_validate({
        "version": 1,
        "site": SITE,
        "nodes": {
            "decode": {"kind": "decode", "camera": CAMERA, "input": "clip.mp4", "frames": "fused"},
            "track": {"kind": "track", **cameras},
            "idle": {"kind": "idle", **cameras},
            "reference": {"kind": "reference", "grid": GRID, "input": "reference.csv"},
            "match": {"kind": "match", **cameras, "grid": GRID, "interim_every_s": 15.0},
            **scene.stages,
        },
    })  # fmt: skip
    config = yaml.safe_dump(shown(graph), sort_keys=False)
    where = {"host": "any", "platform": "any"}
    return {"run_id": RUN_ID, "site": SITE, "config": config, **where}


def _record_reference(
    recorder: Recorder, freq_hz: np.ndarray[tuple[int], np.dtype[np.float64]], nominal_hz: float
) -> None:
    readings = np.ones(freq_hz.size, np.uint32)
    reference = Reference(GRID, nominal_hz, BEGINS_NS, 1.0, freq_hz, readings)
    topic, header = f"rsenf/{SITE}/reference/{GRID}", Header()
    for block in reference_blocks(reference, source=f"reference/{GRID}", run_id=RUN_ID):
        recorder.write(topic, block)
        header = block.header
    recorder.write(topic, ReferenceBlock(header=header.numbered(header.seq + 1, Mark.END)))


def _record_video(recorder: Recorder, clip: Path) -> None:
    topic, header = f"rsenf/{SITE}/{CAMERA}/video", Header()
    with open_source(
        SourceSpec(url=str(clip), kind="file", with_packets=True),
        source=f"{SITE}/{CAMERA}",
        run_id=RUN_ID,
        clock_ns=lambda: BEGINS_NS,
    ) as source:
        for item in source:
            if not isinstance(item, Frame):
                recorder.write(topic, item)
                header = item.header
    recorder.write(topic, VideoPacket(header=header.numbered(header.seq + 1, Mark.END)))


def write_sums(folder: Path) -> None:
    """Write the checksums of all recordings, as ``sha256sum -c`` reads them."""
    sums = (
        f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.name}\n"
        for path in sorted(folder.glob("*.mcap"))
    )
    (folder / SUMS).write_text("".join(sums), encoding="utf-8")


def main() -> None:
    """Make those named, or all, and write the checksums."""
    parser = argparse.ArgumentParser(prog="python -m tests.golden.make")
    parser.add_argument("names", nargs="*", metavar="NAME", help="of a scene (all)")
    parser.add_argument("--sums", action="store_true", help="write the checksums only")
    args = parser.parse_args()
    if unknown := set(args.names) - {scene.name for scene in SCENES}:
        parser.error(f"no scene {', '.join(sorted(unknown))}")
    for scene in () if args.sums else SCENES:
        if not args.names or scene.name in args.names:
            path = FOLDER / f"{scene.name}.mcap"
            with whole_file(path) as part:
                make(scene, part)
            print(f"{path.name}: {path.stat().st_size / 1e6:.2f} MB", file=sys.stderr)
    write_sums(FOLDER)


if __name__ == "__main__":
    main()

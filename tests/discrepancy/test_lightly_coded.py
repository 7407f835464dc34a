"""A small picture at a high rate: its rows hang together too little to be seen, and yet enough."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rsenf.bench.discover.trial import sampled
from rsenf.discrepancy.start import PLAIN
from rsenf.discrepancy.verdict import discover
from rsenf.model import CaptureModel, Light, Shutter, render_frames, synthetic_grid
from rsenf.model.video_file import Codec, write_video
from rsenf.run.simulated import is_lossy

SECONDS = 26.0


def film(path: Path, codec: Codec, seconds: float = SECONDS) -> Path:
    shutter = Shutter(rows=144, columns=256, idle_ratio=0.3)
    model = CaptureModel(light=Light(lamp="tone"), shutter=shutter)
    grid = synthetic_grid(31, SECONDS + 10.0, start_s=4.0)
    write_video(path, render_frames(model, grid, seconds, 31), codec)
    return path


def test_what_its_codec_does_is_foretold_and_named_for_nothing(tmp_path: Path) -> None:
    clip = film(tmp_path / "clip.mp4", Codec(bitrate_bps=2_500_000))
    data, again = sampled(clip)
    assert not data.coded
    assert again is not None
    found = discover(PLAIN, data, recoded=again)
    assert found.verdict == "no_discrepancy"
    assert discover(PLAIN, data).verdict == "unexplained"  # to who doesn't know of the codec
    gap = found.last.gap.value
    assert found.baseline.gap / 3.0 < gap < 3.0 * found.baseline.gap


@pytest.mark.parametrize(
    ("name", "codec", "lossy"),
    [
        ("a.mp4", Codec(), True),
        ("a.mp4", Codec(lossless=True), False),
        ("a.mkv", Codec(name="h265"), True),
        ("a.mkv", Codec(name="vp9", bitrate_bps=100_000), True),
        ("a.avi", Codec(name="mjpeg"), True),
    ],
)
def test_whether_a_codec_takes_something_away(
    name: str, codec: Codec, lossy: bool, tmp_path: Path
) -> None:
    assert is_lossy(film(tmp_path / name, codec, 0.3)) is lossy


def test_what_is_no_video_is_not_coded(tmp_path: Path) -> None:
    np.savez(tmp_path / "rows.npz", rows=np.zeros((3, 3)))
    assert not is_lossy(tmp_path / "rows.npz")
    assert not is_lossy(tmp_path / "nothing.mp4")

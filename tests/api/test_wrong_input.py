"""What can't be meant is one clear line."""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rsenf
from rsenf.errors import RsenfError
from rsenf.track import TrackSettings


def bomb(path: Path) -> Path:
    """Write an archive of a few megabytes that unpacks to gigabytes."""
    header = {"descr": "<f8", "fortran_order": False, "shape": (2**27 + 2**20, 1)}
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("rows.npy", "w", force_zip64=True) as part,
    ):
        np.lib.format.write_array_header_1_0(part, header)
        for _ in range(1040):
            part.write(bytes(2**20))
    return path


ROWS, TIME_S = np.full((90, 12), 100.0), np.arange(90) / 30.0
GRID_HZ = np.full(600, 50.01)


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: rsenf.track("gone.mp4"), "gone.mp4: no such file"),
        (lambda: rsenf.track("gone.mp4", frame_time_s=[0.0, 1.0]), "has times of its own"),
        (lambda: rsenf.track(ROWS), "arrays need their times"),
        (lambda: rsenf.track(ROWS, frame_time_s=TIME_S, frame_rate_hz=30.0), "either"),
        (lambda: rsenf.track(ROWS, frame_time_s=TIME_S[:9]), "don't fit"),
        (lambda: rsenf.track(ROWS, frame_time_s=TIME_S[::-1]), "does not rise throughout"),
        (lambda: rsenf.track(1e38 * ROWS, frame_time_s=TIME_S), "at most 1e+06 are read"),
        (lambda: rsenf.track(ROWS, frame_time_s=1e300 * TIME_S), "holds times of"),
        (lambda: rsenf.track(ROWS[:, 0], frame_rate_hz=-1.0), "one number above 0"),
        (lambda: rsenf.track(ROWS, frame_rate_hz=0.0), "above 0"),
        (lambda: rsenf.track(["a", "b"], frame_rate_hz=30.0), "not numbers"),
        (lambda: rsenf.track(ROWS, frame_rate_hz=30.0, method="magic"), "no ENF method 'magic'"),
        (
            lambda: rsenf.track(ROWS, frame_rate_hz=30.0, settings=TrackSettings(harmonic=2)),
            "projection takes no harmonic",
        ),
        (lambda: rsenf.track(ROWS, frame_rate_hz=30.0, nominal_hz=55.0), "50 or 60"),
        (lambda: rsenf.idle(ROWS, frame_rate_hz=30.0, method="magic"), "no idle method 'magic'"),
        (lambda: rsenf.verify(ROWS, GRID_HZ, frame_rate_hz=30.0), "give step_s"),
        (
            lambda: rsenf.verify(ROWS, GRID_HZ * 2, frame_rate_hz=30.0, step_s=1.0),
            "halve it",
        ),
        (
            lambda: rsenf.verify(ROWS, GRID_HZ[:2], frame_rate_hz=30.0, step_s=1.0),
            "covers 2.0 s, less than",
        ),
        (
            lambda: rsenf.verify(ROWS, GRID_HZ, frame_rate_hz=30.0, step_s=1.0, method="magic"),
            "no match method 'magic'",
        ),
        (
            lambda: rsenf.verify(
                ROWS, GRID_HZ, frame_rate_hz=30.0, step_s=1.0, method="metric1",
                track=TrackSettings("stft"),
            ),
            "metric1 compares the hypotheses of the ENF method paper, not stft",
        ),
        (lambda: rsenf.verify(ROWS, "gone.csv", frame_rate_hz=30.0), "no reference file gone.csv"),
        (
            lambda: rsenf.verify(ROWS, "gone.csv", frame_rate_hz=30.0, time_format="dd.mm.yyyy"),
            "no format of times",
        ),
        (lambda: rsenf.live(ROWS, frame_rate_hz=30.0, start="2026-01-15"), "nothing to compare"),
        (lambda: rsenf.live(ROWS, GRID_HZ, frame_rate_hz=30.0, step_s=1.0), "when its pictures"),
        (
            lambda: rsenf.live(ROWS, GRID_HZ, frame_rate_hz=30.0, step_s=1.0, start="2026-01-15"),
            "has no times of day",
        ),
        (
            lambda: rsenf.verify(
                ROWS, GRID_HZ, frame_rate_hz=30.0, step_s=1.0, report=Path("report")
            ),
            "a report tells of a file",
        ),
        (
            lambda: rsenf.verify(
                ROWS, GRID_HZ, frame_rate_hz=30.0, step_s=1.0, picture=Path("gone") / "x.png"
            ),
            "no such folder",
        ),
        (lambda: rsenf.simulate("clip.txt", duration_s=1), "not a video file's name"),
        (lambda: rsenf.simulate(duration_s=1, lamp="moon"), "moon"),
    ],
)  # fmt: skip
def test_one_line(call: Callable[[], Any], said: str) -> None:
    with pytest.raises(RsenfError) as caught:
        call()
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_archive_that_unpacks_to_gigabytes_is_not_read(tmp_path: Path) -> None:
    path = bomb(tmp_path / "bomb.npz")
    with pytest.raises(RsenfError, match=r"would unpack to 1\.0 GiB from \d+ bytes"):
        rsenf.track(path)
    with pytest.raises(RsenfError, match="would unpack"):
        rsenf.verify(ROWS, path, frame_rate_hz=30.0)

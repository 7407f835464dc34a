"""Films as files: FFmpeg encodes them without loss."""

from __future__ import annotations

import subprocess
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter1d

from .camera import FULL, take
from .cases import Case, drawn_for, plan_of

LEAST_ROWS, MOST_ROWS, COLUMNS, CHUNK = 160, 240, 128, 64
ENCODE = (
    "-c:v",
    "libx264",
    "-preset",
    "ultrafast",
    "-qp",
    "0",
    "-pix_fmt",
    "yuv420p",
    "-color_range",
    "pc",
)


def video_case(case: Case) -> Case:
    """Return the case that `as_video` films: of no more rows than are encoded.

    `film` of it tells the truth about the file.
    """
    rows = min(max(case.rows, LEAST_ROWS), MOST_ROWS)
    return replace(case, rows=rows - rows % 2)


def as_video(case: Case, path: Path | str) -> None:
    """Film a case into a file, 128 columns wide, as 8-bit luma that is coded without loss.

    Each strip has a texture over its columns, and each pixel its own noise. Frames get stamps at
    a constant rate: a case whose stamps are something else can't be a file.
    """
    case = video_case(case)
    plan, _ = plan_of(case)
    regular_s = np.arange(len(plan.stamp_s)) / plan.sensor.frame_rate
    if np.abs(plan.stamp_s - regular_s).max() > 1e-9:
        raise ValueError("a file's frames have stamps at a constant rate, which these don't")
    level = take(plan, drawn_for(case, "noise"), noisy=False)
    rng = drawn_for(case, "pixels")
    texture = _texture(rng, plan.rows, plan.strips)
    strip = np.arange(COLUMNS) * plan.strips // COLUMNS
    per_electron = FULL / plan.sensor.well_electrons
    read_level = plan.sensor.read_electrons * per_electron
    chroma = np.full(plan.rows * COLUMNS // 2, 128, dtype=np.uint8)
    rate = Fraction(plan.sensor.frame_rate).limit_denominator(1001)
    command = ["ffmpeg", "-loglevel", "error", "-y", "-f", "rawvideo", "-pix_fmt", "yuv420p"]
    command += ["-color_range", "pc", "-s", f"{COLUMNS}x{plan.rows}", "-r", str(rate), "-i", "-"]
    command += [*ENCODE, str(path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as encoder:
        assert encoder.stdin is not None
        for first in range(0, len(level), CHUNK):
            part = level[first : first + CHUNK, :, strip] * texture
            pixel = np.sqrt(np.clip(part, 0, None) * per_electron + read_level**2)
            part = part + pixel * rng.standard_normal(part.shape, dtype=np.float32)
            for luma in np.clip(np.rint(part), 0, FULL).astype(np.uint8):
                encoder.stdin.write(luma.tobytes() + chroma.tobytes())
        _, told = encoder.communicate()
    if encoder.returncode:
        raise RuntimeError(f"ffmpeg: {told.decode(errors='replace').strip()}")


def _texture(rng: np.random.Generator, rows: int, strips: int) -> np.ndarray:
    """Factor of each pixel, whose mean over a strip's columns is one in each row."""
    grain = gaussian_filter1d(rng.standard_normal((rows, COLUMNS)), 1.5, axis=1)
    smooth = gaussian_filter1d(rng.standard_normal((rows, COLUMNS)), 12.0, axis=1)
    texture = np.exp(0.04 * grain + 0.2 * gaussian_filter1d(smooth, 6.0, axis=0))
    strip = np.arange(COLUMNS) * strips // COLUMNS
    for index in range(strips):
        within = texture[:, strip == index]
        texture[:, strip == index] = within / within.mean(axis=1, keepdims=True)
    return np.asarray(texture, dtype=np.float32)

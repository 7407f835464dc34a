"""Films as files: FFmpeg encodes them without loss."""

from __future__ import annotations

import subprocess
import tempfile
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter1d

from .camera import FULL, take
from .cases import Case, drawn_for, plan_of
from .filters import FILTERS

LEAST_ROWS, MOST_ROWS, COLUMNS, CHUNK = 160, 240, 128, 64
# How a film is coded, in FFmpeg's words, at sizes of some 100 000 pixels.
CODINGS = {
    "lossless": "-c:v libx264 -preset ultrafast -qp 0",
    "camera": "-c:v libx264 -preset veryfast -b:v 1500k",
    "150k": "-c:v libx264 -preset veryfast -b:v 150k",
    "50k": "-c:v libx264 -preset veryfast -b:v 50k",
    "hevc-150k": "-c:v libx265 -preset ultrafast -b:v 150k -x265-params log-level=error",
    "vp9-150k": "-c:v libvpx-vp9 -deadline realtime -cpu-used 8 -b:v 150k",
    "mpeg4-400k": "-c:v mpeg4 -b:v 400k",
}


def video_case(case: Case) -> Case:
    """Return the case that `as_video` films: of no more rows than are encoded.

    `film` of it tells the truth about the file.
    """
    rows = min(max(case.rows, LEAST_ROWS), MOST_ROWS)
    return replace(case, rows=rows - rows % 2)


def as_video(
    case: Case,
    path: Path | str,
    *,
    columns: int = COLUMNS,
    coding: str = "lossless",
) -> None:
    """Film a case into a file, as 8-bit luma.

    Each strip has a texture over its columns, and each pixel its own noise. Frames get stamps at
    a constant rate: a case whose stamps are something else can't be a file.

    Parameters
    ----------
    case : Case
    path : Path
    columns : int
        Of the picture, even.
    coding : str
        Name in `CODINGS`; without loss unless asked. What is filtered is filmed without loss, and
        coded thereafter.
    """
    if not case.filtered:
        _film_into(case, path, columns, CODINGS[coding])
        return
    with tempfile.TemporaryDirectory(prefix="filtered-") as folder:
        plain = Path(folder) / "plain.mp4"
        _film_into(case, plain, columns, CODINGS["lossless"])
        rate = Fraction(plan_of(case)[0].file_rate).limit_denominator(100000)
        passes = FILTERS[case.filtered].passes
        *before, last = (chain.format(folder=folder, rate=rate) for chain in passes)
        for chain in before:
            _run(["-i", str(plain), "-vf", chain, "-f", "null", "-"])
        # FFmpeg decodes full-range luma as yuvj420p; anything else would squeeze it.
        _run(["-i", str(plain), "-vf", last, *_coded(CODINGS[coding], path, "yuvj420p")])


def _coded(coding: str, path: Path | str, pixels: str = "yuv420p") -> list[str]:
    return [*coding.split(), "-pix_fmt", pixels, "-color_range", "pc", str(path)]


def _run(words: list[str]) -> None:
    done = subprocess.run(
        ["ffmpeg", "-loglevel", "error", "-y", *words], capture_output=True, check=False
    )
    if done.returncode:
        raise RuntimeError(f"ffmpeg: {done.stderr.decode(errors='replace').strip()}")


def _film_into(case: Case, path: Path | str, columns: int, coding: str) -> None:
    case = video_case(replace(case, filtered=""))
    plan, _ = plan_of(case)
    file_rate = plan.file_rate or plan.sensor.frame_rate
    regular_s = np.arange(len(plan.stamp_s)) / file_rate
    if np.abs(plan.stamp_s - regular_s).max() > 1e-9:
        raise ValueError("a file's frames have stamps at a constant rate, which these don't")
    arrive, mix = plan.arrive, plan.mix
    plan.arrive, plan.mix = np.arange(plan.frames), None
    level = take(plan, drawn_for(case, "noise"), noisy=False)
    rng = drawn_for(case, "pixels")
    texture = _texture(rng, plan.rows, plan.strips, columns)
    strip = np.arange(columns) * plan.strips // columns
    per_electron = FULL / plan.sensor.well_electrons
    read_level = plan.sensor.read_electrons * per_electron
    noise_seed = int(rng.integers(2**32))

    def picture(frame: int) -> np.ndarray:
        """As the sensor has it: a frame that comes twice has the same noise twice."""
        part = level[frame][:, strip] * texture
        pixel = np.sqrt(np.clip(part, 0, None) * per_electron + read_level**2)
        noise = np.random.default_rng([noise_seed, frame])
        part = part + pixel * noise.standard_normal(part.shape, dtype=np.float32)
        return np.asarray(np.clip(np.rint(part), 0, FULL))

    chroma = np.full(plan.rows * columns // 2, 128, dtype=np.uint8)
    rate = Fraction(file_rate).limit_denominator(1001)
    command = ["ffmpeg", "-loglevel", "error", "-y", "-f", "rawvideo", "-pix_fmt", "yuv420p"]
    command += ["-color_range", "pc", "-s", f"{columns}x{plan.rows}", "-r", str(rate), "-i", "-"]
    command += _coded(coding, path)
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as encoder:
        assert encoder.stdin is not None
        for index, frame in enumerate(arrive.tolist()):
            shown = picture(frame)
            if mix is not None:
                share = mix[1][index]
                shown = np.rint((1 - share) * shown + share * picture(int(mix[0][index])))
            encoder.stdin.write(shown.astype(np.uint8).tobytes() + chroma.tobytes())
        _, told = encoder.communicate()
    if encoder.returncode:
        raise RuntimeError(f"ffmpeg: {told.decode(errors='replace').strip()}")


def _texture(rng: np.random.Generator, rows: int, strips: int, columns: int) -> np.ndarray:
    """Factor of each pixel, whose mean over a strip's columns is one in each row."""
    grain = gaussian_filter1d(rng.standard_normal((rows, columns)), 1.5, axis=1)
    smooth = gaussian_filter1d(rng.standard_normal((rows, columns)), 12.0, axis=1)
    texture = np.exp(0.04 * grain + 0.2 * gaussian_filter1d(smooth, 6.0, axis=0))
    strip = np.arange(columns) * strips // columns
    for index in range(strips):
        within = texture[:, strip == index]
        texture[:, strip == index] = within / within.mean(axis=1, keepdims=True)
    return np.asarray(texture, dtype=np.float32)

"""What ``rsenf track`` and ``rsenf idle`` say of films that FFmpeg edited, coded and wrapped.

``python -m tests.real.edited FIRST LAST`` films these seeds with a camera that shares no code with
rsenf: a texture under a lamp whose phase follows a measured grid, shot noise, a tone curve, and in
some films a moving box and a shaken hand. FFmpeg's filters, encoders and containers do the rest. It
prints a line for each film: errors beside the truth, and over the stated ones (z). With
``--effort full fast`` each is decoded both ways.
"""

from __future__ import annotations

import argparse
import gzip
import json
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter

from tests.conftest import DATA

HEIGHT, WIDTH = 240, 320
RATES = ("24000/1001", "24", "25", "30000/1001", "30", "29.7", "50", "60000/1001", "60")
# {rate} is the film's. Each keeps times and rows, or says by how much it moves them.
FILTERS = {
    "none": "null",
    "letterbox": "pad=320:320:0:40",
    "pillarbox": "pad=480:240:80:0",
    "denoised": "hqdn3d=4:3:6:4.5",
    "sharpened": "unsharp=5:5:1.0",
    "interlaced, woven": "interlace,bwdif=1",
    "blurred": "avgblur=8",
    "darkened": "eq=brightness=-0.35",
    "curve": "eq=gamma=1.6:contrast=1.2",
    "normalised": "normalize=smoothing=30",
    "noise": "noise=alls=12:allf=t",
    "smaller": "scale=160:120",
    "upside down": "hflip,vflip",
    "zoom": "zoompan=z='1+on/6000':x='iw/2-iw/zoom/2':y='ih/2-ih/zoom/2':d=1:s=320x240:fps={rate}",
    "box": "drawbox=x='mod(t*40,300)':y=100:w=60:h=60:color=white:t=fill",
}
CODERS = {
    "x264 1500k": "-c:v libx264 -preset veryfast -b:v 1500k",
    "x264 400k": "-c:v libx264 -preset medium -b:v 400k",
    "x264 crf28": "-c:v libx264 -preset fast -crf 28",
    "x265 400k": "-c:v libx265 -preset fast -b:v 400k -x265-params log-level=error",
    "mpeg4 800k": "-c:v mpeg4 -b:v 800k",
    "mjpeg": "-c:v mjpeg -q:v 4 -pix_fmt yuvj420p",
}
# And their ticks: Matroska's are a millisecond, some cameras' QuickTime has 600 a second.
CONTAINERS = {"mp4": "", "mkv": "", "mov": "-video_track_timescale 600", "avi": ""}
Line = dict[str, Any]


@dataclass(frozen=True)
class Edited:
    """A film and what became of it; drawn from a seed, unless given."""

    seed: int
    rate: str
    nominal_hz: float
    seconds: float
    edit: str
    coder: str
    container: str
    idle_ratio: float
    exposure_s: float
    flicker_ratio: float
    second_ratio: float
    moves: bool

    def line(self, lit: Light, folder: Path, effort: str = "full") -> Line:
        """Film it, and tell what is said of it beside what is true."""
        path = folder / f"{self.seed}.{self.container}"
        self._film(lit, path)
        told: Line = {"film": self, "effort": effort}
        track = [json.loads(line) for line in _said("track", path, effort).splitlines()]
        usable = [e for e in track if e["enf_hz"] is not None]
        if usable:
            from_s = np.array([e["t_s"] - 0.5 for e in usable])
            off_hz = np.array([e["enf_hz"] for e in usable]) - lit.mean_hz(from_s, from_s + 1.0)
            z = off_hz / np.array([e["enf_std_hz"] for e in usable])
            told |= {"usable": len(usable) / len(track), "rms_hz": float(np.std(off_hz))}
            told |= {"bias_hz": float(np.mean(off_hz)), "rms_z": float(np.sqrt(np.mean(z**2)))}
        else:
            reasons = Counter(e["reason"] for e in track)
            told["reason"] = reasons.most_common(1)[0][0] if track else "no values"
        idle = json.loads(_said("idle", path, effort) or '{"verdict": "none"}')
        told["verdict"] = idle["verdict"]
        if idle["verdict"] == "estimated":
            told["idle_off"] = idle["idle_ratio"] - self.idle_ratio
            told["idle_std"] = idle["idle_ratio_std"]
        path.unlink()
        return told

    def _film(self, lit: Light, path: Path) -> None:
        words = ["-f", "rawvideo", "-pix_fmt", "gray", "-s", f"{WIDTH}x{HEIGHT}", "-r", self.rate]
        words += ["-i", "-", "-vf", FILTERS[self.edit].format(rate=self.rate), "-pix_fmt"]
        words += ["yuv420p", *CODERS[self.coder].split(), *CONTAINERS[self.container].split()]
        command = ["ffmpeg", "-loglevel", "error", "-y", *words, str(path)]
        with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as encoder:
            assert encoder.stdin is not None
            for picture in self._pictures(lit):
                encoder.stdin.write(picture.tobytes())
            _, told = encoder.communicate()
        if encoder.returncode:
            raise RuntimeError(f"ffmpeg: {told.decode(errors='replace').strip()}")

    def _pictures(self, lit: Light) -> Iterator[NDArray[np.uint8]]:
        rng = np.random.default_rng([self.seed, 1])
        grain = rng.normal(size=(2, HEIGHT + 80, WIDTH + 80))
        wall = np.exp(5.0 * gaussian_filter(grain[0], 10) + 0.4 * gaussian_filter(grain[1], 1))
        wall = np.clip(wall / wall.mean(), 0.1, 2.2)
        level, electrons = rng.uniform(60, 140), rng.uniform(20, 60)
        fps = float(Fraction(self.rate))
        row_s = np.arange(HEIGHT) / HEIGHT * (1.0 - self.idle_ratio) / fps
        for frame in range(int(self.seconds * fps)):
            light = lit.level(frame / fps + row_s, self)[:, None]
            down = across = 0
            if self.moves:
                across = int(25 + 15 * np.sin(0.7 * frame / fps) + 8 * np.sin(2.9 * frame / fps))
                down = int(22 + 12 * np.sin(0.5 * frame / fps + 1))
            picture = level * light * wall[down : down + HEIGHT, across : across + WIDTH]
            if self.moves:
                left, top = int(frame * 1.7 % (WIDTH - 60)), int(80 + 50 * np.sin(frame / fps))
                picture[top : top + 60, left : left + 60] = level * light[top : top + 60]
            sensed = picture * electrons
            sensed = sensed + np.sqrt(sensed + 25) * rng.standard_normal(sensed.shape)
            shown = 255 * np.clip(sensed / electrons / 255, 0, 1) ** (1 / 1.6)
            yield np.rint(shown).astype(np.uint8)


class Light:
    """A lamp on a stretch of a measured grid, as long as a film."""

    def __init__(self, nominal_hz: float, seconds: float, rng: np.random.Generator) -> None:
        days, step_s = _measured(nominal_hz)
        samples = int(seconds / step_s) + 10
        while True:
            day = days[rng.integers(len(days))]
            first = int(rng.integers(day.size - samples))
            off_hz = day[first : first + samples] - nominal_hz
            if np.isfinite(off_hz).all():
                break
        self._nominal_hz = nominal_hz
        self._turns = CubicSpline(np.arange(samples) * step_s, off_hz).antiderivative()
        self._phase_rad = rng.uniform(0, 2 * np.pi, 2)

    def level(self, t_s: NDArray[np.float64], film: Edited) -> NDArray[np.float64]:
        """Brightness over its mean, averaged over the exposure."""
        phase = 4 * np.pi * (self._nominal_hz * t_s + self._turns(t_s))
        first, second = np.sinc(2 * self._nominal_hz * film.exposure_s * np.array([1, 2]))
        wave = first * np.cos(phase + self._phase_rad[0])
        wave += film.second_ratio * second * np.cos(2 * phase + self._phase_rad[1])
        return np.asarray(1.0 + film.flicker_ratio * wave)

    def mean_hz(self, from_s: NDArray[np.float64], to_s: NDArray[np.float64]) -> Any:
        """Mean frequency of the grid between times."""
        turns = self._turns(to_s) - self._turns(from_s)
        return self._nominal_hz + turns / (to_s - from_s)


def _measured(nominal_hz: float) -> tuple[list[NDArray[np.float64]], float]:
    """Return measured days of a grid, Hz, and the time between values, s."""
    if nominal_hz == 60.0:
        held = np.load(DATA / "grid_us_60hz_2022-07_2s.npz")
        return [nominal_hz + day - np.round(np.nanmedian(day)) for day in held["frequency"]], 2.0
    with gzip.open(DATA / "grid_ce_2022-09-17_1s.csv.gz", "rt") as file:
        return [np.loadtxt(file, delimiter=",", usecols=1, skiprows=1)], 1.0


def drawn(seed: int) -> tuple[Edited, Light]:
    """Draw a film from its seed."""
    rng = np.random.default_rng(seed)
    nominal_hz, seconds = float(rng.choice([50.0, 60.0])), float(rng.choice([40.0, 60.0, 90.0]))
    film = Edited(
        seed=seed, rate=str(rng.choice(RATES)), nominal_hz=nominal_hz, seconds=seconds,
        edit=str(rng.choice(list(FILTERS))), coder=str(rng.choice(list(CODERS))),
        container=str(rng.choice(list(CONTAINERS))), idle_ratio=float(rng.uniform(0.02, 0.4)),
        exposure_s=float(rng.choice([5e-4, 2e-3, 4e-3, 6e-3])),
        flicker_ratio=float(10 ** rng.uniform(-2.3, -0.6)),
        second_ratio=float(rng.uniform(0, 0.4)), moves=bool(rng.random() < 0.3),
    )  # fmt: skip
    return film, Light(nominal_hz, seconds, rng)


def _said(verb: str, path: Path, effort: str) -> str:
    rsenf = str(Path(sys.executable).with_name("rsenf"))
    command = [rsenf, verb, str(path), "--json", "--effort", effort]
    return subprocess.run(command, capture_output=True, text=True, check=False).stdout


def words_of(told: Line) -> str:
    """One line of text."""
    film = told["film"]
    about = f"{film.seed} {film.edit}, {film.coder}, {film.container}, {film.rate}, "
    about += f"{film.nominal_hz:g} Hz, {100 * film.flicker_ratio:.2g} %{', moving' * film.moves}, "
    about += f"{told['effort']}: "
    said = told.get("reason") or (
        f"{told['usable']:.0%}, {1e3 * told['rms_hz']:.2f} mHz, bias {1e3 * told['bias_hz']:.2f}, "
        f"z {told['rms_z']:.2f}"
    )
    idle = told["verdict"]
    if "idle_off" in told:
        idle = f"{100 * told['idle_off']:+.3f} ± {100 * told['idle_std']:.3f} %"
    return f"{about}{said}; idle {idle}"


def main(words: list[str] | None = None) -> None:
    """Film, and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("first", type=int)
    parser.add_argument("last", type=int, help="not included")
    parser.add_argument("--effort", nargs="+", default=["full"], help="full, fast or both")
    args = parser.parse_args(words)
    with tempfile.TemporaryDirectory(prefix="edited-") as folder:
        for seed in range(args.first, args.last):
            film, lit = drawn(seed)
            for effort in args.effort:
                print(words_of(film.line(lit, Path(folder), effort)), flush=True)


if __name__ == "__main__":
    main()

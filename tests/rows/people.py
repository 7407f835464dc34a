"""Films in which people cross the view, by the foreign camera: what the mask is there for.

``python -m tests.rows.people FIRST LAST [CODING]`` films each seed with nobody, with one who walks
by twice, and with one who leans into most of the picture twice; and tells, with the mask and
without, in how many seconds an ENF is found, and the errors of it and of the idle period.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from rsenf.api.recordings import read_recording
from rsenf.rows.settings import AUTO, RowsSettings
from tests.discrepancy.foreign_camera import CODINGS, Case
from tests.discrepancy.foreign_camera.camera import FULL, light, moment_of
from tests.discrepancy.foreign_camera.cases import MOVING, drawn_for, plan_of
from tests.discrepancy.foreign_camera.plan import Plan
from tests.flicker.claims import Claims, claims

SCENES = ("nobody", "walks", "leans")
ROWS, COLUMNS, STRIPS, SECONDS = 240, 256, 8, 24.0
LEAST_RATIO, MOST_RATIO = 2e-3, 5e-2  # of the flicker
Picture = NDArray[np.float64]


class Person:
    """Somebody in textured clothes, lit by the same lamp.

    Parameters
    ----------
    rng : Generator
    leans : bool
        From below into most of the picture; else walks by at some distance.
    """

    def __init__(self, rng: np.random.Generator, *, leans: bool) -> None:
        self._leans = leans
        self._tall = ROWS * (rng.uniform(1.0, 1.3) if leans else rng.uniform(0.5, 0.85))
        self._comes_s = SECONDS * np.array([rng.uniform(0.15, 0.3), rng.uniform(0.55, 0.7)])
        self._stays_s, self._phase = rng.uniform(3.0, 5.0, 2), rng.uniform(0, 6.28)
        self._sign = rng.choice([-1.0, 1.0], 2)
        cloth = 40.0 * np.exp(rng.uniform(-0.5, 1.2, 3))  # levels of trousers, coat and face
        fine, coarse = (gaussian_filter(rng.standard_normal((900, 900)), s) for s in (2.0, 9.0))
        self._cloth, self._folds = cloth, np.exp(0.7 * fine + 2.0 * coarse)

    def before(self, wall: Picture, t_s: float) -> Picture:
        """Return the wall with the person before it, as levels in steady light."""
        for comes_s, stays_s, sign in zip(self._comes_s, self._stays_s, self._sign, strict=True):
            x = (t_s - comes_s) / stays_s
            if not 0.0 <= x <= 1.0:
                continue
            bob = np.sin(9.0 * t_s + self._phase)
            if self._leans:
                across = 0.5 + 0.12 * sign * np.sin(2.5 * t_s + self._phase)
                foot = ROWS + self._tall * (0.25 + 0.9 * (1.0 - min(1.0, 6 * min(x, 1 - x))))
            else:
                across, foot = 0.5 + sign * (1.5 * x - 0.75), 0.95 * ROWS + 0.01 * ROWS * bob
            wall = self._at(wall, COLUMNS * across, foot, bob)
        return wall

    def _at(self, wall: Picture, middle: float, foot: float, bob: float) -> Picture:
        y, x = np.mgrid[0:ROWS, 0:COLUMNS].astype(float)
        up, side = (foot - y) / self._tall, (x - middle) / self._tall
        stride = 0.0 if self._leans else 0.12 * bob * np.clip(0.45 - up, 0.0, 1.0)
        broad = 0.22 if self._leans else 0.11
        legs = np.minimum(np.abs(side - stride - 0.04), np.abs(side + stride + 0.04)) - 0.05
        coat, face = np.abs(side) - broad, np.hypot(side, (up - 0.92) / 1.3) - 0.06
        fold = self._folds[(y - foot).astype(int) % 900, (x - middle).astype(int) % 900]
        for part, level, (low, high) in zip(
            (legs, coat, face), self._cloth, ((0.0, 0.45), (0.42, 0.85), (0.8, 1.1)), strict=True
        ):
            edge = np.maximum.reduce([part, low - up, up - high]) * self._tall
            share = np.clip(0.5 - edge, 0.0, 1.0)
            wall = wall + share * (level * fold - wall)
        return wall


def film(seed: int, scene: str, path: Path, coding: str = "lossless") -> Plan:
    """Film a scene into a file; the same seed is the same room, lamp and camera."""
    rng = drawn_for(Case(seed=seed), "people")
    _, rate = MOVING[seed % len(MOVING)]
    case = Case(seed=seed, duration_s=SECONDS, rows=ROWS, strips=STRIPS, rate=rate, rough_hz=1e-3)
    plan, _ = plan_of(case)
    ratio = np.exp(rng.uniform(np.log(LEAST_RATIO), np.log(MOST_RATIO)))
    weaker = min(ratio / abs(plan.seen.first), 1.0)
    person = Person(rng, leans=scene == "leans") if scene != "nobody" else None
    grain = np.exp(0.05 * gaussian_filter(rng.standard_normal((ROWS, COLUMNS)), 1.0) * 4)
    wall = np.repeat(plan.wall, COLUMNS // STRIPS, axis=1) * grain

    def pictures() -> Iterator[bytes]:
        for frame in range(plan.frames):
            moment = moment_of(plan, np.array([frame]))
            seen = person.before(wall, float(plan.stamp_s[frame])) if person else wall
            seen = seen * (1.0 + weaker * (light(plan, moment)[0] - 1.0))
            noise = np.sqrt(np.maximum(seen, 0.0) * FULL / plan.sensor.well_electrons + 0.3)
            seen = seen + noise * drawn_for(case, f"noise {frame}").standard_normal(seen.shape)
            yield np.clip(np.rint(seen), 0, FULL).astype(np.uint8).tobytes()

    words = f"ffmpeg -v error -y -f rawvideo -pix_fmt gray -s {COLUMNS}x{ROWS} -r {rate} -i -"
    out = ["-threads", "1", "-pix_fmt", "yuv420p", str(path)]
    coded = [*words.split(), *CODINGS[coding].split(), *out]
    with subprocess.Popen(coded, stdin=subprocess.PIPE) as encoder:
        assert encoder.stdin is not None
        for picture in pictures():
            encoder.stdin.write(picture)
    if encoder.returncode:
        raise RuntimeError(f"no film of {scene} by {coding}")
    plan.stamp_s = np.arange(plan.frames) / float(Fraction(rate))
    return plan


def told(plan: Plan, found: Claims) -> list[float]:
    """Usable share of the seconds, the ENF's rms error (mHz) and z, the idle's error (%) and z."""
    nan = float("nan")
    out = [len(found.usable) / max(len(found.track), 1), nan, nan, nan, nan]
    if found.usable:
        t_s = np.array([e.t_s for e in found.usable])
        off_hz = np.array([e.enf_hz for e in found.usable]) - plan.mean_hz(t_s - 0.5, t_s + 0.5)
        std_hz = np.sqrt([e.enf_var_hz2 for e in found.usable])
        out[1:3] = [1e3 * _rms(off_hz), _rms(off_hz / std_hz)]
    if found.idle.verdict == "estimated":
        off = found.idle.idle_ratio - plan.sensor.idle_ratio
        out[3:] = [100 * abs(off), abs(off) / found.idle.idle_ratio_std]
    return out


def _rms(x: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(x**2)))


def main(first: int, last: int, coding: str = "lossless") -> None:
    for scene in SCENES:
        by_mask: dict[bool, list[list[float]]] = {True: [], False: []}
        for seed in range(first, last):
            with tempfile.TemporaryDirectory() as folder:
                plan = film(seed, scene, path := Path(folder) / "film.mp4", coding)
                for mask, said in by_mask.items():
                    rows = RowsSettings(read_out_axis=AUTO, mask=mask)
                    said.append(told(plan, claims(read_recording(path, rows=rows))))
        for mask, said in by_mask.items():
            usable, enf_mhz, z, idle, idle_z = np.array(said).T
            print(
                f"{scene:7s} {'mask' if mask else 'none'}: ENF in {usable.mean():4.0%} of seconds, "
                f"median {np.nanmedian(enf_mhz):6.2f} mHz, z {np.nanmedian(z):.2f} at most "
                f"{np.nanmax(z):.2f}; idle in {np.isfinite(idle).sum()} of {len(said)}, "
                f"median {np.nanmedian(idle):.3f} %, z {np.nanmedian(idle_z):.2f} at most "
                f"{np.nanmax(idle_z):.2f}", flush=True,
            )  # fmt: skip


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]), *sys.argv[3:4])

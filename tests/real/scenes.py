"""Films of scenes that no mains light falls on, as files that FFmpeg coded; and the same, lit.

What moves is drawn by FFmpeg's generators and filters, by the rows of :mod:`tests.flicker.no_mains`
and by the foreign camera in daylight. A lamp multiplies it:
``y · (1 + a·cos(2π·2·∫f dt + 2π·q·row))``. None of it knows rsenf's own model.
"""

from __future__ import annotations

import subprocess
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.discrepancy.foreign_camera import Case
from tests.discrepancy.foreign_camera.camera import take
from tests.discrepancy.foreign_camera.cases import drawn_for, plan_of
from tests.discrepancy.foreign_camera.light import Grid, draw_grid
from tests.discrepancy.foreign_camera.video import CODINGS
from tests.flicker import no_mains

Picture = NDArray[np.float32]
Rng = np.random.Generator

RATES = ("24000/1001", "24", "25", "30000/1001", "30", "48", "50", "60000/1001", "60")
SIZES = ((426, 240), (320, 180), (320, 240))
ALL_CODINGS = {
    **CODINGS,
    "500k": "-c:v libx264 -preset veryfast -b:v 500k",
    "crf23": "-c:v libx264 -preset veryfast -crf 23",
    "mjpeg": "-c:v mjpeg -q:v 4",
}
LOSSLESS_SHARE, ACROSS = 0.3, 32
LEAST_RATIO, MOST_RATIO = 2e-4, 3e-2
TEXT = "The quick brown fox jumps over the lazy dog 0123456789"
ONCE = "trim=end_frame=1,loop=loop=-1:size=1,setpts=N"  # draws a page once


@dataclass(frozen=True)
class Lamp:
    """Mains light as the rows see it.

    Attributes
    ----------
    grid : Grid
    flicker_ratio : float
        Amplitude over the mean.
    idle_ratio : float
    upward : bool
        Read out from the bottom to the top.
    """

    grid: Grid
    flicker_ratio: float
    idle_ratio: float
    upward: bool

    def light(self, frame: int, rate_hz: float, rows: int) -> Picture:
        """Factor of each row of a frame, (rows, 1)."""
        row = np.arange(rows)[:: -1 if self.upward else 1] / rows
        turns = 2.0 * self.grid.turns((frame + (1.0 - self.idle_ratio) * row) / rate_hz)
        wave = np.cos(2.0 * np.pi * (turns % 1.0))
        return np.asarray(1.0 + self.flicker_ratio * wave, np.float32)[:, None]


@dataclass(frozen=True)
class Scene:
    """What is filmed.

    Attributes
    ----------
    kind : str
    rate : str
        Frames a second, such as ``30000/1001``.
    coding : str
        Of :data:`ALL_CODINGS`.
    noise : float
        Of a pixel, levels.
    lamp : Lamp, optional
    """

    kind: str
    seed: int
    rate: str
    seconds: float
    coding: str
    noise: float
    lamp: Lamp | None


def draw_scene(seed: int, *, lit: bool, kind: str = "") -> Scene:
    """Draw a scene; the same seed is the same scene, lit or not, but for the noise that dithers."""
    kind = kind or list(KINDS)[seed % len(KINDS)]
    rng = _rng(seed, "scene")
    rate, seconds = str(rng.choice(RATES)), float(rng.uniform(8.5, 12.0))
    lossless = rng.uniform() < LOSSLESS_SHARE
    coding = "lossless" if lossless else str(rng.choice(list(ALL_CODINGS)))
    noise = float(rng.choice([0.0, 0.0, 0.5, 2.0]))
    if not lit:
        return Scene(kind, seed, rate, seconds, coding, noise, None)
    rng = _rng(seed, "lamp")
    lamp = Lamp(
        draw_grid(rng, float(rng.choice([50.0, 60.0])), seconds + 1.0, rough_hz=1e-3),
        float(np.exp(rng.uniform(np.log(LEAST_RATIO), np.log(MOST_RATIO)))),
        float(rng.uniform(0.03, 0.6)),
        bool(rng.uniform() < 0.3),
    )
    return Scene(kind, seed, rate, seconds, coding, noise or float(rng.uniform(0.5, 2.0)), lamp)


def film(scene: Scene, path: Path) -> None:
    """Film a scene into a file."""
    rate_hz = float(Fraction(scene.rate))
    pictures = KINDS[scene.kind](_rng(scene.seed, "kind"), scene.rate, scene.seconds)
    noise, encoder = _rng(scene.seed, "noise"), None
    for number, picture in enumerate(pictures):
        rows, columns = picture.shape
        if encoder is None:
            encoder = _encoder(columns, rows, scene, path)
        seen = picture * scene.lamp.light(number, rate_hz, rows) if scene.lamp else picture
        if scene.noise:
            seen = seen + scene.noise * noise.standard_normal(seen.shape, dtype=np.float32)
        assert encoder.stdin is not None
        encoder.stdin.write(np.clip(np.rint(seen), 0, 255).astype(np.uint8).tobytes())
    if encoder is None:
        raise RuntimeError(f"no picture of {scene}")
    _, told = encoder.communicate()
    if encoder.returncode:
        raise RuntimeError(f"ffmpeg: {told.decode(errors='replace').strip()}")


def _rng(seed: int, purpose: str) -> Rng:
    return np.random.default_rng([seed, zlib.crc32(purpose.encode())])


def _encoder(columns: int, rows: int, scene: Scene, path: Path) -> subprocess.Popen[bytes]:
    words = ["ffmpeg", "-v", "error", "-y", "-f", "rawvideo", "-pix_fmt", "gray"]
    words += ["-s", f"{columns}x{rows}", "-r", scene.rate, "-i", "-", "-threads", "1"]
    words += [*ALL_CODINGS[scene.coding].split(), "-pix_fmt", "yuv420p", str(path)]
    return subprocess.Popen(words, stdin=subprocess.PIPE, stderr=subprocess.PIPE)


# What FFmpeg draws: each a function of random numbers that returns a graph, in which {s} stands for
# size and rate.
def _scroll(rng: Rng) -> str:
    """Speeds of a scroll, in pictures a frame: one way, or aslant."""
    across, down = 10 ** rng.uniform(-3.5, -0.5, 2) * rng.choice([-1.0, 1.0], 2)
    way = rng.integers(3)
    return f"scroll=h={across if way else 0:.6f}:v={down if way != 1 else 0:.6f}"


def _page(rng: Rng, tall: str) -> str:
    """Lines of text on a page as tall as so many pictures."""
    size, ink = int(rng.integers(9, 26)), rng.choice(["black", "0x303030", "0x2040A0"])
    paper = rng.choice(["white", "0xE0E0E0", "0xFFF8E0"])
    lines = "\n".join(TEXT[n % 13 : n % 13 + int(rng.integers(8, 50))] for n in range(99))
    return (
        f"color=c={paper}:{{s}},scale=iw:ih*{tall},drawtext=text='{lines}':fontsize={size}:"
        f"x=8:y=4:fontcolor={ink}:line_spacing={int(rng.integers(0, 12))},{ONCE}"
    )


def _screen(rng: Rng) -> str:
    """A page that is scrolled now and then, with a pause between, as on a screen."""
    every_s, step = rng.uniform(0.3, 3.0), rng.uniform(5, 80)
    y = f"mod(floor(t/{every_s:.3f})*{step:.1f}+min(mod(t,{every_s:.3f})*4,1)*{step:.1f},2*ih/3)"
    return f"{_page(rng, '3')},crop=iw:ih/3:0:'{y}'"


def _text(rng: Rng) -> str:
    return f"{_page(rng, '1')},{_scroll(rng)}"


def _credits(rng: Rng) -> str:
    """Text that moves by whole pixels, over something."""
    speed, size = rng.uniform(10, 200), int(rng.integers(10, 40))
    behind = rng.choice(["color=c=black:{s}", "smptebars={s}", "testsrc2={s}"])
    return (
        f"{behind},drawtext=text='{TEXT[:20]}':fontsize={size}:fontcolor=white:"
        f"x=20:y='mod(h-{speed:.1f}*t\\,h+60)',drawtext=text='{TEXT}':fontsize={size}:"
        f"fontcolor=yellow:y=h/3:x='w-mod({speed:.1f}*t\\,w+tw)'"
    )


def _blink(rng: Rng) -> str:
    boxes = []
    for _ in range(int(rng.integers(1, 6))):
        every_s = 1.0 / rng.uniform(0.5, 14.0)
        x, y, w, h = (f"{x:.2f}" for x in rng.uniform(0.1, 0.9, 4))
        when = f"lt(mod(t\\,{every_s:.4f})\\,{every_s * rng.uniform(0.2, 0.8):.4f})"
        colour = f"c=white@{rng.uniform(0.03, 1):.2f}:t=fill"
        boxes.append(f"drawbox=x=iw*{x}:y=ih*{y}:w=iw*{w}:h=ih*{h}:{colour}:enable='{when}'")
    return ",".join([str(rng.choice(["smptebars={s}", "color=c=0x505050:{s}"])), *boxes])


def _clock(rng: Rng) -> str:
    size = int(rng.integers(20, 90))
    return (
        f"color=c=0x{int(rng.integers(40, 200)):02x}4040:{{s}},drawtext=text='%{{pts\\:hms}}':"
        f"fontsize={size}:x=20:y=h/3:fontcolor=white"
    )


def _dashes(rng: Rng) -> str:
    """A grid, dashes, a fence: lines that scroll."""
    w, h, thick = (int(n) for n in rng.integers((12, 8, 1), (160, 90, 9)))
    back, line = rng.choice(["0x606060", "0x203020", "0xB0B0B0"]), rng.uniform(0.05, 1.0)
    grid = f"drawgrid=w={w}:h={h}:t={thick}:c=white@{line:.2f}"
    return f"color=c={back}:{{s}},{grid},{ONCE},{_scroll(rng)}"


def _moved(rng: Rng) -> str:
    """A test picture that stands still in itself, scrolled."""
    still = ["smptebars", "rgbtestsrc", "pal75bars", "yuvtestsrc", "testsrc2"]
    return f"{rng.choice(still)}={{s}},{ONCE},{_scroll(rng)}"


def _rotated(rng: Rng) -> str:
    what = rng.choice(["testsrc2={s}", "smptebars={s}", "rgbtestsrc={s}"])
    return f"{what},{ONCE},rotate=a='{2 * np.pi * rng.uniform(-3, 3):.4f}*t'"


def _zoomed(rng: Rng) -> str:
    sway = f"1.3+{rng.uniform(0.02, 0.25):.3f}*sin(on*{10 ** rng.uniform(-2, 0):.4f})"
    return f"testsrc2={{s}},{ONCE},zoompan=z='{sway}':d=1:s={{wh}}:fps={{rate}}"


def _noise(rng: Rng) -> str:
    how = rng.choice(["t", "t+u", "t+p", "t+a"])
    return f"smptebars={{s}},{ONCE},noise=alls={int(rng.integers(3, 90))}:allf={how}"


def _gradients(rng: Rng) -> str:
    return f"gradients={{s}}:n={int(rng.integers(2, 8))}:speed={10 ** rng.uniform(-4, -1):.5f}"


def _fractal(rng: Rng) -> str:
    scale = 10 ** rng.uniform(-2, 0.4)
    return f"mandelbrot={{s}}:maxiter=150:start_scale={scale:.4f}:end_scale={scale / 9:.4f}"


def _cells(rng: Rng) -> str:
    return f"cellauto={{s}}:rule={int(rng.choice([18, 30, 73, 90, 110, 150]))}:seed={_number(rng)}"


def _life(rng: Rng) -> str:
    colours = "life_color=0xC0C0C0:death_color=0x606060:mold_color=0x202020"
    return f"life={{s}}:seed={_number(rng)}:ratio=0.3:mold={int(rng.integers(1, 60))}:{colours}"


def _sierpinski(rng: Rng) -> str:
    return f"sierpinski={{s}}:type={rng.choice(['carpet', 'triangle'])}:seed={_number(rng)}"


def _number(rng: Rng) -> int:
    return int(rng.integers(1 << 30))


def _drawn(graph: Callable[[Rng], str]) -> Callable[[Rng, str, float], Iterator[Picture]]:
    """Let FFmpeg draw a graph."""

    def pictures(rng: Rng, rate: str, seconds: float) -> Iterator[Picture]:
        width, height = SIZES[rng.integers(len(SIZES))]
        size = f"s={width}x{height}:r={rate}"
        words = graph(rng).replace("{s}", size).replace("{rate}", rate)
        words = words.replace("{wh}", f"{width}x{height}")
        if rng.uniform() < 0.5:  # as a camera or a video has it: no black, no white
            words += ",eq=contrast=0.6"
        source = ["-filter_threads", "1", "-f", "lavfi", "-i", f"{words},format=gray"]
        command = ["ffmpeg", "-v", "error", *source, "-t", f"{seconds:.3f}"]
        command += ["-fps_mode", "passthrough", "-f", "rawvideo", "-pix_fmt", "gray", "-"]
        with subprocess.Popen(command, stdout=subprocess.PIPE) as ffmpeg:
            assert ffmpeg.stdout is not None
            while len(held := ffmpeg.stdout.read(width * height)) == width * height:
                yield np.frombuffer(held, np.uint8).reshape(height, width).astype(np.float32)
        if ffmpeg.returncode:
            raise RuntimeError(f"ffmpeg can't draw {words}")

    return pictures


def _of_rows(rng: Rng, level: NDArray[Any]) -> Iterator[Picture]:
    """Pictures of rows, (frames, rows, strips), with a texture over the columns and noise."""
    _, rows, strips = level.shape
    texture = np.exp(0.05 * rng.standard_normal((rows, strips, ACROSS))).astype(np.float32)
    texture /= texture.mean(axis=2, keepdims=True)
    for frame in level:
        picture = (frame[:, :, None] * texture).reshape(rows, -1)
        yield picture + 0.7 * rng.standard_normal(picture.shape, dtype=np.float32)


def _rolling(kind: str) -> Callable[[Rng, str, float], Iterator[Picture]]:
    """Film a kind of :mod:`tests.flicker.no_mains`: what a rolling shutter makes of it."""

    def pictures(rng: Rng, rate: str, seconds: float) -> Iterator[Picture]:
        rate_hz = float(Fraction(rate))
        level, _ = no_mains.film(kind, _number(rng), rate_hz=rate_hz, seconds=seconds)
        return _of_rows(rng, level)

    return pictures


def _daylight(*hidden: str) -> Callable[[Rng, str, float], Iterator[Picture]]:
    """Film with the foreign camera by day."""

    def pictures(rng: Rng, rate: str, seconds: float) -> Iterator[Picture]:
        case = Case(
            hidden=hidden, seed=_number(rng), rate=rate, duration_s=seconds, rows=180, strips=6,
            times=float(10 ** rng.uniform(0.0, 1.5)), nominal_hz=50.0,
        )  # fmt: skip
        plan, _ = plan_of(case)
        plan.lamps = []
        return _of_rows(rng, take(plan, drawn_for(case, "noise")))

    return pictures


def _pattern(rng: Rng, rate: str, seconds: float, hz: float | None = None) -> Iterator[Picture]:
    """Waves or bars in any direction, of any contrast and speed, over a wall or a bare one."""
    width, height = SIZES[rng.integers(len(SIZES))]
    y, x = np.mgrid[0:height, 0:width]
    down, across = rng.uniform(-12, 12), float(rng.choice([0.0, rng.uniform(-12, 12)]))
    hz = rng.uniform(-15.0, 15.0) if hz is None else hz
    size, wall = 10 ** rng.uniform(-0.3, 1.9), rng.integers(3)
    behind = 125 + (25 * np.sin(x / 23 + y / 31) if wall == 1 else 30 * ((x + y) % 80 > 40) * wall)
    place, edge = across * x / width + down * y / height, rng.choice([0.0, rng.uniform(-0.6, 0.6)])
    for frame in range(round(seconds * float(Fraction(rate)))):
        wave = np.sin(2 * np.pi * (place - hz * frame / float(Fraction(rate))))
        shape = 2.0 * (wave > edge) - 1.0 if edge else wave
        yield np.clip(behind + size * shape, 0, 255).astype(np.float32)


def _near_grid(rng: Rng, rate: str, seconds: float) -> Iterator[Picture]:
    """Waves whose speed is, by bad luck, near a grid's alias."""
    rate_hz, light_hz = float(Fraction(rate)), rng.choice([100.0, 120.0]) + rng.uniform(-0.4, 0.4)
    seen_hz = (light_hz - round(light_hz / rate_hz) * rate_hz) * rng.choice([-1, 1])
    return _pattern(rng, rate, seconds, seen_hz)


def _rain(rng: Rng, rate: str, seconds: float) -> Iterator[Picture]:
    """Drops that fall in front of a wall while the rows are read."""
    camera = no_mains.Camera(rng, float(Fraction(rate)), seconds)
    wall = 255.0 * np.repeat(camera.wall(), ACROSS, axis=1)
    rows, columns = wall.shape
    drops = int(rng.integers(10, 120))
    column, first = rng.integers(0, columns, drops), rng.uniform(0, 2 * rows, drops)
    speed, long = rng.uniform(2, 12, drops) * rows, rng.uniform(0.02, 0.2, drops) * rows
    bright = 10 ** rng.uniform(0.3, 1.8)
    for t_s in camera.t_s:
        place = np.arange(rows)[:, None] - first - speed * t_s[:, None]
        picture = wall.copy()
        picture[:, column] += bright * (place % (2 * rows) < long)
        yield picture.astype(np.float32)


KINDS: dict[str, Callable[[Rng, str, float], Iterator[Picture]]] = {
    "testsrc": _drawn(lambda rng: "testsrc={s}"),
    "testsrc2": _drawn(lambda rng: "testsrc2={s}"),
    "fractal": _drawn(_fractal),
    "life": _drawn(_life),
    "cells": _drawn(_cells),
    "sierpinski": _drawn(_sierpinski),
    "gradients": _drawn(_gradients),
    "moved": _drawn(_moved),
    "rotated": _drawn(_rotated),
    "zoomed": _drawn(_zoomed),
    "pattern": _pattern,
    "near_grid": _near_grid,
    "screen": _drawn(_screen),
    "text": _drawn(_text),
    "credits": _drawn(_credits),
    "blink": _drawn(_blink),
    "clock": _drawn(_clock),
    "dashes": _drawn(_dashes),
    "noise": _drawn(_noise),
    "rain": _rain,
    **{f"rolling_{kind}": _rolling(kind) for kind in no_mains.KINDS},
    **{
        f"day_{name}": _daylight(*names)
        for name, names in {
            "still": (),
            "stripes": ("stripes",),
            "shaken": ("vibration",),
            "hand": ("hand_tilt",),
            "clouds": ("clouds", "stripes"),
            "gain": ("gain_steps",),
            "keyed": ("key_dimming",),
        }.items()
    },
}

"""Rows of pictures without any mains light, in plain NumPy: stripes, text, shakes, dimmers, noise.

``film(kind, seed)`` draws one. None of it knows rsenf; each is what a rolling shutter would make of
such a scene in steady light, or under a light that no grid feeds.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

Array = NDArray[np.float64]

RATES_HZ = (24.0, 24000 / 1001, 25.0, 30000 / 1001, 30.0, 50.0, 60000 / 1001, 60.0)
ROWS, ACROSS = 96, 12  # and pixels across a strip
DIMMERS_HZ = (200.0, 240.0, 250.0, 1000.0)


class Camera:
    """Frame rate, read-out, strips and noise, drawn.

    Attributes
    ----------
    t_s : ndarray (frames, rows)
        When each row is read.
    """

    def __init__(self, rng: np.random.Generator, rate_hz: float = 0.0, seconds: float = 0.0):
        self.rng = rng
        self.rate_hz = rate_hz or float(rng.choice(RATES_HZ))
        seconds = seconds or float(rng.uniform(12.0, 45.0))
        self.strips = int(rng.choice([4, 6, 8]))
        self.frames = round(seconds * self.rate_hz)
        self.frame_s = np.arange(self.frames) / self.rate_hz
        self.read_out_s = rng.uniform(0.3, 0.98) / self.rate_hz
        self.t_s = self.frame_s[:, None] + self.read_out_s * np.arange(ROWS) / ROWS
        self.noise = float(10 ** rng.uniform(-2.0, 0.0))  # of a row of a strip, levels
        self.gamma = float(rng.choice([1.0, rng.uniform(0.8, 1.3)]))

    def shoot(self, light: Array) -> NDArray[np.float32]:
        """Levels of what falls on the rows, (frames, rows, strips), about one at most."""
        level = 255.0 * np.clip(light, 0.0, 1.0) ** self.gamma
        noisy = level + self.noise * self.rng.standard_normal(level.shape)
        return np.clip(noisy, 0.0, 255.0).astype(np.float32)

    def wall(self, rough: float = 0.25) -> Array:
        """Something that stands still, (rows, strips)."""
        place = np.linspace(0.0, 1.0, ROWS)[:, None]
        wall = np.full((ROWS, self.strips), self.rng.uniform(0.25, 0.6))
        wall = wall * np.exp(rough * self.rng.uniform(-1, 1, self.strips))
        for _ in range(4):
            waves, turn = self.rng.uniform(0.3, 5.0, self.strips), self.rng.uniform(0, 6.3)
            wall = wall * (1.0 + 0.5 * rough * np.sin(2 * np.pi * waves * place + turn) / 2)
        for _ in range(3):
            edge = self.rng.uniform(0, 1, self.strips)
            wall = wall * (1.0 + rough * self.rng.uniform(-1, 1, self.strips) * (place > edge))
        return np.clip(wall, 0.02, 0.95)

    def through(self, picture: Array, down: Array, across: Array) -> Array:
        """A picture (rows, columns), shifted by pixels at each row's time; it repeats at its ends.

        ``down`` and ``across`` are of shape (frames, rows).
        """
        row = np.arange(ROWS)[:, None] + 0.0
        column = np.arange(self.strips * ACROSS)[None, :] + 0.0
        out = np.empty((self.frames, ROWS, self.strips))
        for n in range(self.frames):
            at = np.stack(np.broadcast_arrays(row + down[n][:, None], column + across[n][:, None]))
            seen = map_coordinates(picture, at, order=1, mode="grid-wrap")
            out[n] = seen.reshape(ROWS, self.strips, ACROSS).mean(axis=2)
        return out


def _where(camera: Camera) -> Array:
    """Part of the picture, (rows, strips): all of it, some strips, or some rows."""
    rng, part = camera.rng, np.ones((ROWS, camera.strips))
    kind = rng.integers(4)
    if kind == 1:
        part[:, rng.permutation(camera.strips)[: camera.strips // 2]] = 0.0
    if kind == 2:
        low, high = np.sort(rng.integers(0, ROWS, 2))
        part[low : max(high, low + ROWS // 3)] = 0.0
    if kind == 3:
        part = part * rng.uniform(0.2, 1.0, camera.strips)
    return part


def _wave(rng: np.random.Generator, turns: Array) -> Array:
    """A wave of some shape between −1 and 1, by its phase in turns."""
    shape = rng.integers(4)
    if shape == 0:
        return np.asarray(np.cos(2 * np.pi * turns))
    duty = rng.uniform(0.2, 0.8)
    edge = turns % 1.0
    soft = rng.uniform(0.01, 0.1)  # of a pixel and of a lens
    rise = np.clip((duty / 2 - np.abs(edge - 0.5)) / soft + 0.5, 0.0, 1.0)
    return np.asarray(2.0 * rise - 1.0)


def stripes(
    camera: Camera, *, upright: bool | None = None, turns_a_frame: float | None = None
) -> NDArray[np.float32]:
    """Blinds, a conveyor, a railing: stripes that move steadily, or nearly so."""
    rng = camera.rng
    down = float(np.exp(rng.uniform(np.log(0.5), np.log(16.0)))) * rng.choice([-1, 1])
    across = 0.0 if upright else float(rng.choice([0.0, rng.normal(0.0, 2.0)]))
    own = rng.uniform(-0.5, 0.5) if turns_a_frame is None else turns_a_frame
    hz = own * camera.rate_hz
    wobble = float(rng.choice([0.0, 10 ** rng.uniform(-4, -2)])) * abs(own)
    strolls = np.cumsum(np.cumsum(rng.standard_normal(camera.frames))) * wobble / camera.rate_hz
    along = np.interp(camera.t_s, camera.frame_s, strolls)
    place = (
        np.arange(ROWS)[:, None] / ROWS * down + np.arange(camera.strips) / camera.strips * across
    )
    turns = place - (hz * camera.t_s + along)[:, :, None] + rng.uniform()
    depth = 10 ** rng.uniform(-3.0, -0.3)
    blur = np.sinc(across / camera.strips)
    part, wall = _where(camera), camera.wall(rng.choice([0.02, 0.25]))
    wave = depth * blur * _wave(rng, turns) * part
    if rng.uniform() < 0.5:
        return camera.shoot(wall + 0.4 * wave)  # before something dark, or mixed in
    return camera.shoot(np.where(part > 0, 0.4 * (1.0 + wave), wall))  # hides what is behind


def slow_stripes(camera: Camera) -> NDArray[np.float32]:
    """Stripes that creep: some turns in all the film."""
    return stripes(camera, upright=True, turns_a_frame=camera.rng.uniform(-6, 6) / camera.frames)


def near_grid_stripes(camera: Camera) -> NDArray[np.float32]:
    """Stripes whose speed is, by bad luck, near a grid's alias."""
    rng = camera.rng
    light_hz = float(rng.choice([100.0, 120.0])) + rng.uniform(-1.0, 1.0)
    turns = light_hz / camera.rate_hz
    return stripes(camera, turns_a_frame=float(turns - round(turns)) * rng.choice([-1, 1]))


def dimmer(camera: Camera) -> NDArray[np.float32]:
    """A dimmed lamp that no grid feeds: pulses at a quartz's frequency."""
    rng = camera.rng
    hz = float(rng.choice([*DIMMERS_HZ, rng.uniform(150.0, 3000.0)]))
    hz *= 1.0 + float(rng.choice([0.0, rng.normal(0.0, 5e-5)]))
    duty, depth = rng.uniform(0.1, 0.9), 10 ** rng.uniform(-2.5, -0.3)
    exposure_s = rng.uniform(1e-4, 6e-3)
    pulses = np.zeros_like(camera.t_s)
    for k in range(1, 6):
        size = 2.0 * np.sinc(k * duty) * duty * np.sinc(k * hz * exposure_s)
        pulses += size * np.cos(2 * np.pi * k * (hz * camera.t_s % 1.0))
    return camera.shoot(camera.wall()[None] * (1.0 + depth * pulses[:, :, None]))


def clouds(rng: np.random.Generator, columns: int, steep: float) -> Array:
    """A texture as nature has them, (rows, columns), about zero and of unit size."""
    grid = np.hypot(np.fft.fftfreq(2 * ROWS)[:, None], np.fft.fftfreq(columns)[None, :])
    grid[0, 0] = np.inf
    made = np.fft.ifft2(np.fft.fft2(rng.standard_normal((2 * ROWS, columns))) * grid**-steep).real
    return np.asarray(made / made.std())


def _textured(camera: Camera) -> Array:
    rng = camera.rng
    texture = clouds(rng, camera.strips * ACROSS, rng.uniform(0.8, 2.0))
    return np.asarray(0.4 * np.exp(rng.uniform(0.05, 0.5) * np.clip(texture, -2.5, 1.5)))


def tilt(camera: Camera) -> NDArray[np.float32]:
    """A camera in a hand, before clouds or a wall."""
    rng, shape = camera.rng, camera.t_s.shape
    moves = []
    for _ in range(2):
        sway = np.zeros(shape)
        for hz, size in ((0.3, 1.5), (1.1, 0.5), (3.0, 0.3), (9.0, 0.15)):
            away = hz * rng.uniform(0.8, 1.25)
            walk = np.cumsum(rng.standard_normal(camera.frames)) * np.sqrt(hz / camera.rate_hz)
            turn = 2 * np.pi * away * camera.t_s + np.interp(camera.t_s, camera.frame_s, walk)
            sway += size * rng.uniform(0.3, 1.5) * np.sin(turn + rng.uniform(0, 6.3))
        moves.append(sway * rng.uniform(0.3, 3.0))
    return camera.shoot(camera.through(_textured(camera), *moves))


def vibration(camera: Camera) -> NDArray[np.float32]:
    """A camera on a machine, or in a car: one frequency."""
    rng = camera.rng
    hz = float(rng.choice([11.0, rng.uniform(4.0, 60.0)]))
    shake = np.sin(2 * np.pi * hz * camera.t_s)
    moves = (10 ** rng.uniform(-1.5, 0.3) * shake, rng.uniform(0.0, 0.5) * shake)
    return camera.shoot(camera.through(_textured(camera), *moves))


def scrolling(camera: Camera) -> NDArray[np.float32]:
    """Text or a map that is scrolled at one speed, all of the picture or some strips."""
    rng = camera.rng
    lines = int(rng.choice([4, 6, 8, 12, 16, 24]))
    page = np.full((2 * ROWS, camera.strips * ACROSS), rng.uniform(0.6, 0.9))
    each = 2 * ROWS // lines
    for line in range(lines):
        ink = rng.uniform(size=page.shape[1]) < rng.uniform(0.2, 0.7)
        page[line * each : line * each + max(each // 2, 1), ink] *= rng.uniform(0.1, 0.5)
    speed = rng.uniform(-1.0, 1.0) * float(rng.choice([0.05, 0.5, 3.0]))
    own = np.broadcast_to(np.arange(camera.frames)[:, None] * speed, camera.t_s.shape)
    still = np.zeros_like(own)
    up = rng.uniform() < 0.7
    seen = camera.through(page, own if up else still, still if up else own)
    part = _where(camera) > 0
    return camera.shoot(np.where(part, seen, camera.wall()))


def blinking(camera: Camera) -> NDArray[np.float32]:
    """A warning light, a screen of 60 Hz, a cursor: all rows at once, or a part of the picture."""
    rng = camera.rng
    hz = float(rng.choice([rng.uniform(0.5, 15.0), 60.0, 72.0, 75.0, 144.0]))
    wave = _wave(rng, hz * camera.t_s + rng.uniform())
    if hz < 15.0 and rng.uniform() < 0.5:  # a drawn one: a whole frame at a time
        wave = _wave(rng, hz * np.broadcast_to(camera.frame_s[:, None], camera.t_s.shape))
    depth = 10 ** rng.uniform(-2.5, -0.5)
    return camera.shoot(camera.wall() * (1.0 + depth * wave[:, :, None] * _where(camera)))


def key_frames(camera: Camera) -> NDArray[np.float32]:
    """An encoder that dims or blurs what lies between key frames, slightly."""
    rng = camera.rng
    period = int(rng.choice([10, 12, 15, 24, 25, 30, 50, 60]))
    age = np.arange(camera.frames) % period / period
    depth = 10 ** rng.uniform(-3.0, -1.0)
    dims = 1.0 - depth * age[:, None, None] * rng.uniform(0.5, 1.5, (ROWS, camera.strips))
    return camera.shoot(camera.wall() * dims)


def turning(camera: Camera) -> NDArray[np.float32]:
    """A fan, a wiper, a wheel: arms that turn about a point, seen row by row."""
    rng = camera.rng
    y, x = np.mgrid[0:ROWS, 0 : camera.strips * ACROSS]
    centre = rng.uniform(0.2, 0.8, 2) * (ROWS, camera.strips * ACROSS)
    angle = np.arctan2(y - centre[0], x - centre[1]) / (2 * np.pi)
    arms = int(rng.integers(1, 9))
    hz, shape = rng.uniform(0.2, 12.0), int(rng.integers(1 << 30))
    wall = np.repeat(camera.wall(), ACROSS, axis=1)
    depth = 10 ** rng.uniform(-1.5, -0.3)
    out = np.empty((camera.frames, ROWS, camera.strips))
    for n in range(camera.frames):
        turns = arms * (angle - hz * camera.t_s[n][:, None])
        seen = wall * (1.0 + depth * _wave(np.random.default_rng(shape), turns))
        out[n] = seen.reshape(ROWS, camera.strips, ACROSS).mean(axis=2)
    return camera.shoot(out)


def drift(camera: Camera) -> NDArray[np.float32]:
    """Daylight: clouds pass, the exposure follows in steps, noise."""
    rng = camera.rng
    walk = np.cumsum(np.cumsum(rng.standard_normal(camera.frames)))
    walk = walk / max(np.abs(walk).max(), 1e-9)
    light = 1.0 + 10 ** rng.uniform(-2.5, -0.5) * walk
    steps = 2.0 ** -(np.round(np.log2(light) * 12) / 12)
    gain = light * (steps if rng.uniform() < 0.5 else 1.0)
    return camera.shoot(camera.wall() * gain[:, None, None])


KINDS: dict[str, Callable[[Camera], NDArray[np.float32]]] = {
    "stripes": stripes,
    "slow_stripes": slow_stripes,
    "near_grid_stripes": near_grid_stripes,
    "dimmer": dimmer,
    "tilt": tilt,
    "vibration": vibration,
    "scrolling": scrolling,
    "blinking": blinking,
    "key_frames": key_frames,
    "turning": turning,
    "drift": drift,
}


def film(
    kind: str, seed: int, *, rate_hz: float = 0.0, seconds: float = 0.0
) -> tuple[NDArray[np.float32], Array]:
    """Film one kind: levels (frames, rows, strips) and the times of the frames."""
    rng = np.random.default_rng([list(KINDS).index(kind), seed])
    camera = Camera(rng, rate_hz, seconds)
    return KINDS[kind](camera), camera.frame_s

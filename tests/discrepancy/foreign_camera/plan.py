"""A plan: all that a film is made from, for effects to change before it is filmed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .light import Array, Grid, Lamp

Frames = NDArray[np.int64]


@dataclass(frozen=True, kw_only=True)
class Sensor:
    """A camera, as one draws it from a shelf.

    Attributes
    ----------
    frame_rate : float
        Exact, in hertz.
    idle_ratio : float
        Share of the frame period in which no row is read.
    exposure_s : float
    pixels : int
        Columns in each strip, which a row's level is the mean of.
    well_electrons : float
        Electrons at level 255.
    read_electrons : float
        Read noise of a pixel, rms.
    row_noise_level : float
        Noise that a row has in common in all strips, rms.
    """

    frame_rate: float
    idle_ratio: float
    exposure_s: float
    pixels: int
    well_electrons: float
    read_electrons: float
    row_noise_level: float

    @property
    def readout_s(self) -> float:
        """From the first row's beginning to where a row after the last would begin."""
        return (1.0 - self.idle_ratio) / self.frame_rate


@dataclass(frozen=True, kw_only=True, eq=False)
class Moment:
    """Some frames being filmed.

    Attributes
    ----------
    frame : ndarray of int (frames,)
    start_s : ndarray (frames,)
        When their first line begins.
    t_s : ndarray (frames, rows)
        Middle of each row's exposure.
    row : ndarray (rows,)
        Place of each row in the picture, 0 at the top and 1 at the bottom.
    """

    frame: Frames
    start_s: Array
    t_s: Array
    row: Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Shining:
    """A lamp and its share of the light, in each strip or also in each row of it.

    Attributes
    ----------
    lamp : Lamp
    share : ndarray
        Broadcasts to (rows, strips).
    course : callable, optional
        Factor over time, slow.
    """

    lamp: Lamp
    share: Array
    course: Callable[[Array], Array] | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Tone:
    """A tone in the light that isn't the mains'.

    Attributes
    ----------
    hz, depth_ratio, phase_rad : float
        Before exposure.
    times_light : bool
        It swings the light with its flicker; otherwise it adds to it.
    share : ndarray
        By strip, broadcasts to (rows, strips).
    course : callable, optional
        Complex factor over time, slow: its size and phase wander.
    """

    hz: float
    depth_ratio: float
    phase_rad: float
    times_light: bool = True
    share: Array = field(default_factory=lambda: np.ones(1))
    course: Callable[[Array], NDArray[Any]] | None = None


Change = Callable[[Moment, Array], Array]


@dataclass(kw_only=True, eq=False)
class Plan:
    """All that a film is made from.

    Attributes
    ----------
    grid, sensor, lamps, tones
    wall : ndarray (rows, strips)
        Levels in steady light.
    begin_s : float
        True time at which the file's clock stands at zero.
    start_s, stamp_s, readout_s : ndarray (frames,)
        When frames begin, what their stamps say, and how long each is read.
    line : ndarray (rows,)
        When a row begins, in read-out times after its frame.
    late_s : ndarray (rows,)
        How much later than that.
    on_level, on_picture : list
        Changes of the level before the sensor's noise; and changes of
        finished pictures with it, in order of frames.
    curves : list
        Functions of level, applied by the sensor.
    shift_rows : callable, optional
        By how many rows the picture stands lower.
    arrive : ndarray of int
        Which of the frames filmed end up in the file, in order.
    mix : tuple, optional
        Another frame for each of those in the file, and its share of the picture.
    file_rate : float
        Of the file, hertz; 0 is the sensor's.
    knots_s : tuple, optional
        What the file's clock says at some true times, and those; it runs right otherwise.
    speed : float
        How many seconds of that clock a second of the file lasts, once it is filtered.
    """

    grid: Grid
    sensor: Sensor
    lamps: list[Shining]
    wall: Array
    begin_s: float
    start_s: Array
    stamp_s: Array
    readout_s: Array
    line: Array
    late_s: Array
    arrive: Frames
    tones: list[Tone] = field(default_factory=list)
    on_level: list[Change] = field(default_factory=list)
    on_picture: list[Change] = field(default_factory=list)
    curves: list[Callable[[Array], Array]] = field(default_factory=list)
    shift_rows: Callable[[Moment], Array] | None = None
    mix: tuple[Frames, Array] | None = None
    file_rate: float = 0.0
    knots_s: tuple[Array, Array] | None = None
    speed: float = 1.0

    @property
    def frames(self) -> int:
        """How many are filmed."""
        return len(self.start_s)

    @property
    def rows(self) -> int:
        """Of a frame."""
        return len(self.wall)

    @property
    def strips(self) -> int:
        """Of columns."""
        return int(self.wall.shape[1])

    def close_up(self) -> None:
        """Give the frames of the file regular stamps, whichever they are."""
        self.stamp_s = np.arange(len(self.arrive)) / self.sensor.frame_rate
        self.knots_s = self.stamp_s, self.start_s[self.arrive]

    def mean_hz(self, begin_s: Array, end_s: Array) -> Array:
        """Mean frequency of the mains between times on the file's clock.

        Where the clock jumps, since frames are missing, it is the mean over the time that passed.
        """
        begin, end = self._true_s(self.speed * begin_s), self._true_s(self.speed * end_s)
        turns = self.grid.turns(end) - self.grid.turns(begin)
        return np.asarray(self.speed * turns / (end - begin))

    def _true_s(self, file_s: Array) -> Array:
        if self.knots_s is None:
            return np.asarray(file_s) + self.begin_s
        said, true = self.knots_s
        outside = np.minimum(file_s - said[0], 0.0) + np.maximum(file_s - said[-1], 0.0)
        return np.asarray(np.interp(file_s, said, true) + outside)

    @property
    def mains_hz(self) -> float:
        """Mean over the film."""
        begin_s, end_s = self.start_s[0], self.start_s[-1]
        turns = self.grid.turns(end_s) - self.grid.turns(begin_s)
        return float(turns / (end_s - begin_s))

    @property
    def seen(self) -> Lamp:
        """First lamp, as rows see it."""
        return self.lamps[0].lamp.exposed(self.mains_hz, self.sensor.exposure_s)

    @property
    def flicker_rms(self) -> float:
        """Of the light, relative, as rows see it."""
        return float(np.sqrt(np.sum(np.abs(self.seen.size) ** 2) / 2))

    def alias_hz(self, hz: float) -> float:
        """Where the frame rate folds a frequency to."""
        return float(abs(hz - self.sensor.frame_rate * np.round(hz / self.sensor.frame_rate)))

    def expose(self, exposure_s: float) -> None:
        """Set another exposure."""
        self.sensor = replace(self.sensor, exposure_s=exposure_s)

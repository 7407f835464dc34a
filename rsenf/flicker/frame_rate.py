"""Frame-rate hypotheses from the light, for rows without frame times.

Model: without frame times, rows under mains light yield two quantities: the cycles ``a`` by which
the phase advances from frame to frame, modulo 1 and without sign, and the turns ``q`` of the phase
down the rows. Light at ``f_0`` truly advances by ``c = f_0/F = k + a`` cycles at ``F`` frames/s, or
by ``c = k − a`` with the ramp the other way. The read-out time ``|q|/f_0`` must fit in the frame
period: the idle ratio ``1 − |q|/c`` isn't negative. It depends on ``k``, but on no frame rate.

Statistic: the idle ratio of each ``k``; negative ones are left out, and common rates come first.

Approximate: the grid is at its nominal frequency.

References
----------
- Hajj-Ahmad, A., Berkovich, A. and Wu, M. (2016), Exploiting power signatures for camera forensics,
  IEEE Signal Processing Letters 23, 713: the ramp and the read-out time.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rsenf.flicker.acquire import MIN_SNR, NO_FLICKER, TURNS_STEP, strongest
from rsenf.flicker.cell_light import bands_of, cell_means, light_of
from rsenf.flicker.grid_prior import STEADY, Wander
from rsenf.flicker.lines import ProfileBasis
from rsenf.flicker.mains import AT_ONCE, NO_GRID, PATCHY, PATTERN, TOO_LONG, why_not_light
from rsenf.flicker.tone import AT_EDGE, ToneFinder
from rsenf.messages import RateHypothesis, RowBlock

Float = NDArray[np.float64]
Complex = NDArray[np.complex128]
Indices = NDArray[np.int64]

MIN_FRAMES, MOST_FRAMES = 120, 600
MIN_ROWS = 16
RESTING = Wander(known=min(STEADY))  # counts as steady, for the strictest test
MOST_TURNS = 8.0  # 120 Hz, read out over the whole frame at 15 frames/s
TRIED = 6  # tones tested, the strongest first
PEAK_CELLS = 1e-3  # error of the peak interpolation
APART_CELLS = 2.0  # between tones; and from 0 and half a cycle a frame, where mirror images meet
COMMON_HZ = (24 / 1.001, 24.0, 25.0, 30 / 1.001, 30.0, 50.0, 60 / 1.001, 60.0)
COMMON_RATIO = 2e-3
LEAST_HZ, MOST_HZ = 5.0, 240.0
SLACK_RATIO = 0.02  # of the frame period, by which a read-out may exceed it
SHOWN = 4  # hypotheses listed in words
UNTIMED = "no frame times, so that the frame rate is only assumed"
GIVE_RATE, IS_IT_WRONG = "give --frame-rate", "is the frame rate wrong?"
# Reasons that a wrong frame rate may cause.
DOUBTFUL = (NO_FLICKER, AT_EDGE, NO_GRID, TOO_LONG)


@dataclass(frozen=True, kw_only=True)
class PerFrame:
    """What rows show of the light without frame times, and the frame rates that fit.

    Attributes
    ----------
    cycles, cycles_std : float
        Phase advance from frame to frame, 0 to 0.5 cycles, and its standard error.
    turns, turns_std : float
        Turns of the same phase down the rows of a frame.
    hypotheses : tuple of RateHypothesis
        Common rates first, then by how near they are to the rate by the frames' times.
    """

    cycles: float
    cycles_std: float
    turns: float
    turns_std: float
    hypotheses: tuple[RateHypothesis, ...]

    @property
    def words(self) -> str:
        """The measured quantities in words."""
        return (
            f"the light turns {self.cycles:.5f} ± {self.cycles_std:.1g} cycles a frame, "
            f"{self.turns:.3f} ± {self.turns_std:.1g} turns down the rows"
        )


def likely(rates: tuple[RateHypothesis, ...]) -> str:
    """Return the first few hypotheses in words."""
    said = [
        f"{2 * h.nominal_hz:.0f} Hz if the rate is {h.frame_rate_hz:.2f} (idle "
        f"{100 * h.idle_ratio:.1f} %, {h.direction})"
        for h in rates[:SHOWN]
    ]
    more = [f"{len(rates) - SHOWN} more"] if len(rates) > SHOWN else []
    return "; ".join([*said, *more])


class FrameRateFinder:
    """Keeps the first frames of a stream, and searches them for light on request.

    Parameters
    ----------
    nominal_hz : float, optional
        Nominal grid frequency, if known.
    """

    def __init__(self, nominal_hz: float | None) -> None:
        self._nominals_hz = (nominal_hz,) if nominal_hz else (50.0, 60.0)
        self._basis: ProfileBasis | None = None
        self._shape: tuple[int, ...] = ()  # of the first block's rows and strips
        # Of each block: its coefficients, means of its cells, frame numbers, time stamps.
        self._reduced: list[tuple[Float, Float, Indices, Indices]] = []
        self._frames = 0
        self._looked = 0  # frames at the last search
        self._found: PerFrame | None = None

    def add(self, block: RowBlock) -> None:
        """Reduce a block of rows, and keep that, until there are ``MOST_FRAMES`` frames."""
        if not block.frames or not block.usable or self._frames >= MOST_FRAMES:
            return
        self._shape = self._shape or block.level.shape[1:]
        if block.rows < MIN_ROWS or block.level.shape[1:] != self._shape:
            return
        self._basis = self._basis or ProfileBasis(block.rows, MOST_TURNS)
        cells = cell_means(block.level).reshape(block.frames, -1)
        numbers, stamps = block.frame_number.copy(), block.frame_pts_ns.copy()  # not of all of it
        self._reduced.append((self._basis.reduce(block), cells, numbers, stamps))
        self._frames += block.frames

    def found(self) -> PerFrame | None:
        """Return what the frames so far show; None if no light is found."""
        if MIN_FRAMES <= self._frames != self._looked:
            self._looked, self._found = self._frames, self._look()
            if self._frames >= MOST_FRAMES:
                self._reduced.clear()
        return self._found

    def _look(self) -> PerFrame | None:
        """Test the strongest tones until one is light, or certainly a pattern.

        A pattern ends the search, since its overtones may pass for light by chance.
        """
        assert self._basis is not None
        columns, cells, numbers, stamps = map(np.concatenate, zip(*self._reduced, strict=True))
        bands = bands_of(self._shape[0])
        counted_hz = float((numbers[-1] - numbers[0]) * 1e9 / (stamps[-1] - stamps[0]))
        n = numbers.astype(np.float64)
        n -= (n[0] + n[-1]) / 2.0
        finder = ToneFinder(float(n[-1] - n[0] + 1.0), 0.25)
        cell = 1.0 / finder.window_s
        turns = np.arange(-MOST_TURNS, MOST_TURNS + TURNS_STEP, TURNS_STEP)
        carrier = np.exp(-0.5j * np.pi * n)  # a quarter of a cycle a frame
        series = columns @ self._basis.ramps(turns).conj() * carrier[:, None]
        _, power = finder.periodograms(series, carrier, n)
        alias = 0.25 + finder.offsets_hz
        power[(alias < APART_CELLS * cell) | (alias > 0.5 - APART_CELLS * cell)] = 0.0
        remaining = power.copy()
        for _ in range(TRIED):
            at, ramp = np.unravel_index(int(np.argmax(remaining)), remaining.shape)
            tone = strongest(finder, remaining[:, ramp], n)
            remaining[np.abs(alias - alias[at]) < APART_CELLS * cell] = 0.0
            if tone.snr < MIN_SNR or tone.at_edge:
                continue
            cycles = 0.25 + tone.offset_hz
            phase = 2.0 * np.pi * cycles * n
            light = light_of(cells, n, phase, bands, MOST_TURNS)
            why_not = why_not_light(light, MOST_TURNS, RESTING)
            if why_not in (PATTERN, PATCHY):
                return None
            if why_not or abs(light.turns) < AT_ONCE:  # rows in phase: anything that blinks
                continue
            slope, slope_std = _slope(cells, n, phase, bands, light.turns)
            return PerFrame(
                cycles=cycles,
                cycles_std=float(np.hypot(np.sqrt(tone.offset_var_hz2), PEAK_CELLS * cell)),
                turns=slope,
                turns_std=float(np.hypot(slope_std, light.apart_turns)),
                hypotheses=hypotheses(cycles, slope, counted_hz, self._nominals_hz),
            )
        return None


def hypotheses(
    cycles: float, turns: float, counted_hz: float, nominals_hz: tuple[float, ...]
) -> tuple[RateHypothesis, ...]:
    """List the frame rates at which a grid's light would show these values.

    Parameters
    ----------
    cycles : float
        Phase advance from frame to frame, between 0 and 0.5.
    turns : float
        Turns of that phase down the rows.
    counted_hz : float
        Frame rate by the frames' times.
    nominals_hz : tuple of float

    Examples
    --------
    >>> best = hypotheses(0.3367, 2.07, 30.0, (50.0,))[0]
    >>> round(best.frame_rate_hz, 2), round(best.idle_ratio, 2), best.direction
    (29.97, 0.38, 'forward')
    """
    found = []
    for nominal_hz in nominals_hz:
        f0_hz = 2.0 * nominal_hz
        for sign in (1, -1):
            for whole in range(int(f0_hz / LEAST_HZ) + 1):
                true_cycles = whole + sign * cycles
                if not f0_hz <= true_cycles * MOST_HZ <= f0_hz * MOST_HZ / LEAST_HZ:
                    continue
                idle = 1.0 - abs(turns) / true_cycles
                if idle < -SLACK_RATIO:
                    continue
                rate_hz = f0_hz / true_cycles
                found.append(
                    RateHypothesis(
                        frame_rate_hz=rate_hz,
                        nominal_hz=nominal_hz,
                        idle_ratio=max(idle, 0.0),
                        read_out_s=abs(turns) / f0_hz,
                        direction="forward" if sign * turns >= 0.0 else "reverse",
                        is_common=any(abs(rate_hz / hz - 1.0) < COMMON_RATIO for hz in COMMON_HZ),
                    )
                )
    found.sort(key=lambda h: (not h.is_common, abs(np.log(h.frame_rate_hz / counted_hz))))
    return tuple(found)


def _slope(cells: Float, n: Float, phase: Float, bands: int, turns: float) -> tuple[float, float]:
    """Turns down the rows from the cells' phases, near a guess, and their standard error.

    Each strip has a constant phase of its own.
    """
    weight = np.cos(np.pi * n / (n[-1] - n[0])) ** 2 * np.exp(-1j * phase)
    tone = (weight @ (cells - cells.mean(axis=0))).reshape(bands, -1)
    place = (np.arange(bands) + 0.5)[:, None] / bands
    tone = tone * np.exp(-2j * np.pi * turns * place)
    tone = tone * np.exp(-1j * np.angle(tone.sum(axis=0)))
    power, residual = np.abs(tone) ** 2, np.angle(tone) / (2.0 * np.pi)
    share = power / power.sum(axis=0)
    down = place - (share * place).sum(axis=0)
    spread = np.sum(power * down**2)
    slope = np.sum(power * down * residual) / spread
    residual = residual - (share * residual).sum(axis=0) - slope * down
    # Errors within a strip may be correlated: the larger of independent and clustered variance.
    pull = power * down * residual / spread
    var = max(
        np.sum(part**2) * part.size / (part.size - 1)
        for part in (pull.ravel(), pull.sum(axis=0))
        if part.size > 1
    )
    return turns + float(slope), float(np.sqrt(var))

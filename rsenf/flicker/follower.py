"""Follows the flicker's phase through a stream of row blocks, second by second.

First it looks for flicker, window by window; when some is found, its phase is followed from there
in both directions. Each second's phase is that of the window around it, fitted anew as the stream
goes on, and checked: the tone must stand out where the fit says it is.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsenf.flicker.acquire import MIN_SNR, NO_FLICKER, Found, acquire
from rsenf.flicker.grid_prior import NODES_PER_S
from rsenf.flicker.phase_fit import Frames, PhaseFit, Place, fit_phase
from rsenf.flicker.profile import ProfileBasis
from rsenf.flicker.second import FlickerSecond
from rsenf.flicker.slow_time import SlowTime
from rsenf.flicker.tone import Tone, ToneFinder
from rsenf.messages import RowBlock
from rsenf.timebase import nanoseconds

Float = NDArray[np.float64]
Complex = NDArray[np.complex128]

NOMINALS_HZ = (50.0, 60.0)
HARMONICS = 3
# Frames held back until the frame rate is known well enough.
RATE_NEEDS_S = 1.0
LOOK_S = 20  # window in which flicker is looked for, and has to stand out
SHORT_S = 8  # the same at the end of a clip that is shorter
SIDE_S = 15  # what a second's window reaches beyond it, before and after
HOLD_S = 60  # seconds are held back so long while nothing is found
MIN_FILL_RATIO = 0.8
# How far the tone may be from where the fit says it is, in resolution cells.
MAX_OFF_CELLS = 1.0
MEMORY = 0.1  # share of a new second in the template that the check looks with
# The phase is linear between nodes, which real grids aren't quite: what that leaves, Hz.
MODEL_STD_HZ = 4e-5


class FlickerFollower:
    """Row blocks in, one :class:`FlickerSecond` for every second of the stream out.

    Parameters
    ----------
    nominal_hz : float, optional
        50 or 60; found from the data when not given.
    search_hz : float
        Half-width of the band searched, as a deviation of the illumination's frequency.
    min_snr : float
        Tone power over noise power in a resolution cell of a 20 s window, below which there is no
        signal.
    """

    def __init__(self, nominal_hz: float | None = None, *, min_snr: float = MIN_SNR) -> None:
        self._nominals = NOMINALS_HZ if nominal_hz is None else (nominal_hz,)
        self._min_snr = min_snr
        self._waiting: list[RowBlock] = []
        self._basis: ProfileBasis | None = None
        self._buffer = SlowTime(1, 0)
        self._rate_hz = float("nan")
        self._reached = 0  # whole seconds that have been looked at
        self._next = 0  # second to be emitted next
        self._path: _Path | None = None
        self._why = NO_FLICKER

    def update(self, block: RowBlock) -> list[FlickerSecond]:
        """Take a block of rows; return the seconds that it completes."""
        if block.frames == 0:
            return []
        if self._basis is None:
            self._waiting.append(block)
            if not self._begin(final=False):
                return []
        elif block.rows == self._basis.rows:
            self._append(block)
        return self._advance(final=False)

    def flush(self) -> list[FlickerSecond]:
        """Return the seconds that are left."""
        if self._basis is None and not (self._waiting and self._begin(final=True)):
            return []
        return self._advance(final=True)

    @property
    def origin_ns(self) -> int:
        """Stream clock at the first frame."""
        return self._buffer.origin_ns

    def _begin(self, *, final: bool) -> bool:
        """Set up when the frame rate is known: from the first frames up to a second."""
        pts = np.concatenate([b.frame_pts_ns for b in self._waiting])
        numbers = np.concatenate([b.frame_number for b in self._waiting])
        enough = int(np.searchsorted(pts, pts[0] + nanoseconds(RATE_NEEDS_S)))
        if enough >= pts.size:
            if not final or pts.size < 2:
                return False
            enough = pts.size - 1
        self._rate_hz = float((numbers[enough] - numbers[0]) * 1e9 / (pts[enough] - pts[0]))
        most_turns = HARMONICS * 2.0 * max(self._nominals) / self._rate_hz
        self._basis = ProfileBasis(self._waiting[0].rows, most_turns)
        self._buffer = SlowTime(self._basis.columns, int(pts[0]))
        for block in self._waiting:
            if block.rows == self._basis.rows:
                self._append(block)
        self._waiting = []
        return True

    def _append(self, block: RowBlock) -> None:
        assert self._basis is not None
        self._buffer.append(block, self._basis.reduce(block).astype(np.complex128))

    def _advance(self, *, final: bool) -> list[FlickerSecond]:
        """Look at every second that is full, then, at the end, at what is left."""
        out: list[FlickerSecond] = []
        last_s = self._buffer.last_t_s
        while self._reached + 1 <= last_s:
            self._reached += 1
            out += self._at(self._reached, final=False)
        if final:
            out += self._at(int(last_s + 1.5 / self._rate_hz), final=True)
        return out

    def _at(self, end: int, *, final: bool) -> list[FlickerSecond]:
        """Do what can be done with the frames before second ``end``; at the end, all of it."""
        out: list[FlickerSecond] = []
        look_s = min(LOOK_S, end)
        if self._path is None and (look_s == LOOK_S or (final and look_s >= SHORT_S)):
            self._look(end - look_s, end)
        if self._path is not None:
            due = end if final else end - SIDE_S
            while self._next < due:
                out.append(self._follow(self._path, self._next, end))
                self._next += 1
            self._buffer.forget_before(self._next - SIDE_S)
            self._path.forget_before(self._next - SIDE_S)
        else:
            due = end if final else end - HOLD_S
            while self._next < due:
                out.append(self._blank(self._next, self._why))
                self._next += 1
            self._buffer.forget_before(self._next)
        return out

    def _frames(self, start: int, end: int) -> tuple[Float, Float]:
        """Times and columns of the usable frames of some seconds."""
        part = self._buffer.between(start, end)
        usable = self._buffer.usable(part)
        return self._buffer.times(part)[usable], self._buffer.values(part)[usable].real

    def _look(self, start: int, end: int) -> None:
        """Look for flicker, and go back along it to the first second that isn't out yet."""
        assert self._basis is not None
        t_s, columns = self._frames(start, end)
        if t_s.size < MIN_FILL_RATIO * self._rate_hz * (end - start):
            self._why = "too few frames are usable"
            return
        found = acquire(
            self._nominals, self._basis, t_s, columns, self._rate_hz, (float(start), float(end))
        )
        if isinstance(found, str):
            self._why = found
            return
        self._nominals = (found.nominal_hz,)
        self._path = _Path(found, start, self._basis)
        self._fit(self._path, start, end)
        first = max(self._next - SIDE_S, 0, int(np.ceil(self._buffer.first_t_s)))
        for before in range(start - 1, first - 1, -1):
            self._fit(self._path, before, min(before + LOOK_S, end))

    def _fit(self, path: _Path, start: int, end: int) -> PhaseFit | None:
        """Fit the phase over some seconds, from what is known of it; None without frames."""
        t_s, columns = self._frames(start, end)
        psi = path.between(start, end)
        if t_s.size < 2.0 * self._rate_hz:
            return None
        carrier = 4.0 * np.pi * path.nominal_hz * t_s
        fit = path.aligned(fit_phase(Frames(t_s - start, carrier, columns), psi))
        path.set(start, fit.psi_rad)
        return fit

    def _follow(self, path: _Path, index: int, end: int) -> FlickerSecond:
        """Return one second, by the window around it."""
        start, stop = max(index - SIDE_S, path.first), min(index + 1 + SIDE_S, end)
        fit = self._fit(path, start, stop)
        if fit is None:
            return self._blank(index, "too few frames are usable")
        centre = min(max(index + 0.5, LOOK_S / 2), max(end - LOOK_S / 2, LOOK_S / 2))
        from_s = max(int(centre - LOOK_S / 2), 0)
        tone, reason = self._check(path, from_s, min(from_s + LOOK_S, end))
        node = (index - start) * NODES_PER_S
        path.learn(fit, tone.snr >= self._min_snr)
        blank = dataclasses.replace(
            self._blank(index, reason),
            nominal_hz=path.nominal_hz,
            turns=path.turns,
            snr_db=_decibels(tone.snr),
        )
        if reason:
            return blank
        part = self._buffer.between(index, index + 1)
        t_s = self._buffer.times(part)
        place = Place(t_s - start, fit.psi_rad.size)
        psi = fit.psi_rad
        return dataclasses.replace(
            blank,
            usable=True,
            f0_hz=2.0 * path.nominal_hz
            + float(psi[node + NODES_PER_S] - psi[node]) / (2.0 * np.pi),
            f0_var_hz2=float(fit.second_var_hz2[node]) + MODEL_STD_HZ**2,
            phase_rad=4.0 * np.pi * path.nominal_hz * t_s + place.at_frames(psi),
            **self._amplitude(path, fit, index, start, stop),
        )

    def _amplitude(
        self, path: _Path, fit: PhaseFit, index: int, start: int, stop: int
    ) -> dict[str, Any]:
        """Amplitude over one second of a fit's window: its model's, and what frames say beyond."""
        t_s, _ = self._frames(start, stop)
        own = (t_s >= index) & (t_s < index + 1)
        told = fit.information[(index - start) * NODES_PER_S :][:NODES_PER_S].sum()
        if not own.any() or not told > 0.0:
            return {}
        psi = Place(t_s[own] - start, fit.psi_rad.size).at_frames(fit.psi_rad)
        size = path.size(fit)
        return {
            "amplitude": complex(size * np.mean(np.exp(1j * psi) * (1.0 + fit.deviation[own]))),
            "amplitude_var": float(size**2 / told),
        }

    def _check(self, path: _Path, start: int, end: int) -> tuple[Tone, str]:
        """Whether the tone stands out in a window, where the fit says it is."""
        t_s, columns = self._frames(start, end)
        finder = ToneFinder(float(end - start), 1.0)
        if t_s.size < MIN_FILL_RATIO * self._rate_hz * (end - start):
            return _NO_TONE, "too few frames are usable"
        mid_s = (start + end) / 2.0
        carrier = np.exp(-4j * np.pi * path.nominal_hz * t_s)
        series = (columns @ path.template.conj()) * carrier
        _, power = finder.periodograms(series[:, None], carrier, t_s - mid_s)
        tone = finder.strongest(power[:, 0], t_s - mid_s)
        if tone.snr < self._min_snr:
            return tone, NO_FLICKER
        if tone.at_edge:
            return tone, "strongest at the edge of the search band"
        psi = path.between(start, end)
        slope_hz = float(psi[-1] - psi[0]) / (2.0 * np.pi * (end - start))
        if abs(tone.offset_hz - slope_hz) * (end - start) > MAX_OFF_CELLS:
            return tone, "the phase was lost"
        return tone, ""

    def _blank(self, index: int, reason: str) -> FlickerSecond:
        part = self._buffer.between(index, index + 1)
        return FlickerSecond(
            index=index,
            start_s=float(index),
            end_s=index + 1.0,
            reason=reason,
            frame_rate_hz=self._rate_hz,
            frame_number=self._buffer.numbers(part),
        )


_NO_TONE = Tone(0.0, np.inf, 0.0, 0.0, at_edge=False)


def _decibels(ratio: float) -> float:
    return float(10.0 * np.log10(ratio)) if 0 < ratio < np.inf else float("nan")


class _Path:
    """What is known of the phase so far, at nodes from second ``first`` on."""

    def __init__(self, found: Found, first: int, basis: ProfileBasis) -> None:
        self.nominal_hz, self.turns, self.first = found.nominal_hz, found.turns, first
        self._psi = found.psi_rad
        self._basis = basis
        self._ramp = basis.ramps(np.array([found.turns]))[:, 0]
        self.template: Complex = self._ramp

    def between(self, start: int, end: int) -> Float:
        """Phase at the nodes of some seconds; beyond what is known it runs on as it was."""
        before = (self.first - start) * NODES_PER_S
        if before > 0:
            slope = self._psi[1] - self._psi[0]
            self._psi = np.concatenate([self._psi[0] + slope * np.arange(-before, 0), self._psi])
            self.first = start
        lacks = (end - self.first) * NODES_PER_S + 1 - self._psi.size
        if lacks > 0:
            slope = self._psi[-1] - self._psi[-2]
            self._psi = np.concatenate([self._psi, self._psi[-1] + slope * np.arange(1, lacks + 1)])
        a, b = ((s - self.first) * NODES_PER_S for s in (start, end))
        return self._psi[a : b + 1].copy()

    def set(self, start: int, psi_rad: Float) -> None:
        """Take over what a fit has found from second ``start`` on."""
        a = (start - self.first) * NODES_PER_S
        self._psi[a : a + psi_rad.size] = psi_rad

    def forget_before(self, second: int) -> None:
        """Drop the nodes before a second."""
        if second > self.first:
            self._psi = self._psi[(second - self.first) * NODES_PER_S :]
            self.first = second

    def size(self, fit: PhaseFit) -> float:
        """Size of the light's swing, levels, by the ramp's share of a fit's template."""
        along = np.abs(np.sum(self._ramp.conj() * fit.template))
        return float(along / np.sum(np.abs(self._ramp) ** 2))

    def aligned(self, fit: PhaseFit) -> PhaseFit:
        """Return a fit whose template is in phase with the ramp: what no fit can know by itself."""
        turn = np.sum(fit.weights * self._ramp.conj() * fit.template)
        if not abs(turn) > 0.0:
            return fit
        turn /= abs(turn)
        near = float(np.angle(turn))
        return dataclasses.replace(
            fit, psi_rad=fit.psi_rad + near, template=fit.template * turn.conjugate()
        )

    def learn(self, fit: PhaseFit, good: bool) -> None:
        """Let what a good second shows of the template into the memory of it."""
        if not good:
            return
        new = fit.template * fit.weights
        size = np.linalg.norm(new)
        if size > 0.0:
            old = self.template / np.linalg.norm(self.template)
            self.template = old + MEMORY * (new / size - old)

"""A clip's ENF beside a reference: what was measured, and what a model says of it.

What a model says is made as the data was: the capture model films a lamp on the reference's grid,
and the very tracker reads the film. Where a reference is itself an average over a window, what
was measured is averaged alike, so that both have passed the same two averages.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from rsenf.discrepancy.clock_offset.clip import Clip
from rsenf.discrepancy.measured import Mask
from rsenf.match.clip_phase import AVERAGED_S, LONGEST_WINDOW_RATIO
from rsenf.match.kernel import average, window_kernel
from rsenf.match.series import Grid, Track, track_of
from rsenf.messages import EnfEstimate
from rsenf.messages.schema import FloatArray
from rsenf.model import CaptureModel, GridPath

MARGIN_S = 120.0  # by which a reference is lengthened with nothing, so that all of a clip is on it
INSIDE = 0.99  # of the weights of an average, that must lie within a block of time
BLOCK_REACHES, LEAST_BLOCK_S = 5.0, 5.0
FEWEST_BLOCKS = 6


@dataclass(frozen=True, eq=False)
class AlignedReference:
    """Estimates of a clip's ENF, and a reference that covers it.

    Attributes
    ----------
    clip : Clip
    track : Track
        Its estimates.
    snr_db : float
        Of most of them.
    grid : Grid
        The reference, as far as it is about the clip.
    lag_s : float
        Of the clip's first frame behind the first sample of that, roughly.
    begins_s : float
        Where in all of the reference that is.
    certain : bool
        Whether the clip is known to be there; else what is left must show it.
    averaged : bool
        Whether the reference is taken for an average over ``AVERAGED_S``.
    """

    clip: Clip
    track: Track
    snr_db: float
    grid: Grid
    lag_s: float
    begins_s: float = 0.0
    certain: bool = True
    averaged: bool = False

    @cached_property
    def t_s(self) -> FloatArray:
        """Centre of each estimate, (n,)."""
        return np.asarray(self.track.first_s + np.arange(self.track.enf_hz.size) * self.track.hop_s)

    @property
    def overlap(self) -> bool:
        """Whether the tracker's windows overlap, so that neighbours share their errors."""
        return self.track.window_s > LONGEST_WINDOW_RATIO * self.track.hop_s

    @cached_property
    def enf_hz(self) -> FloatArray:
        """What was measured, read as the reference is, (n,); NaN where there is nothing."""
        return self.read(self.track.enf_hz)

    def read(self, enf_hz: FloatArray) -> FloatArray:
        """Average estimates as the reference was."""
        if not self.averaged:
            return enf_hz
        # An average needs most of its seconds, not all: noisy clips lack a few.
        return average(enf_hz, window_kernel(AVERAGED_S, self.track.hop_s), least_ratio=0.9)

    @cached_property
    def path_hz(self) -> FloatArray:
        """The reference, lengthened on both sides."""
        nothing = np.full(self._margin, np.nan)
        return np.concatenate([nothing, np.asarray(self.grid.freq_hz, np.float64), nothing])

    @property
    def _margin(self) -> int:
        return math.ceil(MARGIN_S / self.grid.step_s)

    def start_s(self, lag_s: float) -> float:
        """Where the clip starts on the lengthened reference."""
        return lag_s + self._margin * self.grid.step_s

    def path(self, lag_s: float, path_hz: FloatArray | None = None) -> GridPath:
        """Return the reference, or another such, as the light's grid from the first frame on."""
        freq_hz, start_s = self.path_hz if path_hz is None else path_hz, self.start_s(lag_s)
        return GridPath(freq_hz, self.grid.step_s, start_s, self.grid.nominal_hz)

    def on_axis(self, estimates: Sequence[EnfEstimate]) -> FloatArray:
        """Return a film's ENF at the clip's times, (n,); NaN where there is none."""
        told = track_of(estimates)
        told_s = told.first_s + np.arange(told.enf_hz.size) * told.hop_s
        known = np.isfinite(told.enf_hz)
        if not known.any():
            return np.full(self.t_s.size, np.nan)
        # Neither beyond a film's ends nor over its holes.
        lost = np.interp(self.t_s, told_s, (~known).astype(np.float64), 1.0, 1.0) > 0.01
        return np.where(lost, np.nan, np.interp(self.t_s, told_s[known], told.enf_hz[known]))

    def said(self, model: CaptureModel, lag_s: float) -> FloatArray:
        """ENF that the tracker would find, were the model and the reference true, (n,).

        NaN where the reference has a gap, or the tracker would find nothing.
        """
        missing = self.passed(np.isnan(self.path_hz).astype(np.float64), lag_s) > 1e-6
        said_hz = self.on_axis(self.clip.film(model, self.path(lag_s)))
        return np.where(missing, np.nan, said_hz)

    def passed(self, samples: FloatArray, lag_s: float) -> FloatArray:
        """What the tracker's windows make of values on the lengthened reference, to first order."""
        step_s = self.grid.step_s
        if self.overlap:
            smooth = average(samples, window_kernel(self.track.window_s, step_s))
            centre_s = (np.arange(samples.size) + 0.5) * step_s
            known = np.isfinite(smooth)
            return np.interp(self.t_s + self.start_s(lag_s), centre_s[known], smooth[known])
        # A path is integrated as the light's is; small beside its frequency, this is linear.
        path = GridPath(self.grid.nominal_hz + samples * 1e-3, step_s, self.start_s(lag_s))
        half_s = self.track.window_s / 2.0
        told = path.mean_hz(self.t_s - half_s, self.t_s + half_s)
        return np.asarray((told - self.grid.nominal_hz) * 1e3)

    @cached_property
    def reach_s(self) -> float:
        """Time to either side of its centre that a value rests on."""
        if not self.overlap and not self.averaged:
            return self.track.window_s / 2.0
        hop_s, weights = self.track.hop_s, np.ones(1)
        lengths = [self.track.window_s] * self.overlap + [AVERAGED_S] * self.averaged
        for length_s in lengths:
            weights = np.convolve(weights, window_kernel(length_s, hop_s))
        middle = weights.size // 2
        inside = np.cumsum(weights[middle:] + np.append(0.0, weights[middle + 1 :]))
        return float((np.searchsorted(inside, INSIDE) + 0.5) * hop_s)

    @cached_property
    def block_s(self) -> float:
        """Length of the blocks of time that are fitted to and scored on in turn."""
        return max(LEAST_BLOCK_S, BLOCK_REACHES * self.reach_s)

    @cached_property
    def block(self) -> FloatArray:
        """Number of each value's block, (n,); NaN for one that rests on two blocks."""
        first, last = (
            (self.t_s + side * (self.reach_s - 1e-3)) // self.block_s for side in (-1.0, 1.0)
        )
        return np.where(first == last, first, np.nan)

    @cached_property
    def training(self) -> Mask:
        """Values that are fitted to."""
        return np.asarray(np.isfinite(self.enf_hz) & (self.block % 2 == 0))

    @cached_property
    def held_out(self) -> Mask:
        """Values that are scored on."""
        return np.asarray(np.isfinite(self.enf_hz) & (self.block % 2 == 1))

    @property
    def blocks(self) -> int:
        """How many blocks have values."""
        return int(np.unique(self.block[np.isfinite(self.enf_hz + self.block)]).size)

    @cached_property
    def power_hz2(self) -> float:
        """Variance of the reference while the clip lasts."""
        first = max(int(self.lag_s / self.grid.step_s), 0)
        last = int((self.lag_s + self.clip.duration_s) / self.grid.step_s) + 1
        return float(np.nanvar(np.asarray(self.grid.freq_hz[first:last])))


def slope_of(values: FloatArray, hop_s: float) -> FloatArray:
    """Change per second, (n,); 0 where it isn't known."""
    return np.nan_to_num(np.gradient(values, hop_s))

"""A clip's ENF on the time axis of a reference: the measurement, and a model's prediction of it.

The prediction passes the same chain as the data: the capture model simulates a lamp on the
reference's grid, and the same tracker estimates its ENF. If the reference is itself an average over
a window, the measurement is averaged alike, so that both have passed the same two averages.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property

import numpy as np

from rsenf.discrepancy.lines import enf_of
from rsenf.discrepancy.measured import Float32Array, Mask, Measured, frame_rate_of, joined_rows
from rsenf.errors import InputError
from rsenf.match.clip_phase import LONGEST_WINDOW_RATIO, average, window_kernel
from rsenf.match.series import Grid, Track, track_of
from rsenf.messages import EnfEstimate, RowBlock
from rsenf.messages.schema import FloatArray
from rsenf.model import CaptureModel, GridPath, simulate_rows
from rsenf.track import TrackSettings

# From time stamps (frames,) and row means (frames, lines, strips) to estimates.
Tracker = Callable[[FloatArray, Float32Array], Sequence[EnfEstimate]]

SEED = 0
FEW_LINES = 16  # enough for a simulation of frame means
DITHER_LEVEL = 0.01  # noise of a row (levels): without any, the tracker takes misfit for noise
FRAME_MEANS = "frame"  # in place of the read-out axis
MARGIN_S = 120.0  # NaN padding of a reference on both sides, so that it covers all of a clip
INSIDE = 0.99  # share of an average's weights that must lie within a block of time
BLOCK_REACHES, LEAST_BLOCK_S = 5.0, 5.0
FEWEST_BLOCKS = 6


@dataclass(frozen=True, eq=False)
class EnfClip:
    """A clip's ENF estimates, and what the simulation of a model needs."""

    estimates: Sequence[EnfEstimate]
    track: Tracker  # the tracker that made them
    frame_rate: Fraction
    duration_s: float  # to the end of the last frame, by the camera's clock
    frame_means: bool  # whether the data are frame means

    def film(
        self, model: CaptureModel, grid: GridPath, noise_ratio: float = 0.0
    ) -> list[EnfEstimate]:
        """Simulate a model and track its ENF, with hardly any noise.

        Parameters
        ----------
        model : CaptureModel
        grid : GridPath
        noise_ratio : float, optional
            For frame means, the noise over the rms of the flicker.
        """
        shutter = dataclasses.replace(model.shutter, frame_rate=self.frame_rate)
        if self.frame_means:
            shutter = dataclasses.replace(shutter, rows=FEW_LINES, columns=FEW_LINES)
        model = dataclasses.replace(model, shutter=shutter)
        made = simulate_rows(model, grid, self.duration_s, SEED, noise=False)
        level, noise_level = made.level, DITHER_LEVEL
        if self.frame_means:
            level = level.mean(axis=1, keepdims=True)
            noise_level = noise_ratio * float(level.std())
        noise = np.random.default_rng(SEED).standard_normal(level.shape, np.float32)
        level = level + np.float32(noise_level) * noise
        return list(self.track(made.frame_time_s, level))


def clip_of(data: Measured) -> EnfClip:
    """Return the clip of measured rows."""
    rate = float(data.frame_rate)

    def track(stamp_s: FloatArray, level: Float32Array) -> Sequence[EnfEstimate]:
        # As for the data: by frame number, since time stamps may jitter.
        slot = np.rint((stamp_s - stamp_s[0]) * rate)
        return enf_of(level, slot / rate, data.axis, TrackSettings(nominal_hz=data.nominal_hz))

    duration_s = float(data.time_s[-1]) + 1.0 / rate
    return EnfClip(data.estimates.enf, track, data.frame_rate, duration_s, frame_means=False)


def clip_of_frame_means(blocks: Sequence[RowBlock], nominal_hz: float) -> EnfClip:
    """Return the clip of frame means.

    Parameters
    ----------
    blocks : sequence of RowBlock
        Of one epoch, in order.
    nominal_hz : float
        50 or 60.

    Raises
    ------
    InputError
        When there are fewer than two frames, or a level isn't finite.
    """
    level, stamp_s = joined_rows(blocks)
    if stamp_s.size < 2:
        raise InputError("a single frame", "give a recording of mains light")
    settings = TrackSettings(method="frame_mean", nominal_hz=nominal_hz)

    def track(times_s: FloatArray, level: Float32Array) -> Sequence[EnfEstimate]:
        return enf_of(level, times_s, FRAME_MEANS, settings)

    rate = frame_rate_of(stamp_s)
    duration_s = float(stamp_s[-1]) + 1.0 / float(rate)
    return EnfClip(track(stamp_s, level), track, rate, duration_s, frame_means=True)


def holds_frame_means(blocks: Sequence[RowBlock]) -> bool:
    """Whether blocks hold frame means instead of rows."""
    return bool(blocks) and blocks[0].read_out_axis == FRAME_MEANS


@dataclass(frozen=True, eq=False)
class AlignedReference:
    """A clip's ENF estimates, and a reference that covers them."""

    clip: EnfClip
    track: Track  # its estimates
    snr_db: float  # median over the usable estimates
    grid: Grid  # part of the reference about the clip
    lag_s: float  # approximate time of the clip's first frame after the first sample of ``grid``
    begins_s: float = 0.0  # start of ``grid`` in the whole reference
    # whether the place in the reference is certain; if not, the residual must confirm it
    certain: bool = True
    averaged_s: float = 0.0  # window over which the reference is taken for an average; 0 for none

    @cached_property
    def t_s(self) -> FloatArray:
        """Centre of each estimate, (n,)."""
        return np.asarray(self.track.first_s + np.arange(self.track.enf_hz.size) * self.track.hop_s)

    @property
    def overlap(self) -> bool:
        """Whether the tracker's windows overlap, which correlates the errors of neighbours."""
        return self.track.window_s > LONGEST_WINDOW_RATIO * self.track.hop_s

    @cached_property
    def enf_hz(self) -> FloatArray:
        """Measured ENF, averaged as the reference is, (n,); NaN where there is none."""
        return self.read(self.track.enf_hz)

    def read(self, enf_hz: FloatArray) -> FloatArray:
        """Average estimates as the reference is taken to be averaged."""
        if not self.averaged_s:
            return enf_hz
        # A few values may be missing, as in noisy clips.
        return average(enf_hz, window_kernel(self.averaged_s, self.track.hop_s), least_ratio=0.9)

    @cached_property
    def path_hz(self) -> FloatArray:
        """The reference, padded with NaN on both sides."""
        nothing = np.full(self._margin, np.nan)
        return np.concatenate([nothing, np.asarray(self.grid.freq_hz, np.float64), nothing])

    @property
    def _margin(self) -> int:
        return math.ceil(MARGIN_S / self.grid.step_s)

    def start_s(self, lag_s: float) -> float:
        """Start of the clip on the padded reference, given its lag."""
        return lag_s + self._margin * self.grid.step_s

    def path(self, lag_s: float, path_hz: FloatArray | None = None) -> GridPath:
        """Return the reference, or another padded one, as the light's grid from the first frame."""
        freq_hz, start_s = self.path_hz if path_hz is None else path_hz, self.start_s(lag_s)
        return GridPath(freq_hz, self.grid.step_s, start_s, self.grid.nominal_hz)

    def on_axis(self, estimates: Sequence[EnfEstimate]) -> FloatArray:
        """Interpolate a simulation's ENF to the clip's times, (n,); NaN where there is none."""
        track = track_of(estimates)
        centre_s = track.first_s + np.arange(track.enf_hz.size) * track.hop_s
        known = np.isfinite(track.enf_hz)
        if not known.any():
            return np.full(self.t_s.size, np.nan)
        # No interpolation over gaps, and none beyond the ends.
        lost = np.interp(self.t_s, centre_s, (~known).astype(np.float64), 1.0, 1.0) > 0.01
        return np.where(lost, np.nan, np.interp(self.t_s, centre_s[known], track.enf_hz[known]))

    def said(self, model: CaptureModel, lag_s: float) -> FloatArray:
        """Predict the tracker's estimates, (n,); NaN in gaps of the reference or of the track."""
        missing = self.passed(np.isnan(self.path_hz).astype(np.float64), lag_s) > 1e-6
        said_hz = self.on_axis(self.clip.film(model, self.path(lag_s)))
        return np.where(missing, np.nan, said_hz)

    def passed(self, samples: FloatArray, lag_s: float) -> FloatArray:
        """Average a series on the padded reference as the tracker does, to first order, (n,)."""
        step_s = self.grid.step_s
        if self.overlap:
            smooth = average(samples, window_kernel(self.track.window_s, step_s))
            centre_s = (np.arange(samples.size) + 0.5) * step_s
            known = np.isfinite(smooth)
            return np.interp(self.t_s + self.start_s(lag_s), centre_s[known], smooth[known])
        # Averages by the phase integral, which is linear for small deviations.
        path = GridPath(self.grid.nominal_hz + samples * 1e-3, step_s, self.start_s(lag_s))
        half_s = self.track.window_s / 2.0
        mean_hz = path.mean_hz(self.t_s - half_s, self.t_s + half_s)
        return np.asarray((mean_hz - self.grid.nominal_hz) * 1e3)

    @cached_property
    def reach_s(self) -> float:
        """Time on either side of its centre that a value depends on."""
        if not self.overlap and not self.averaged_s:
            return self.track.window_s / 2.0
        hop_s, weights = self.track.hop_s, np.ones(1)
        lengths = [self.track.window_s * self.overlap, self.averaged_s]
        for length_s in filter(None, lengths):
            weights = np.convolve(weights, window_kernel(length_s, hop_s))
        middle = weights.size // 2
        inside = np.cumsum(weights[middle:] + np.append(0.0, weights[middle + 1 :]))
        return float((np.searchsorted(inside, INSIDE) + 0.5) * hop_s)

    @cached_property
    def block_s(self) -> float:
        """Length of the alternating training and held-out blocks."""
        return max(LEAST_BLOCK_S, BLOCK_REACHES * self.reach_s)

    @cached_property
    def block(self) -> FloatArray:
        """Block number of each value, (n,); NaN for a value that depends on two blocks."""
        first, last = (
            (self.t_s + side * (self.reach_s - 1e-3)) // self.block_s for side in (-1.0, 1.0)
        )
        return np.where(first == last, first, np.nan)

    @cached_property
    def training(self) -> Mask:
        """Values of the even blocks, which models are fitted to."""
        return np.asarray(np.isfinite(self.enf_hz) & (self.block % 2 == 0))

    @cached_property
    def held_out(self) -> Mask:
        """Values of the odd blocks, which judge them."""
        return np.asarray(np.isfinite(self.enf_hz) & (self.block % 2 == 1))

    @property
    def blocks(self) -> int:
        """Number of blocks with values."""
        return int(np.unique(self.block[np.isfinite(self.enf_hz + self.block)]).size)

    @cached_property
    def power_hz2(self) -> float:
        """Variance of the reference during the clip."""
        first = max(int(self.lag_s / self.grid.step_s), 0)
        last = int((self.lag_s + self.clip.duration_s) / self.grid.step_s) + 1
        return float(np.nanvar(np.asarray(self.grid.freq_hz[first:last])))


def slope_of(values: FloatArray, hop_s: float) -> FloatArray:
    """Derivative (1/s) of values ``hop_s`` apart, (n,); 0 where it isn't known."""
    return np.nan_to_num(np.gradient(values, hop_s))

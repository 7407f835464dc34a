"""Result of flicker tracking over one second of a stream."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from rsenf.flicker.frame_slips import FrameSlip
from rsenf.flicker.regular_clock import RegularClock

NAN = float("nan")


@dataclass(frozen=True, kw_only=True, eq=False)
class FlickerSecond:
    """The flicker's phase and frequency over one second, on the camera's clock.

    Parameters
    ----------
    index : int
        Seconds since the epoch's first frame.
    start_s, end_s : float
        Interval covered, from the epoch's first frame.
    usable : bool
        Whether phase and frequency may be used.
    reason : str
        Why not; empty when usable.
    nominal_hz : float
        Nominal grid frequency, 50 or 60; NaN while unknown.
    frame_rate_hz : float
        Measured around this second; of a converted stream the camera's own.
    converted : bool
        Whether frames were dropped or repeated to convert the stream from ``frame_rate_hz`` to the
        rate of its stamps, which is undone.
    slips : tuple of FrameSlip
        Lost and repeated frames at frames of this second that the time stamps don't show; corrected
        from there on.
    doubled : tuple of int or None
        Frames of this second that repeat the picture before, noise included; None where pictures
        can't show it.
    jitter_s : float
        Rms jitter of the time stamps where even frame times replace them; else 0.
    f0_hz : float
        Mean illumination frequency (twice the ENF) over the second.
    f0_var_hz2 : float
        Its variance.
    mirror_hz : float
        Frequency about which ``f0_hz`` is mirrored if the read-out runs the other way; NaN where
        its direction is known.
    turns : float
        Turns of the first harmonic's phase down the rows of one frame, as known by then:
        ``f_0·T_ro``; negative for a read-out from the last row to the first.
    apart_turns : float
        Rms deviation of the light's phase from one ramp that all strips share.
    snr_db : float
        Power of the tone over the noise in a resolution cell of the window.
    frame_number : ndarray of int64, shape (frames,)
        The frames that begin in this second.
    phase_rad : ndarray, shape (frames,)
        Unwrapped phase of the first harmonic at the time stamp of each of them, ``2π∫f_0 dt`` plus
        a constant of the epoch.
    amplitude : complex
        The first harmonic in the middle of the second by that second's own frames, levels,
        relative to ``exp(j·2π·2·nominal_hz·t)``. Unlike the phase it isn't smoothed: its errors in
        different seconds are independent.
    amplitude_var : float
        Variance of its real part, and of its imaginary part, levels².
    """

    index: int
    start_s: float
    end_s: float
    usable: bool = False
    reason: str = ""
    nominal_hz: float = NAN
    frame_rate_hz: float = NAN
    converted: bool = False
    slips: tuple[FrameSlip, ...] = ()
    doubled: tuple[int, ...] | None = None
    jitter_s: float = 0.0
    f0_hz: float = NAN
    f0_var_hz2: float = NAN
    mirror_hz: float = NAN
    turns: float = NAN
    apart_turns: float = 0.0
    snr_db: float = NAN
    frame_number: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))
    phase_rad: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))
    amplitude: complex = complex(NAN, NAN)
    amplitude_var: float = NAN

    def by_clock(self, clock: RegularClock) -> FlickerSecond:
        """Return a copy with frequencies rescaled to the clock's present frame rate."""
        ratio, std = clock.rate_ratio
        return replace(
            self,
            jitter_s=clock.jitter_s,
            frame_rate_hz=ratio * self.frame_rate_hz,
            f0_hz=ratio * self.f0_hz,
            f0_var_hz2=self.f0_var_hz2 + (std * self.f0_hz) ** 2,
            mirror_hz=ratio * self.mirror_hz,
        )

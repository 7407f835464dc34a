"""Measured quantities: the ENF, the camera's idle ratio and frame rate, and a grid's reference.

An :class:`EnfEstimate` carries everything that later stages need. The idle ratio is the share of
the frame period in which no row is read.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from rsenf.messages.header import Header
from rsenf.messages.schema import FloatArray, Int64Array, UInt32Array, field, message

NAN = float("nan")


@message(3, version=1)
@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class EnfEstimate:
    """ENF over one interval, by one method, under one hypothesis.

    Several hypotheses (lines, harmonics, idle ratios) may be published for the same interval;
    ``rank`` 0 is the tracker's choice. The amplitude is the complex baseband of the flicker in slow
    time, relative to the carrier ``exp(j·2π·carrier_hz·(t − origin))`` on the stream clock. Phase
    matching uses its phase, idle estimation compares its magnitude between lines.
    """

    header: Header = field(1, "", None)
    method: str = field(2, "name of the estimator", "")
    rank: int = field(3, "0 for the tracker's own choice, 1 … for other hypotheses", 0)
    nominal_hz: float = field(4, "nominal grid frequency, 50 or 60", NAN)
    harmonic: int = field(5, "harmonic k of the illumination frequency, from 1", 1)
    line_m: int = field(6, "line k·f0 + m·F_r of the row-concatenated spectrum (paper Eq. 21)", 0)
    line_hz: float = field(7, "nominal position of that line", NAN)
    idle_ratio: float = field(8, "idle hypothesis, 0 to 1; NaN when the method makes none", NAN)
    origin_pts_ns: int = field(9, "stream clock of the epoch's first frame", 0)
    start_pts_ns: int = field(10, "stream clock at the start of the interval covered", 0)
    end_pts_ns: int = field(11, "stream clock at its end", 0)
    frame_rate_hz: float = field(12, "measured over the interval", NAN)
    enf_hz: float = field(13, "electric network frequency on the camera's clock; NaN for none", NAN)
    enf_var_hz2: float = field(14, "variance of enf_hz about the grid's 1 s mean", NAN)
    snr_db: float = field(15, "line power over noise power in the window", NAN)
    usable: bool = field(16, "whether the estimate may be used", False)
    reason: str = field(17, "why not usable; empty when usable", "")
    carrier_hz: float = field(18, "frequency that the amplitudes are relative to", NAN)
    points: int = field(19, "number of slow-time amplitudes", 0)
    amplitude_pts_ns: Int64Array = field(
        20, "stream clock at the centre of each", wire="sfixed64", shape=("points",)
    )
    amplitude_re: FloatArray = field(21, "real part, levels", wire="double", shape=("points",))
    amplitude_im: FloatArray = field(22, "imaginary part, levels", wire="double", shape=("points",))
    amplitude_var_re: FloatArray = field(
        23, "variance of the real part, levels²", wire="double", shape=("points",)
    )
    amplitude_var_im: FloatArray = field(
        24, "variance of the imaginary part, levels²", wire="double", shape=("points",)
    )
    amplitude_cov: FloatArray = field(
        25, "covariance of the two, levels²", wire="double", shape=("points",)
    )
    converted: bool = field(
        26, "whether frames were dropped or doubled to give another rate than frame_rate_hz", False
    )
    slips: int = field(27, "places where frames are lost or shown again, the stamps silent", 0)
    slip_frame: Int64Array = field(
        28, "number of the first frame after each", wire="sfixed64", shape=("slips",)
    )
    slip_frames: Int64Array = field(
        29, "frames lost; negative for shown again", wire="sfixed64", shape=("slips",)
    )

    mirror_hz: float = field(
        30,
        "ENF that enf_hz is mirrored about if the read-out runs the other way; 0 where its "
        "direction is known",
        0.0,
    )
    is_reverse: bool = field(
        31, "whether it rests on a read-out from the last row to the first", False
    )
    rate_hypotheses: tuple[RateHypothesis, ...] = field(
        32, "frame rates that the light goes with, where the rate isn't known or seems wrong", ()
    )

    @property
    def t_s(self) -> float:
        """Centre of the interval, in s from the epoch's first frame."""
        return ((self.start_pts_ns + self.end_pts_ns) / 2 - self.origin_pts_ns) / 1e9

    @property
    def enf_std_hz(self) -> float:
        """Standard error of ``enf_hz``; NaN where there is none."""
        return math.sqrt(self.enf_var_hz2) if self.enf_var_hz2 >= 0 else NAN


@message(2, version=1)
@dataclass(frozen=True, kw_only=True, slots=True)
class RateHypothesis:
    """A possible frame rate, and the camera's parameters at that rate."""

    frame_rate_hz: float = field(1, "with the grid at its nominal frequency", NAN)
    nominal_hz: float = field(2, "50 or 60", NAN)
    idle_ratio: float = field(3, "0 to 1", NAN)
    read_out_s: float = field(4, "time from the first row to the last and one more", NAN)
    direction: str = field(5, "of read-out, 'forward' or 'reverse'", "")
    is_common: bool = field(6, "whether cameras often have this rate", False)


@message(7, version=1)
@dataclass(frozen=True, kw_only=True, slots=True)
class IdleEstimate:
    """Idle ratio of the camera from everything seen so far in the epoch."""

    header: Header = field(1, "", None)
    method: str = field(2, "name of the estimator", "")
    verdict: str = field(3, "'estimated', 'ambiguous', 'no_signal' or 'refused'", "no_signal")
    reason: str = field(4, "why nothing is claimed; empty when estimated", "")
    idle_ratio: float = field(5, "0 to 1; NaN for none", NAN)
    idle_ratio_var: float = field(6, "its variance", NAN)
    idle_ratio_low: float = field(7, "lower end of the 95 % interval", NAN)
    idle_ratio_high: float = field(8, "upper end of the 95 % interval", NAN)
    read_out_time_s: float = field(9, "time from the first row to the last and one more", NAN)
    read_out_time_var_s2: float = field(10, "its variance", NAN)
    direction: str = field(11, "'forward', 'reverse' or '' when not told apart", "")
    frame_rate_hz: float = field(12, "measured", NAN)
    nominal_hz: float = field(13, "50 or 60", NAN)
    warnings: tuple[str, ...] = field(14, "what a reader should know", ())
    converted: bool = field(
        15, "whether frames were dropped or doubled to give another rate than frame_rate_hz", False
    )
    slips: int = field(16, "places where frames are lost or shown again, the stamps silent", 0)
    rate_hypotheses: tuple[RateHypothesis, ...] = field(
        17, "frame rates that the light goes with, where the rate isn't known or seems wrong", ()
    )

    @property
    def idle_ratio_std(self) -> float:
        """Standard error of the idle ratio."""
        return math.sqrt(self.idle_ratio_var) if self.idle_ratio_var >= 0 else NAN

    @property
    def read_out_time_std_s(self) -> float:
        """Standard error of the read-out time."""
        return math.sqrt(self.read_out_time_var_s2) if self.read_out_time_var_s2 >= 0 else NAN

    @property
    def in_short(self) -> str:
        """Verdict on one line, for logs."""
        if self.verdict != "estimated":
            return f"{self.verdict}: {self.reason}"
        return f"idle {100 * self.idle_ratio:.3f} ± {100 * self.idle_ratio_std:.3f} %"


@message(12, version=1)
@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class ReferenceBlock:
    """Consecutive samples of a grid's frequency.

    Sample ``k`` of the reference covers ``[t0 + k·step, t0 + (k+1)·step)``.
    """

    header: Header = field(1, "", None)
    grid: str = field(2, "name of the grid", "")
    nominal_hz: float = field(3, "50 or 60", NAN)
    t0_ns: int = field(4, "start of the reference's first sample, UTC since 1970; 0 is unknown", 0)
    step_ns: int = field(5, "time between samples", 0)
    first: int = field(6, "index of this block's first sample in the reference", 0)
    samples: int = field(7, "samples in this block", 0)
    total: int = field(8, "samples in the whole reference; 0 while it grows", 0)
    freq_hz: FloatArray = field(9, "NaN where there is none", wire="double", shape=("samples",))
    readings: UInt32Array = field(
        10,
        "readings behind each sample: 0 a gap, above 1 duplicates",
        wire="fixed32",
        shape=("samples",),
    )
    zone_unknown: bool = field(11, "whether its times told no zone and were taken as UTC", False)

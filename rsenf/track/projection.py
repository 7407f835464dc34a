"""Coherent projection: tracks the phase of the flicker frame by frame, from all of its lines.

Model: all lines ``k·f_0 + m·F_r`` of the row-luminance series (paper, Eq. 21) are one phase ``φ``
in the frames' row profiles, ``r(n) = c + Re Σ_k C_k·exp(j·k·φ(t_n)) + noise``; the frequency has
the Gaussian-process prior of :mod:`rsenf.flicker.grid_prior`.

Likelihood: Gaussian with Student-t weights (:mod:`rsenf.flicker.phase_fit`). The ENF of a second is
half the advance of the posterior mode, ``(φ(t + 1 s) − φ(t)) / 4π``, its variance the posterior's.

Approximate: the posterior is Gaussian about its mode, in windows of 31 s. The phase is linear
between nodes 0.25 s apart, which adds 0.04 mHz to the standard error of the illumination frequency.

References
----------
- Rife, D. C. and Boorstyn, R. R. (1974), Single tone parameter estimation from discrete-time
  observations, IEEE Trans. Information Theory 20.
- Su, H., Hajj-Ahmad, A., Garg, R. and Wu, M. (2014), Exploiting rolling shutter for ENF signal
  extraction from video, ICIP.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np

from rsenf.flicker.conversions import SeamWatch
from rsenf.flicker.follower import FlickerFollower, Follower
from rsenf.flicker.mains import FAINT, is_faint
from rsenf.flicker.second import FlickerSecond
from rsenf.messages import EnfEstimate, Header, RowBlock
from rsenf.timebase import nanoseconds
from rsenf.track.method import EnfMethod, TrackSettings


class ProjectionTracker(EnfMethod):
    """ENF by coherent projection.

    Parameters
    ----------
    settings : TrackSettings, optional
        The window adapts to the signal: ``window_s`` and ``hop_s`` aren't used.
    follower : Follower, optional
        Flicker follower shared with another stage; by default its own.
    """

    name = "projection"
    help = "follows the phase of the flicker by all harmonics and lines together"
    shares_follower = True

    def __init__(
        self, settings: TrackSettings | None = None, follower: Follower | None = None
    ) -> None:
        super().__init__(settings)
        s = self.settings
        self._follower = follower or FlickerFollower(s.nominal_hz, min_snr=s.min_snr)
        self._seams = SeamWatch()
        self._header: Header | None = None
        self._level = 0.0  # 0 for frame means

    def update(self, message: RowBlock) -> list[Any]:
        """Take a block of rows; return the estimates of the seconds that it completes."""
        # A film may begin black.
        if message.frames and message.rows > 1 and (message.usable or not self._level):
            self._level = float(message.level.mean(dtype=np.float64))
        if message.frames:
            self._header = message.header
        seconds = self._seams.update(self._follower.update(message))
        return [self._estimate(second) for second in seconds]

    def flush(self) -> list[Any]:
        """Return the estimates of the seconds that are left."""
        seconds = self._seams.update(self._follower.flush())
        return [self._estimate(second) for second in seconds + self._seams.flush()]

    def _estimate(self, second: FlickerSecond) -> EnfEstimate:
        blank = self._blank(second)
        enf_var_hz2 = second.f0_var_hz2 / 4.0
        if second.usable and enf_var_hz2 > self.settings.max_std_hz**2:
            return dataclasses.replace(blank, reason="too uncertain")
        if not second.usable:
            return blank
        ratio = abs(second.amplitude) / self._level if self._level > 0.0 else np.inf
        if is_faint(ratio, second.f0_hz, second.nominal_hz):
            return dataclasses.replace(blank, reason=FAINT)
        return dataclasses.replace(
            blank,
            enf_hz=second.f0_hz / 2.0,
            enf_var_hz2=enf_var_hz2,
            mirror_hz=second.mirror_hz / 2.0 if math.isfinite(second.mirror_hz) else 0.0,
            is_reverse=second.turns < 0.0,
            idle_ratio=_idle_ratio(second),
            usable=True,
            **_amplitude(second, blank.origin_pts_ns),
        )

    def _blank(self, second: FlickerSecond) -> EnfEstimate:
        """Return an estimate of a second with all but its frequency."""
        assert self._header is not None
        origin_ns = self._follower.origin_ns
        start_ns, end_ns = (origin_ns + nanoseconds(t) for t in (second.start_s, second.end_s))
        header = self._header.at(
            start_ns,
            seq=second.index,
            frame_first=int(second.frame_number[0]) if second.frame_number.size else -1,
            frame_last=int(second.frame_number[-1]) if second.frame_number.size else -1,
        )
        return EnfEstimate(
            header=header,
            method=self.name,
            nominal_hz=second.nominal_hz,
            line_hz=2.0 * second.nominal_hz,
            origin_pts_ns=origin_ns,
            start_pts_ns=start_ns,
            end_pts_ns=end_ns,
            frame_rate_hz=second.frame_rate_hz,
            snr_db=second.snr_db,
            reason=second.reason,
            converted=second.converted,
            slips=len(second.slips),
            slip_frame=np.array([slip.frame_number for slip in second.slips], np.int64),
            slip_frames=np.array([slip.frames for slip in second.slips], np.int64),
        )


def _idle_ratio(second: FlickerSecond) -> float:
    """Idle ratio from the turns down the rows; NaN without a rolling shutter."""
    idle = 1.0 - abs(second.turns) * second.frame_rate_hz / second.f0_hz
    return min(max(idle, 0.0), 1.0) if second.turns else float("nan")


def _amplitude(second: FlickerSecond, origin_ns: int) -> dict[str, Any]:
    """Return the amplitude fields of :class:`rsenf.messages.EnfEstimate`."""
    if not math.isfinite(second.amplitude_var):
        return {}
    variance = np.array([second.amplitude_var])
    return {
        "carrier_hz": 2.0 * second.nominal_hz,
        "points": 1,
        "amplitude_pts_ns": np.array(
            [origin_ns + nanoseconds((second.start_s + second.end_s) / 2.0)]
        ),
        "amplitude_re": np.array([second.amplitude.real]),
        "amplitude_im": np.array([second.amplitude.imag]),
        "amplitude_var_re": variance,
        "amplitude_var_im": variance,
        "amplitude_cov": np.zeros(1),
    }

"""Coherent projection: tracks the phase of the flicker frame by frame, from all of its lines.

All lines ``f_0 + m·F_r`` of the row-luminance series (paper, Eq. 21) are one tone of the frames'
row profiles. :class:`rsenf.flicker.follower.FlickerFollower` tracks its phase; here the phase
advance over each second becomes an estimate of the grid's mean frequency over just that second.

:class:`SeamWatch` checks for a frame rate that is wrong by 0.1 %, such as 29.97 frames/s for 30. A
recording converted between such rates loses or repeats a frame every 1001 frames (a seam), and in
between its light's frequency is off by 0.1 %, as a grid's own may be. So if the other rate would
put the grid at a likelier frequency, seconds are held back until more than 1001 consecutive frames
show no seam; otherwise they become unusable.
"""

from __future__ import annotations

import dataclasses
import math
from collections import deque
from collections.abc import Iterable
from typing import Any

import numpy as np

from rsenf.flicker.follower import FlickerFollower
from rsenf.flicker.frame_slips import HALVES, LEAST_LEAP_RAD, LEAST_LOG_RATIO, FrameSlip
from rsenf.flicker.lines import SURE_LOG_ODDS, usual_log_odds
from rsenf.flicker.mains import FAINT, is_faint
from rsenf.flicker.phase_tracker import CHECK_S
from rsenf.flicker.second import FlickerSecond
from rsenf.flicker.shared import Follower
from rsenf.messages import EnfEstimate, Header, RowBlock
from rsenf.timebase import nanoseconds
from rsenf.track.method import EnfMethod
from rsenf.track.settings import TrackSettings

NTSC = 1.001
WHOLE_HZ = (24.0, 30.0, 48.0, 60.0, 120.0)
RATE_RATIO = 1e-4  # tolerance of a rate from a usual one
BEAT_FRAMES = 1001
SLACK_FRAMES = 8  # tolerance of a seam's place
# Log odds of the frame rate by the stamps, from the frequency alone. One recording in twenty may be
# converted so: below the first value a conversion is likelier than one in five, and seconds wait;
# below the second it is even, and they become unusable. After a slip the odds must be certain.
WAIT_LOG_ODDS, LEAST_LOG_ODDS = -1.4, -3.0
SAME_TURNS = 0.05  # tolerance between equal phase jumps
CLEARLY = 2.0  # factor of a slip's threshold for certain detection
HOLD_S = 60  # longest wait of a second
SEAMS = (
    "the frequency is off by 0.1 %, as where the frame rate was converted between 29.97 and 30 or "
    "alike, and no stretch of frames shows that it wasn't"
)


class SeamWatch:
    """Holds seconds back until their frame rate isn't in doubt; else returns them as unusable."""

    def __init__(self) -> None:
        self._waiting: deque[FlickerSecond] = deque()
        self._whole = 0  # consecutive frames without a slip
        self._is_told = False  # whether a slip would be detected
        self._is_clear = False
        self._slips: list[int] = []  # numbers of the first frames after possible seams
        self._off_hz, self._seconds = [0.0, 0.0], 0  # summed deviations, by stamps and other rate

    def update(self, seconds: Iterable[FlickerSecond]) -> list[FlickerSecond]:
        """Add seconds; return those that are due."""
        out: list[FlickerSecond] = []
        for second in seconds:
            self._waiting.append(second)
            self._take(second)
            wait = SURE_LOG_ODDS if self._is_slipped else WAIT_LOG_ODDS
            if not self._is_told or self._log_odds > wait:
                out += self.flush()
            elif second.index - self._waiting[0].index >= HOLD_S:
                out.append(self._judged(self._waiting.popleft()))
        return out

    def flush(self) -> list[FlickerSecond]:
        """Return the seconds held back."""
        out = [self._judged(second) for second in self._waiting]
        self._waiting.clear()
        return out

    def _judged(self, second: FlickerSecond) -> FlickerSecond:
        least = SURE_LOG_ODDS if self._is_slipped else LEAST_LOG_ODDS
        if not second.usable or self._log_odds >= least:
            return second
        return dataclasses.replace(second, usable=False, reason=SEAMS)

    @property
    def _is_slipped(self) -> bool:
        """Whether slips are whole numbers of beats apart, as seams are.

        A beat is half as long where every other frame is shown.
        """
        return bool(self._slips) and all(
            abs(math.remainder(slip - self._slips[0], BEAT_FRAMES / 2.0)) <= SLACK_FRAMES
            for slip in self._slips
        )

    @property
    def _log_odds(self) -> float:
        """Log odds of the frame rate by the stamps."""
        if self._is_clear or not self._seconds:
            return math.inf
        off_hz, other_hz = (off / self._seconds for off in self._off_hz)
        return usual_log_odds(off_hz, other_hz)

    def _take(self, second: FlickerSecond) -> None:
        """Update the statistics with a second."""
        other = _other_ratio(second.frame_rate_hz)
        if not second.usable or second.converted or not other:
            self._whole = 0
            return
        nominal_hz = 2.0 * second.nominal_hz
        self._seconds += 1
        self._off_hz[0] += second.f0_hz - nominal_hz
        self._off_hz[1] += second.f0_hz * other - nominal_hz
        slips = [slip.frame_number for slip in second.slips if _is_seam(slip, second, other)]
        self._is_told = _tells_slips(second)
        if second.doubled is not None and other < 1.0:
            slips += second.doubled  # none where every other frame of twice the rate is shown
        self._slips += slips
        if second.doubled and other > 1.0:  # a repeated picture isn't a lost frame
            self._slips = [s for s in self._slips if min(abs(s - d) for d in second.doubled) > 1]
        after = int((second.frame_number >= max(slips, default=-1)).sum())
        self._whole = (after if slips else self._whole + after) if self._is_told else 0
        self._is_clear |= self._whole > BEAT_FRAMES + SLACK_FRAMES


def _other_ratio(rate_hz: float) -> float:
    """Possible rate of the camera over that by the stamps; 0 if there is none."""
    for whole_hz in WHOLE_HZ:
        for usual_hz, other in ((whole_hz, 1.0 / NTSC), (whole_hz / NTSC, NTSC)):
            if abs(rate_hz / usual_hz - 1.0) < RATE_RATIO:
                return other
    return 0.0


def _is_seam(slip: FrameSlip, second: FlickerSecond, other: float) -> bool:
    """Whether the phase jumps as at a seam: by a frame, or half if every other one is shown."""
    turns, sign = second.f0_hz / second.frame_rate_hz, 1.0 if other > 1.0 else -1.0
    return any(
        abs(math.remainder((slip.frames - sign * part) * turns, 1.0)) < SAME_TURNS
        for part in (1.0, 0.5)
    )


def _tells_slips(second: FlickerSecond) -> bool:
    """Whether the light's phase would certainly reveal a slip."""
    leap_rad = 2.0 * math.pi * abs(math.remainder(second.f0_hz / second.frame_rate_hz, 1.0))
    frame_var = CHECK_S * second.frame_rate_hz / 2.0 / 10.0 ** (second.snr_db / 10.0)
    gain = HALVES[-1] * 2.0 * (1.0 - math.cos(leap_rad / 2.0)) / frame_var
    return leap_rad > LEAST_LEAP_RAD and gain > CLEARLY * LEAST_LOG_RATIO


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
        if message.frames and self._header is None and message.rows > 1:
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
        newest, origin_ns = self._header, self._follower.origin_ns
        start_ns, end_ns = (origin_ns + nanoseconds(t) for t in (second.start_s, second.end_s))
        camera_ns = newest.camera_time_ns + start_ns - newest.pts_ns
        header = dataclasses.replace(
            newest,
            seq=second.index,
            pts_ns=start_ns,
            camera_time_ns=camera_ns if newest.camera_time_ns else 0,
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

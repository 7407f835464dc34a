"""Detects frame-rate conversion of a stream: from its pictures, else from its light.

All stages that rely on frame times share this decision: those that can undo a conversion do so, the
others give no estimate.

:class:`SeamWatch` checks for a frame rate that is wrong by 0.1 %, such as 29.97 frames/s for 30. A
recording converted between such rates loses or repeats a frame every 1001 frames (a seam), and in
between its light's frequency is off by 0.1 %, as a grid's own may be. So if the other rate gives
the more usual frequency, seconds are held back until more than 1001 consecutive frames show no
seam; otherwise they become unusable.
"""

from __future__ import annotations

import dataclasses
import math
from collections import deque
from collections.abc import Iterable

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from rsenf.flicker.acquire import acquire
from rsenf.flicker.frame_slips import HALVES, LEAST_LEAP_RAD, LEAST_LOG_RATIO, FrameSlip
from rsenf.flicker.lines import SURE_LOG_ODDS, ProfileBasis, alias_hz, usual_log_odds
from rsenf.flicker.phase_tracker import CHECK_S
from rsenf.flicker.picture_news import LAGS, PictureChange, find_remade
from rsenf.flicker.rate_conversion import (
    RATES_HZ,
    SAME_RATE_RATIO,
    STILL_HZ,
    Conversion,
    find_conversion,
    round_rate,
)
from rsenf.flicker.regular_clock import RegularClock, RoundedClock
from rsenf.flicker.second import FlickerSecond
from rsenf.flicker.slow_time import SlowTime
from rsenf.messages import RowBlock

Float = NDArray[np.float64]

HARMONICS = 3
# Length of the smoothing filter, beat phases tried; and for a conversion found by drift, the least
# factor in standard errors, and its largest distance from 1.
SMOOTH_S, DRIFT_PLACES, MIN_STDS, MOST_OFF_FACTOR = 2.0, 32, 10.0, 0.2
# Classes of frames by their phase in a conversion's beat; and the largest power of their lateness
# that isn't the predicted one, over that.
BEAT_PHASES, MOST_OFF_BEAT = 8, 0.2
DRIFT_BLOCKS = 8  # blocks of time, whose spread enters the factor's standard error
# Difference between two pictures, relative to the usual one, below which they are the same; and
# share of frames that repeat the last above which a codec causes it.
SAME_PICTURE, MOST_DOUBLED = 0.02, 0.1
MOST_NEWS = 0.7  # of a new picture's difference: repeats of one differ by less, behind a codec, too
MUCH_CLEARER = 2.0  # ratio of the light's SNRs above which even times replace the stamps
AGAIN_S = 60.0  # interval between searches in :meth:`Conversions.why_not`
NTSC = 1.001
WHOLE_HZ = (24.0, 30.0, 48.0, 60.0, 120.0)
RATE_RATIO = 1e-4  # largest relative distance from a usual rate
BEAT_FRAMES = 1001
SLACK_FRAMES = 8  # tolerance of a seam's place
# Log odds of the rate by the stamps, from the frequency alone; one recording in twenty may be
# converted. Below the first, a conversion is likelier than one in five, and seconds wait; below the
# second it is even, and they are refused in the end. After a slip SURE_LOG_ODDS is needed.
WAIT_LOG_ODDS, LEAST_LOG_ODDS = -1.4, -3.0
SAME_TURNS = 0.05  # largest difference between equal phase jumps
CLEARLY = 2.0  # factor of a slip's threshold for certain detection
HOLD_S = 60  # longest wait of a second
SEAMS = (
    "the frequency is off by 0.1 %, as where the frame rate was converted between 29.97 and 30 or "
    "alike, and no stretch of frames shows that it wasn't"
)


class Conversions:
    """Buffers a stream of rows, and searches it for frame-rate conversion.

    Parameters
    ----------
    nominals_hz : tuple of float
        Nominal frequencies of the grids whose light is sought.
    first : RowBlock
        First block of the stream.
    rate_hz : float
        Frame rate by the time stamps.

    Attributes
    ----------
    basis : ProfileBasis
    columns : SlowTime
        Reduced profiles.
    """

    def __init__(self, nominals_hz: tuple[float, ...], first: RowBlock, rate_hz: float) -> None:
        self._nominals_hz, self._rate_hz = nominals_hz, rate_hz
        origin_ns = int(first.frame_pts_ns[0])
        self.basis = ProfileBasis(first.rows, HARMONICS * 2.0 * max(nominals_hz) / rate_hz)
        self.columns = SlowTime(self.basis.columns, origin_ns, np.float64)
        self._new, self._news = SlowTime(len(LAGS), origin_ns, np.float64), PictureChange()
        self._again_s, self._why = -np.inf, ""

    def add(self, block: RowBlock) -> None:
        """Append a block with as many rows as the first."""
        self.columns.append(block, self.basis.reduce(block))
        self._new.append(block, self._news.of(block.level))

    def forget_before(self, t_s: float) -> None:
        """Drop the frames before a time."""
        for values in (self.columns, self._new):
            values.forget_before(t_s)

    def find(self, start_s: float, end_s: float) -> tuple[Conversion | None, bool]:
        """Find how a time span was converted.

        Parameters
        ----------
        start_s, end_s : float

        Returns
        -------
        conversion : Conversion or None
        is_proven : bool
            Whether pictures or their slow drift show it; else only the light's tone does.
        """
        part = self.columns.between(start_s, end_s)
        if RegularClock.fit(self.columns.numbers(part), self.columns.times(part)) is not None:
            return None, False  # stamps jitter, and converters write even ones
        stamp_s, news = self._new.usable_of(start_s, end_s)
        proven = find_remade(stamp_s, news, self._rate_hz, self._news.chance)
        alias = [abs(alias_hz(2.0 * hz, self._rate_hz)) for hz in self._nominals_hz]
        if proven is not None and not (proven.blended and max(alias) < STILL_HZ):
            return proven, True  # blends of neighbours under light that stands still change nothing
        t_s, columns = self.columns.usable_of(start_s, end_s)
        drifts = find_by_drift(self._nominals_hz, t_s, columns, self._rate_hz)
        if drifts is not None:
            return drifts, True
        found = find_conversion(self._nominals_hz, t_s, columns, self._rate_hz)
        return found if found and _is_shown(found, stamp_s, news[:, 0]) else None, False

    def why_not(self, start_s: float, end_s: float) -> str:
        """Return why frame times are unreliable, or ''; searched again every ``AGAIN_S`` s."""
        if end_s >= self._again_s:
            found, _ = self.find(start_s, end_s)
            self._again_s = end_s + AGAIN_S
            self._why = found.words if found else ""
        return self._why

    def doubled(self, second: int) -> tuple[int, ...] | None:
        """Frames of a second that repeat the picture before; None where noise can't show it."""
        part = self._new.between(second, second + 1)
        news = self._new.values(part)[:, 0]
        usual = float(np.median(news)) if news.size else 0.0
        # The stream's first frame has no predecessor.
        same = (news < SAME_PICTURE * usual) & (self._new.times(part) > 0.0)
        if not usual > 0.0 or same.sum() > MOST_DOUBLED * news.size:
            return None
        return tuple(self._new.numbers(part)[same].tolist())

    def clock_of(self, start_s: int, end_s: int, min_snr: float) -> RegularClock | None:
        """Return an even clock if stamps are rounded, or the light's SNR is much higher by it."""
        part = self.columns.between(start_s, end_s)
        usable = self.columns.usable(part)
        numbers, t_s = self.columns.numbers(part)[usable], self.columns.times(part)[usable]
        if rounded := RoundedClock.of_stamps(t_s):
            return rounded
        clock = RegularClock.fit(numbers, t_s)
        if clock is None:
            return None
        columns, snr = self.columns.values(part)[usable], []
        for times in (clock.times(numbers, t_s), t_s):
            found = acquire(
                self._nominals_hz, self.basis, times, columns, clock.frame_rate_hz,
                (start_s, end_s), min_snr,
            )  # fmt: skip
            snr.append(0.0 if isinstance(found, str) else found.tone.snr)
        return clock if snr[0] > MUCH_CLEARER * snr[1] else None

    def go_by(self, clock: RegularClock) -> None:
        """Replace the time stamps of all frames so far by a regular clock's."""
        self._rate_hz = clock.frame_rate_hz
        for values in (self.columns, self._new):
            values.go_by(clock)

    def undo(self, conversion: Conversion) -> None:
        """Replace time stamps by the times at which the camera took the frames."""
        for values in (self.columns, self._new):
            values.convert(conversion)


def _is_shown(found: Conversion, stamp_s: Float, news: Float) -> bool:
    """Whether pictures that a conversion would have repeated differ less than the others."""
    if found.blended or found.source_hz > found.shown_hz:
        return True
    again = np.diff(np.floor(found.source_frames(stamp_s)), prepend=-1.0) == 0.0
    return bool(np.median(news[again]) < MOST_NEWS * np.median(news[~again]))


def find_by_drift(
    nominals_hz: tuple[float, ...], t_s: Float, columns: Float, shown_hz: float
) -> Conversion | None:
    """Detect a conversion by slow changes, which the frames then show at uneven times.

    Light with an alias at 0 Hz, both at the camera's rate and at that of the stamps, still drifts
    with the grid. The residual of each frame from the smooth course is the course's slope times the
    lateness of its stamp. A hypothetical conversion predicts the lateness, so the regression of one
    on the other, through the origin, has the factor 1 for the right one. It is doubtful where the
    phases of its beat are late in another way: an encoder's B frames have a beat, too.

    Parameters
    ----------
    nominals_hz, t_s, columns, shown_hz
        As in :func:`rsenf.flicker.rate_conversion.find_conversion`.
    """
    shown = round_rate(shown_hz)
    half = int(SMOOTH_S * shown) // 2
    if half < 2 or t_s.size < 8 * half or np.ptp(np.rint(np.diff(t_s) * shown)) > 0:
        return None  # the filter needs consecutive frames, more than a parabola's three
    rough, slope = _course(columns, half)
    slope *= shown
    weight = 1.0 / np.maximum(rough.var(axis=0), np.finfo(float).tiny)
    gain, power = slope**2 @ weight, (slope * rough) @ weight
    blocks = np.linspace(0, gain.size, DRIFT_BLOCKS, endpoint=False).astype(int)
    best, found = MIN_STDS, None
    for source_hz in RATES_HZ:
        if abs(source_hz / shown - max(round(source_hz / shown), 1)) < SAME_RATE_RATIO:
            continue
        if min(abs(math.remainder(2.0 * hz, source_hz)) for hz in nominals_hz) > STILL_HZ:
            continue
        for place in np.arange(DRIFT_PLACES) / DRIFT_PLACES:
            made = Conversion(source_hz, shown, float(place))
            late_s = _course((made.taken_s(t_s) - t_s)[:, None], half)[0][:, 0]
            size = np.add.reduceat(gain * late_s**2, blocks)
            if not size.min() > 0.0:
                continue
            cross = np.add.reduceat(power * late_s, blocks)
            factor = float(cross.sum() / size.sum())
            # What a codec suppresses has a different factor in each block.
            std = max(size.sum() ** -0.5, float(np.std(cross / size)) / DRIFT_BLOCKS**0.5)
            if abs(factor - 1.0) < MOST_OFF_FACTOR and factor / std > best:
                off = _off_beat(made, t_s[half:-half], gain, power, late_s)
                best, found = factor / std, dataclasses.replace(made, doubtful=off > MOST_OFF_BEAT)
    return found


def _off_beat(made: Conversion, t_s: Float, gain: Float, power: Float, late_s: Float) -> float:
    """Power of the lateness in each phase of the beat that isn't the predicted one, over that."""
    phase = (BEAT_PHASES * (made.source_frames(t_s) % 1.0)).astype(int)
    weight, seen, predicted = (np.bincount(phase, of) for of in (gain, power, gain * late_s))
    held = weight > 0.0
    off = (seen[held] - predicted[held]) ** 2 / weight[held] - 1.0  # noise has 1
    return float(off.sum() / np.sum(predicted[held] ** 2 / weight[held]))


def _course(values: Float, half: int) -> tuple[Float, Float]:
    """Residual of values from their smooth course, and its slope per frame; without the ends.

    Savitzky-Golay filter: a parabola through ``half`` frames on either side (Savitzky, A. and
    Golay, M. J. E. (1964), Anal. Chem. 36, 1627).
    """
    place = np.arange(-half, half + 1)
    level, slope, _ = np.linalg.pinv(np.vander(place, 3, increasing=True))
    around = sliding_window_view(values, place.size, axis=0)
    return values[half:-half] - around @ level, np.asarray(around @ slope)


class SeamWatch:
    """Holds seconds back until their frame rate isn't in doubt; else returns them as unusable."""

    def __init__(self) -> None:
        self._waiting: deque[FlickerSecond] = deque()
        self._whole = 0  # consecutive frames without a slip
        self._is_detectable = False  # whether a slip would be detected
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
            if not self._is_detectable or self._log_odds > wait:
                out += self.flush()
            elif second.index - self._waiting[0].index >= HOLD_S:
                out.append(self._judged(self._waiting.popleft()))
        return out

    def flush(self) -> list[FlickerSecond]:
        """Return the seconds held back."""
        out = [self._judged(second) for second in self._waiting]
        self._waiting.clear()
        return out

    @property
    def is_doubtful(self) -> bool:
        """Whether the frame rate is in doubt, from all seconds so far."""
        return self._log_odds < (SURE_LOG_ODDS if self._is_slipped else LEAST_LOG_ODDS)

    def _judged(self, second: FlickerSecond) -> FlickerSecond:
        if not (second.usable and self.is_doubtful):
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
        self._is_detectable = _tells_slips(second)
        if second.doubled is not None and other < 1.0:
            slips += second.doubled  # none where every other frame of twice the rate is shown
        self._slips += slips
        if second.doubled and other > 1.0:  # a repeated picture isn't a lost frame
            self._slips = [s for s in self._slips if min(abs(s - d) for d in second.doubled) > 1]
        after = int((second.frame_number >= max(slips, default=-1)).sum())
        self._whole = (after if slips else self._whole + after) if self._is_detectable else 0
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

"""The idle stage: row blocks in; an estimate every few seconds, and a last one at the end, out."""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np

from rsenf.flicker.conversions import NTSC, SEAMS
from rsenf.flicker.follower import Follower
from rsenf.flicker.frame_rate import (
    DOUBTFUL,
    GIVE_RATE,
    IS_IT_WRONG,
    UNTIMED,
    FrameRateFinder,
    PerFrame,
    likely,
)
from rsenf.flicker.frame_slips import slip_words
from rsenf.flicker.lines import alias_hz
from rsenf.flicker.slow_time import FrameCounter
from rsenf.idle.estimator_state import STILL_HZ, EstimatorState, Finding, IdleSettings
from rsenf.idle.moments import Segments, StillRows
from rsenf.idle.pairing import Pairing, PhasedRows
from rsenf.idle.refusals import (
    CROP,
    JITTERS,
    NO_FLICKER,
    NO_ROWS,
    REMADE,
    SAWTOOTH,
    TOO_SHORT,
    Sawtooth,
    are_alike,
    checked,
    look_alike,
    woven_fields,
)
from rsenf.messages import IdleEstimate, RateBasis, RowBlock
from rsenf.timebase import NS_PER_S

MIN_ROWS = 16
# In a long stream little is new to the next estimate: it waits until the stream has grown by this
# share, or for this long.
GROWN, LONGEST_S = 0.125, 20.0
# If the aliases of all possible grids are farther from 0 Hz, no rows are kept. More than STILL_HZ,
# since the frame rate may change a little.
MAY_STAND_HZ = 3.0
# Standard error of the idle ratio without the codec's loop filter. Set by coded films of a first
# round, with errors of 0.0002 to 0.002; in 10 of another (seeds 530 to 541), without a part in it,
# the largest error was 1.7 stated ones.
UNFILTERED_RATIO = 1e-3


class IdleStage:
    """Accumulates a stream and applies a method to it. Implements ``rsenf.stage.Stage``.

    Parameters
    ----------
    settings : IdleSettings
    conclude : callable
        The method: from an :class:`EstimatorState` to a :class:`Finding`.
    follower : Follower, optional
        Flicker follower shared with another stage; by default its own.
    """

    def __init__(
        self,
        settings: IdleSettings,
        conclude: Callable[[EstimatorState], Finding],
        follower: Follower | None = None,
    ) -> None:
        self._settings, self._conclude = settings, conclude
        given = settings.nominal_hz
        self._tried_hz = (given,) if given else (50.0, 60.0)
        self._pairing = Pairing(given, follower)
        self._sawtooth = Sawtooth()
        self._segments: Segments | None = None
        self._still_rows = StillRows(0.0)
        self._unusable: Counter[str] = Counter()
        self._unfiltered = False  # whether any was decoded without the codec's loop filter
        self._first: RowBlock | None = None
        self._clock = FrameCounter()
        self._rows, self._strips, self._frames = 0, 0, 0
        self._newest: RowBlock | None = None
        self._published, self._due = 0, 1
        self._rates: FrameRateFinder | None = FrameRateFinder(given)

    def update(self, message: RowBlock) -> list[Any]:
        """Take a block of rows; return the estimate that is due, if any."""
        if self._first is None and message.frames:
            self._first, self._rows, self._strips = message, message.rows, message.strips
            self._segments = Segments(message.rows)
        if message.frames == 0 or message.rows != self._rows:
            self._pairing.show(message)
            return []
        self._look(message)
        self._take(self._pairing.update(message))
        span_s, every_s = self._clock.span_s, self._settings.every_s
        if span_s < self._due * every_s:
            return []
        wait_s = min(GROWN * span_s, LONGEST_S)
        self._due = int(span_s / every_s) + max(int(wait_s / every_s), 1)
        return [self._publish()]

    def flush(self) -> list[Any]:
        """Return the last estimate, from all of the stream."""
        self._take(self._pairing.flush())
        return [self._publish()] if self._newest is not None else []

    def _look(self, block: RowBlock) -> None:
        """Use a block for all that needs no phase."""
        assert self._first is not None
        self._newest = block
        self._clock.add(block)
        self._frames += block.frames
        self._unfiltered |= bool(block.effort)
        if self._pairing.usable and not self._is_assumed:
            self._rates = None  # the rate is right, or near it
        if self._rates is not None:
            self._rates.add(block)
        if not block.usable:
            self._unusable[block.reason] += block.frames
            return
        self._bin(block)
        self._sawtooth.add(block.level.mean(axis=(1, 2), dtype=np.float64))

    def _bin(self, block: RowBlock) -> None:
        """Average rows over time, unless the alias is known not to be at 0 Hz."""
        assert self._first is not None
        if not self._may_stand_still():
            self._still_rows = StillRows(self._clock.span_s)
        elif block.strips == self._strips:
            t_s = (block.frame_pts_ns - self._first.frame_pts_ns[0]) / NS_PER_S
            self._still_rows.add(t_s, block.level, self._clock.span_s)

    def _may_stand_still(self) -> bool:
        """Whether the alias may be at 0 Hz; True until the follower's first seconds."""
        if not self._pairing.seconds:
            return True
        known, rate_hz = self._pairing.nominal_hz, self._rate_hz
        nominals_hz = (known,) if np.isfinite(known) else self._tried_hz
        return any(abs(alias_hz(2.0 * hz, rate_hz)) < MAY_STAND_HZ for hz in nominals_hz)

    @property
    def _camera_hz(self) -> float | None:
        """Original frame rate, if the stream was converted."""
        known = self._pairing.camera_hz
        return known if np.isfinite(known) else None

    @property
    def _rate_hz(self) -> float:
        """Frame rate of the camera."""
        return self._camera_hz or self._pairing.clock_hz or self._clock.frame_rate_hz

    def _take(self, phased: list[PhasedRows]) -> None:
        """Add the frames whose phase is known now."""
        if phased:
            assert self._segments is not None
            phase_rad = np.concatenate([rows.phase_rad for rows in phased])
            self._segments.add(phase_rad, np.concatenate([rows.level for rows in phased]))

    def _finding(self, rate_hz: float) -> Finding:
        """Refusals that all methods share, or else the method's finding."""
        assert self._segments is not None
        if self._rows < MIN_ROWS:
            return NO_ROWS
        if self._sawtooth.found:
            return SAWTOOTH
        for remade in REMADE:
            if remade.reason in self._pairing.reasons:
                return remade
        seen = EstimatorState(
            moments=self._segments.whole,
            segments=self._segments.each,
            still_rows=self._still_rows,
            nominal_hz=self._nominal_hz(rate_hz),
            f0_hz=self._pairing.f0_hz,
            frame_rate_hz=rate_hz,
            apart_turns=self._pairing.apart_turns,
            unfiltered=self._unfiltered,
        )
        # If nothing was tracked, an alias at 0 Hz is only assumed until the rows show flicker.
        is_still = seen.stands_still and (
            np.isfinite(self._pairing.nominal_hz) or self._still_rows.show_flicker
        )
        if not (seen.followed or is_still):
            return Finding(verdict="no_signal", reason=self._why_nothing(seen))
        if woven := woven_fields(seen):
            return woven
        finding = self._conclude(seen)
        is_mirrored = np.isfinite(seen.mirror_hz) and not seen.stands_still
        if finding.verdict == "estimated" and is_mirrored:
            finding = finding.undirected(seen.mirror_hz)
        finding = checked(seen, finding)
        if finding.verdict == "estimated" and self._pairing.seams.is_doubtful:
            var = finding.turns_var + (abs(NTSC - 1.0) * finding.turns) ** 2
            finding = dataclasses.replace(
                finding, turns_var=var, warnings=(*finding.warnings, SEAMS)
            )
        if finding.verdict == "estimated" and self._unfiltered:
            std_turns = UNFILTERED_RATIO * 2.0 * seen.nominal_hz / rate_hz
            finding = dataclasses.replace(finding, turns_var=finding.turns_var + std_turns**2)
        claims = finding.verdict in ("estimated", "ambiguous")
        if claims and self._settings.nominal_hz is None and are_alike(rate_hz):
            return look_alike(rate_hz)
        return finding

    @property
    def _is_assumed(self) -> bool:
        """Whether the frame rate is only assumed."""
        return self._first is not None and self._first.header.rate_basis == RateBasis.ASSUMED

    def _timed(self, finding: Finding) -> tuple[Finding, PerFrame | None]:
        """Return a finding without what depends on unknown frame times, and what doesn't."""
        is_assumed = self._is_assumed
        if self._rates is None or not (is_assumed or finding.reason in DOUBTFUL):
            return finding, None
        found = self._rates.found()
        text = f"{found.words}: {likely(found.hypotheses)}" if found else ""
        if is_assumed and (found or finding.verdict in ("estimated", "ambiguous")):
            reason = "; ".join(filter(None, [UNTIMED, text, GIVE_RATE]))
            return Finding(verdict="ambiguous", reason=reason), found
        if not found:
            return finding, None
        warnings = (*finding.warnings, f"{IS_IT_WRONG} {text}")
        return dataclasses.replace(finding, warnings=warnings), found

    def _nominal_hz(self, rate_hz: float) -> float:
        """Nominal grid frequency: the tracked one, or one whose alias is at 0 Hz.

        The second only once the follower has found nothing that moves: in the bins, flicker of the
        other grid leaves what looks like slow flicker. What it tracked but doubts moves, too.
        """
        pairing = self._pairing
        if np.isfinite(pairing.nominal_hz) or not pairing.seconds:
            return pairing.nominal_hz
        for hz, seconds in pairing.doubted_hz.most_common(1):
            if 2 * seconds > pairing.seconds:
                return hz
        still = [hz for hz in self._tried_hz if abs(alias_hz(2.0 * hz, rate_hz)) < STILL_HZ]
        return still[0] if still else float("nan")

    def _why_nothing(self, seen: EstimatorState) -> str:
        """Most frequent reason why no frame could be used."""
        mostly_unusable = 2 * self._unusable.total() > self._frames
        reasons = self._unusable if mostly_unusable else self._pairing.reasons
        is_unknown = set(reasons) <= {NO_FLICKER.reason}
        if seen.stands_still and is_unknown and not (mostly_unusable or self._still_rows.enough):
            return TOO_SHORT.reason
        return reasons.most_common(1)[0][0] if reasons else TOO_SHORT.reason

    def _publish(self) -> IdleEstimate:
        assert self._first is not None
        assert self._newest is not None
        rate_hz, slips = self._rate_hz, self._pairing.slips
        finding, per_frame = self._timed(self._finding(rate_hz))
        first, last = self._first.header, self._newest.header
        header = dataclasses.replace(
            last,
            seq=self._published,
            frame_first=first.frame_first,
            pts_ns=first.pts_ns,
            camera_time_ns=first.camera_time_ns,
        )
        self._published += 1
        claims = finding.verdict == "estimated"
        known_hz = math.nan if self._is_assumed else self._pairing.nominal_hz
        blank = IdleEstimate(
            header=header,
            method=self._settings.method,
            verdict=finding.verdict,
            reason=finding.reason,
            direction=finding.direction,
            frame_rate_hz=rate_hz,
            nominal_hz=self._nominal_hz(rate_hz) if claims else known_hz,
            rate_hypotheses=per_frame.hypotheses if per_frame else (),
            warnings=(
                *finding.warnings,
                *slip_words(slips, self._camera_hz),
                *(
                    (JITTERS.format(1e3 * jitter_s),)
                    if (jitter_s := self._pairing.jitter_s)
                    else ()
                ),
                *((CROP,) if claims else ()),
            ),
            converted=self._camera_hz is not None,
            slips=len(slips),
        )
        return _with_numbers(blank, finding) if claims else blank


def _with_numbers(blank: IdleEstimate, finding: Finding) -> IdleEstimate:
    """Fill in the numbers: ``T_ro = |q|/f_0`` and ``ρ = 1 − T_ro·F_r``."""
    idle = 1.0 - finding.read_out_s * blank.frame_rate_hz
    std = finding.read_out_std_s * blank.frame_rate_hz
    half = finding.interval_stds * std
    low, high = np.clip([idle - half, idle + half], 0.0, 1.0)
    return dataclasses.replace(
        blank,
        idle_ratio=max(idle, 0.0),
        idle_ratio_var=std**2,
        idle_ratio_low=float(low),
        idle_ratio_high=float(high),
        read_out_time_s=finding.read_out_s,
        read_out_time_var_s2=finding.read_out_std_s**2,
    )

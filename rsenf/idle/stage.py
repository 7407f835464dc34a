"""The idle stage: row blocks in, an estimate every few seconds of stream, a last one at its end."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np

from rsenf.idle.limits import CROP, checked
from rsenf.idle.moments import Moments
from rsenf.idle.pairing import Pairing, PhasedBlock
from rsenf.idle.sawtooth import Sawtooth
from rsenf.idle.seen import Finding, Seen
from rsenf.idle.settings import IdleSettings
from rsenf.messages import Header, IdleEstimate, RowBlock
from rsenf.timebase import NS_PER_S

MIN_ROWS = 16
MIN_FRAMES = 100
# Half-width of the 95 % interval in standard errors: Student's t for a dozen bands of rows.
INTERVAL_STDS = 2.2
# Two grids whose light shows alike from frame to frame, within so many Hz.
ALIKE_HZ = 1.0


class IdleStage:
    """Accumulates a stream and has a method conclude from it. Implements ``rsenf.stage.Stage``.

    Parameters
    ----------
    settings : IdleSettings
    conclude : callable
        The method: from what has been seen to what is found.
    """

    def __init__(self, settings: IdleSettings, conclude: Callable[[Seen], Finding]) -> None:
        self._settings, self._conclude = settings, conclude
        self._pairing = Pairing(settings.nominal_hz)
        self._sawtooth = Sawtooth()
        self._moments: Moments | None = None
        self._header: Header | None = None
        self._first: RowBlock | None = None
        self._number, self._pts_ns = -1, 0
        self._unusable: dict[str, int] = {}
        self._frames = 0
        self._published = 0
        self._due = 1

    def update(self, message: RowBlock) -> list[Any]:
        """Take a block of rows; return the estimate that is due, if any."""
        if message.frames == 0:
            return []
        if self._first is None:
            self._first = message
        if message.rows != self._first.rows:
            return []
        for phased in self._pairing.update(message):
            self._take(phased)
        span_s = (self._pts_ns - int(self._first.frame_pts_ns[0])) / NS_PER_S
        if self._header is None or span_s < self._due * self._settings.every_s:
            return []
        self._due = int(span_s / self._settings.every_s) + 1
        return [self._publish()]

    def flush(self) -> list[Any]:
        """Return the last estimate, from all of the stream."""
        for phased in self._pairing.flush():
            self._take(phased)
        return [self._publish()] if self._header is not None else []

    def _take(self, phased: PhasedBlock) -> None:
        block = phased.block
        self._header = block.header
        self._number, self._pts_ns = int(block.frame_number[-1]), int(block.frame_pts_ns[-1])
        self._frames += block.frames
        if not block.usable:
            self._unusable[block.reason] = self._unusable.get(block.reason, 0) + block.frames
            return
        level = block.level.mean(axis=2, dtype=np.float64)
        self._sawtooth.add(level.mean(axis=1))
        known = np.isfinite(phased.phase_rad)
        if block.rows >= MIN_ROWS and known.any():
            if self._moments is None:
                self._moments = Moments(block.rows)
            self._moments.add(phased.phase_rad[known], level[known])

    def _frame_rate_hz(self) -> float:
        assert self._first is not None
        frames = self._number - int(self._first.frame_number[0])
        span_ns = self._pts_ns - int(self._first.frame_pts_ns[0])
        return frames * NS_PER_S / span_ns if span_ns > 0 else float("nan")

    def _finding(self, rate_hz: float) -> Finding:
        """What can be said before any method has a say, or the method's word."""
        assert self._first is not None
        if self._first.rows < MIN_ROWS:
            return Finding(
                verdict="refused", reason="one mean for the whole frame: the rows are needed"
            )
        if self._sawtooth.found:
            return Finding(
                verdict="refused",
                reason="the brightness ramps and is reset at key frames: weighted prediction of "
                "the encoder, not light",
            )
        nominal_hz = self._pairing.nominal_hz
        if self._moments is None or self._moments.frames < MIN_FRAMES:
            return Finding(verdict="no_signal", reason=self._why_nothing())
        if self._settings.nominal_hz is None and _alike(rate_hz):
            return Finding(
                verdict="ambiguous",
                reason=f"at {rate_hz:.4g} frames/s light on 50 and on 60 Hz looks alike: give the "
                "nominal frequency",
            )
        seen = Seen(
            moments=self._moments,
            nominal_hz=nominal_hz,
            f0_hz=self._pairing.f0_hz,
            frame_rate_hz=rate_hz,
        )
        return checked(seen, self._conclude(seen))

    def _why_nothing(self) -> str:
        """Most frequent reason why no frame could be used."""
        reasons = dict(self._pairing.reasons)
        if sum(self._unusable.values()) > self._frames / 2:
            reasons = self._unusable
        if not reasons:
            return "too short to tell"
        return max(reasons, key=lambda r: reasons[r])

    def _publish(self) -> IdleEstimate:
        assert self._header is not None
        assert self._first is not None
        rate_hz = self._frame_rate_hz()
        finding = self._finding(rate_hz)
        first = self._first.header
        header = dataclasses.replace(
            self._header,
            seq=self._published,
            frame_first=int(self._first.frame_number[0]),
            frame_last=self._number,
            pts_ns=first.pts_ns,
            camera_time_ns=first.camera_time_ns,
        )
        self._published += 1
        blank = IdleEstimate(
            header=header,
            method=self._settings.method,
            verdict=finding.verdict,
            reason=finding.reason,
            direction=finding.direction,
            frame_rate_hz=rate_hz,
            nominal_hz=self._pairing.nominal_hz,
            warnings=finding.warnings,
        )
        if finding.verdict != "estimated":
            return blank
        return _claim(blank, finding, self._pairing.f0_hz)


def _claim(blank: IdleEstimate, finding: Finding, f0_hz: float) -> IdleEstimate:
    """Put the numbers in: ``T_ro = |q|/f_0`` and ``ρ = 1 − T_ro·F_r``."""
    read_out_s, std_s = abs(finding.turns) / f0_hz, finding.turns_std / f0_hz
    idle, std = 1.0 - read_out_s * blank.frame_rate_hz, std_s * blank.frame_rate_hz
    low, high = np.clip([idle - INTERVAL_STDS * std, idle + INTERVAL_STDS * std], 0.0, 1.0)
    return dataclasses.replace(
        blank,
        idle_ratio=max(idle, 0.0),
        idle_ratio_var=std**2,
        idle_ratio_low=float(low),
        idle_ratio_high=float(high),
        read_out_time_s=read_out_s,
        read_out_time_var_s2=std_s**2,
        warnings=(*finding.warnings, CROP),
    )


def _alike(frame_rate_hz: float) -> bool:
    """Whether 100 and 120 Hz have the same alias, or mirror images of each other."""
    a, b = (hz % frame_rate_hz for hz in (100.0, 120.0))
    gaps = np.array([a - b, a + b])
    gaps = np.abs((gaps + frame_rate_hz / 2) % frame_rate_hz - frame_rate_hz / 2)
    return bool(np.min(gaps) < ALIKE_HZ)

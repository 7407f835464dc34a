"""The idle tables: the two strongest lines and their ratio, against the idle period."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from dataclasses import dataclass

from rsenf.model.analytic import COSINE, ROWS, SpectralLine, lines
from rsenf.model.analytic_strongest import PRINTED_TIE, strongest
from rsenf.model.published import Entry

IDLE_PERCENTS = range(0, 100, 5)


@dataclass(frozen=True)
class Reading:
    """How the line model is read: by default as it is, otherwise as the paper did."""

    whole_capacity: bool = False  # M = round(L/(1 − ρ)), which changes ρ a little
    folded: bool = True  # lines below 0 Hz count, at their absolute value
    harmonics: tuple[float, ...] = COSINE
    rows: int = ROWS

    def lines(
        self, frame_rate_hz: float, nominal_hz: float, idle_ratio: float
    ) -> tuple[SpectralLine, ...]:
        """List the lines of a capture, up to a little beyond twice the light's top harmonic."""
        if self.whole_capacity:
            idle_ratio = 1 - self.rows / round(self.rows / (1 - idle_ratio))
        f0_hz = 2 * nominal_hz
        return lines(
            frame_rate_hz,
            f0_hz,
            idle_ratio,
            rows=self.rows,
            harmonics=self.harmonics,
            folded=self.folded,
            top_hz=2 * f0_hz * len(self.harmonics) + frame_rate_hz,
        )


AS_PUBLISHED = Reading(whole_capacity=True, folded=False)


def idle_table(
    frame_rate_hz: float,
    nominal_hz: float,
    reading: Reading,
    idle_percents: Iterable[int] = IDLE_PERCENTS,
) -> tuple[Entry, ...]:
    """Tabulate the two strongest lines, unrounded; only equal amplitudes tie."""
    return tuple(
        _entry(idle, reading.lines(frame_rate_hz, nominal_hz, idle / 100)) for idle in idle_percents
    )


def printed_table(
    frame_rate_hz: float,
    nominal_hz: float,
    reading: Reading,
    idle_percents: Iterable[int] = IDLE_PERCENTS,
) -> tuple[Entry, ...]:
    """Tabulate as the paper prints: whole hertz, one decimal, ties where that shows 1.0."""
    return tuple(
        _as_printed(_entry(idle, reading.lines(frame_rate_hz, nominal_hz, idle / 100), PRINTED_TIE))
        for idle in idle_percents
    )


def _entry(idle_percent: int, found: tuple[SpectralLine, ...], *tie_ratio: float) -> Entry:
    top = strongest(found, *tie_ratio)
    return Entry(
        idle_percent,
        tuple(line.freq_hz for line in top.first),
        tuple(line.freq_hz for line in top.second),
        top.amplitude_ratio,
        top.ratio_range,
    )


def _as_printed(entry: Entry) -> Entry:
    ratio = entry.amplitude_ratio
    return dataclasses.replace(
        entry,
        h1_hz=tuple(round(hz) for hz in entry.h1_hz),
        h2_hz=tuple(round(hz) for hz in entry.h2_hz),
        amplitude_ratio=None if ratio is None else round(ratio, 1),
        ratio_range=None,
    )

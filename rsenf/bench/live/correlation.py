"""The literature's rule: an alarm where camera and reference correlate too little.

Pearson's correlation of the camera's ENF and the grid's over a sliding window of 30 values, one a
second, with an alarm below 0.8: the rule of ENF-based replay detection for surveillance feeds
(Nagothu, Chen, Blasch and others). It is given what the live stage is: the same estimates, the
same reference, paired by the clock of the host.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from rsenf.messages import EnfEstimate, ReferenceBlock, RowBlock
from rsenf.messages.schema import FloatArray

WINDOW = 30
LIMIT = 0.8


def sliding_correlation(
    messages: Iterable[Any], window: int = WINDOW
) -> Iterator[tuple[int, float]]:
    """Yield the correlation of each full window, with the host's clock when it could be had.

    Seconds without a usable estimate are passed over, so that a feed without a signal is never
    judged. An estimate waits for the reference to cover it.

    Parameters
    ----------
    messages : iterable
        Row blocks, which pair the stream's clock with the host's; estimates; and the reference.
    window : int, optional
        Values.

    Yields
    ------
    arrival_time_ns : int
    correlation : float
        NaN of a window in which either stands still.
    """
    series = _Reference()
    waiting: deque[tuple[int, float]] = deque()
    pairs: deque[tuple[float, float]] = deque(maxlen=window)
    host_less_stream_ns: int | None = None
    for message in messages:
        if isinstance(message, RowBlock) and host_less_stream_ns is None:
            last_ns = int(message.frame_pts_ns[-1])
            host_less_stream_ns = message.header.arrival_time_ns - last_ns
        elif isinstance(message, EnfEstimate) and host_less_stream_ns is not None:
            middle_ns = (message.start_pts_ns + message.end_pts_ns) // 2
            value = message.enf_hz if message.usable else math.nan
            waiting.append((middle_ns + host_less_stream_ns, value))
        elif isinstance(message, ReferenceBlock):
            series.add(message)
        while waiting and waiting[0][0] <= series.end_ns:
            at_ns, enf_hz = waiting.popleft()
            reference_hz = series.at(at_ns)
            if math.isnan(enf_hz) or math.isnan(reference_hz):
                continue
            pairs.append((enf_hz, reference_hz))
            if len(pairs) == window:
                yield message.header.arrival_time_ns, correlation(np.array(pairs))


def correlation(pairs: FloatArray) -> float:
    """Pearson's correlation of pairs (values, 2); NaN where either side is constant."""
    away = pairs - pairs.mean(axis=0)
    power = (away**2).sum(axis=0)
    product = float(power[0] * power[1])
    return float((away[:, 0] * away[:, 1]).sum() / math.sqrt(product)) if product > 0 else math.nan


class _Reference:
    """What came of a reference so far; between the middles of its samples it is a line."""

    def __init__(self) -> None:
        self._begin_ns = 0
        self._step_ns = 1
        self._freq_hz: list[float] = []

    @property
    def end_ns(self) -> int:
        """Middle of the newest sample; nothing is before it while there is none."""
        return self._begin_ns + len(self._freq_hz) * self._step_ns - self._step_ns // 2

    def add(self, block: ReferenceBlock) -> None:
        """Take the next samples."""
        if not self._freq_hz:
            self._step_ns = block.step_ns
            self._begin_ns = block.t0_ns + block.first * block.step_ns
        self._freq_hz.extend(block.freq_hz.tolist())

    def at(self, t_ns: int) -> float:
        """Frequency at a time that it covers; NaN beside a gap, or before it begins."""
        steps = (t_ns - self._begin_ns) / self._step_ns - 0.5
        k = math.floor(steps)
        if not 0 <= k < len(self._freq_hz):
            return math.nan
        after = self._freq_hz[min(k + 1, len(self._freq_hz) - 1)]
        return self._freq_hz[k] + (steps - k) * (after - self._freq_hz[k])

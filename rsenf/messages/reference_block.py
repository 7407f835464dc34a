"""A block of measured grid frequency, uniformly sampled; gaps stay NaN."""

from __future__ import annotations

from dataclasses import dataclass

from rsenf.messages.header import Header
from rsenf.messages.schema import FloatArray, UInt32Array, field, message


@message(12, version=1)
@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class ReferenceBlock:
    """Consecutive samples of a grid's frequency.

    Sample ``k`` of the reference covers ``[t0 + k·step, t0 + (k+1)·step)``.
    """

    header: Header = field(1, "", None)
    grid: str = field(2, "name of the grid", "")
    nominal_hz: float = field(3, "50 or 60", float("nan"))
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

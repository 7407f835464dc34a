"""Compares a clip's ENF with a reference of the grid's frequency, which reveals the camera's clock.

In: ENF estimates of a clip (of rows, or of frame means), a capture model, and a reference. Out: a
:class:`ClockOffsetDiscovery`: the lag, the clock error if supported, and what remains. The steps
are those for rows: fit to training blocks, judge on held-out blocks, add, repeat. Read in order::

    clip       the clip's estimates and a simulated prediction, on the reference's time axis
    start      where in the reference the clip is; whether the reference is an average
    noise      distribution of their difference if the model is true
    fit        least-squares lag and clock error; possible causes of a difference, tested
    result     the workflow, its result as plain values, and joined with the result on rows
"""

from rsenf.discrepancy.clock_offset.clip import (
    AlignedReference,
    EnfClip,
    clip_of,
    clip_of_frame_means,
    holds_frame_means,
)
from rsenf.discrepancy.clock_offset.fit import LagFit
from rsenf.discrepancy.clock_offset.result import (
    ClockOffsetDiscovery,
    beside_json,
    beside_model,
    discover_beside,
    joined,
    where_beside,
)
from rsenf.discrepancy.clock_offset.start import beside_of

__all__ = [
    "AlignedReference",
    "ClockOffsetDiscovery",
    "EnfClip",
    "LagFit",
    "beside_json",
    "beside_model",
    "beside_of",
    "clip_of",
    "clip_of_frame_means",
    "discover_beside",
    "holds_frame_means",
    "joined",
    "where_beside",
]

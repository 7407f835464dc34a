"""What a reference of the grid's frequency tells beyond the rows: the camera's clock.

On the ENF of a clip, of rows or of one mean a frame; one idea a file, in the order of the work::

    clip               its estimates, and how what a model says is filmed and tracked alike
    start              where in the reference it is, and how the reference is to be read
    aligned_reference  what was measured beside what a model filmed on the reference says
    noise              what the two would differ by, were the model true
    hypotheses         what may set them apart, weighed on held-out blocks
    fit                the lag and the clock, fitted by films
    verdict            all of it on one recording
    result             as plain values, and joined to what the rows told
"""

from rsenf.discrepancy.clock_offset.aligned_reference import AlignedReference
from rsenf.discrepancy.clock_offset.clip import (
    Clip,
    clip_of,
    clip_of_frame_means,
    holds_frame_means,
)
from rsenf.discrepancy.clock_offset.fit import LagFit, clock_ppm
from rsenf.discrepancy.clock_offset.result import beside_json, beside_model, joined, where_beside
from rsenf.discrepancy.clock_offset.start import beside_of
from rsenf.discrepancy.clock_offset.verdict import ClockOffsetDiscovery, discover_beside

__all__ = [
    "AlignedReference",
    "ClockOffsetDiscovery",
    "Clip",
    "LagFit",
    "beside_json",
    "beside_model",
    "beside_of",
    "clip_of",
    "clip_of_frame_means",
    "clock_ppm",
    "discover_beside",
    "holds_frame_means",
    "joined",
    "where_beside",
]

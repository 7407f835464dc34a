"""Where a model of a capture and the data disagree, what is missing, and how much it explains.

One idea a file, in the order of the work::

    measured     row means in blocks of time: some to fit to, the others to score on
    theory       a capture model and a course of the light's phase, simulated at will
    knobs        what can be turned on a model
    linear       the small linear problem of one step
    series       effects that have a value of their own for each frame or line
    fit          Gauss-Newton steps, every derivative made by the capture model
    start        where the first fit begins
    gap          the systematic part of what is left, and its error
    where        the gap taken apart: by time, row, level, strip, step and frequency
    residue      what is left, summed up for effects to guess from
    candidates   which effects might explain it
    search       what held-out data support
    floor        how small a gap can be
    verdict      all of it on one recording

Beside a reference of the grid's frequency, on estimates of whatever source::

    grid_start   where in the reference the clip is, and how the reference is to be read
    grid_series  what was measured, and what a model filmed on the reference says of it
    grid_noise   what the two would differ by, were the model true
    grid_effects what may set them apart, weighed on held-out blocks
    grid_fit     the lag and the clock, fitted by films
    grid         all of it on one recording
    grid_result  as plain values, and joined to what the rows told
"""

from rsenf.discrepancy.grid import GridDiscovery, discover_grid
from rsenf.discrepancy.grid_result import grid_json, grid_model, joined
from rsenf.discrepancy.grid_series import Film
from rsenf.discrepancy.grid_start import beside_of
from rsenf.discrepancy.measured import Measured, measured_of
from rsenf.discrepancy.verdict import Discovery, discover, discovery_json, model_of

__all__ = [
    "Discovery",
    "Film",
    "GridDiscovery",
    "Measured",
    "beside_of",
    "discover",
    "discover_grid",
    "discovery_json",
    "grid_json",
    "grid_model",
    "joined",
    "measured_of",
    "model_of",
]

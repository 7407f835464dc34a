"""Plausibility checks of received messages: rejects values that stages couldn't handle.

Any process on the bus may send anything to any key. Messages are checked once, on receipt, so that
stages needn't.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rsenf.messages.estimates import EnfEstimate, ReferenceBlock
from rsenf.messages.header import Header, Mark
from rsenf.messages.schema import field_specs
from rsenf.messages.video import RowBlock

_MARKS = tuple(Mark)
# Sums of numbers and differences of times below these limits can't overflow 64 bits.
MOST_COUNTED = 2**48
MOST_NS = 2**62  # 146 years
MOST_ROWS, MOST_STRIPS, MOST_FRAMES = 1 << 15, 1 << 12, 1 << 16
MOST_HZ = 1e6
LEAST_STEP_NS = 10**6
MOST_SAMPLES = 1 << 27  # of a reference, which is kept in memory: four years of seconds
MOST_LEVEL = 1e6
# Stages process each second and count each missing frame: a larger step within an epoch would keep
# them busy for ever.
MOST_LEAP_NS, MOST_LEAP_FRAMES = 86_400 * 10**9, 1 << 24


def implausible(message: Any) -> str:
    """Return why a message is implausible, in words; empty if it is plausible.

    Examples
    --------
    >>> from rsenf.messages import Health
    >>> implausible(Health(header=Header(seq=0))), implausible(Health(header=Header(seq=-1)))
    ('', "a number of a message that can't be")
    """
    header = getattr(message, "header", None)
    if header is None:
        return "no header"
    found = _of_header(header)
    if found or header.mark != Mark.DATA:
        return found
    return _missing_array(message) or _of_kind(message)


def out_of_place(header: Header, last: Header | None) -> str:
    """Return why a message can't follow the last one of its topic; empty if it can.

    Parameters
    ----------
    header : Header
        Of the message.
    last : Header or None
        Of the last message, with the newest frame so far; None for the first one.
    """
    if last is None or (header.run_id, header.epoch) != (last.run_id, last.epoch):
        return ""
    leap_ns = header.pts_ns - last.pts_ns
    if last.frame_last < 0 <= header.frame_last:
        leap_ns = 0  # the stream's clock is unknown before the first frame
    if abs(leap_ns) > MOST_LEAP_NS:
        return f"the stream's clock leaps by {leap_ns / 3.6e12:.0f} h within an epoch"
    if header.frame_last < 0:
        return ""  # a second without frames
    if header.frame_last < last.frame_last:
        return f"frame {header.frame_last} comes after {last.frame_last}"
    if header.frame_last - last.frame_last > MOST_LEAP_FRAMES:
        return f"frame {header.frame_last} comes after {last.frame_last}"
    return ""


def _of_header(header: Header) -> str:
    if not (0 <= header.seq < MOST_COUNTED and 0 <= header.epoch < MOST_COUNTED):
        return "a number of a message that can't be"
    if header.mark not in _MARKS:
        return f"no mark: {header.mark}"
    if not -1 <= header.frame_first <= max(header.frame_last, -1) < MOST_COUNTED:
        return "frames that can't be"
    if not (max(abs(header.pts_ns), abs(header.arrival_time_ns)) < MOST_NS):
        return "a time that can't be"
    return ""


def _missing_array(message: Any) -> str:
    """Return the name of an array that is empty in spite of its dimensions; or ''."""
    for spec in field_specs(type(message)):
        if spec.kind == "array" and spec.shape:
            expected = all(getattr(message, name) > 0 for name in spec.shape)
            if expected and not getattr(message, spec.name).size:
                return f"{spec.name} is missing"
    return ""


def _of_kind(message: Any) -> str:
    if isinstance(message, RowBlock):
        return _of_rows(message)
    if isinstance(message, EnfEstimate):
        return _of_estimate(message)
    if isinstance(message, ReferenceBlock):
        return _of_reference(message)
    return ""


def _of_rows(block: RowBlock) -> str:
    if block.read_out_axis not in ("rows", "columns", "frame"):
        return "no read-out axis"
    if not (block.rows <= MOST_ROWS and block.strips <= MOST_STRIPS):
        return "more rows than any sensor has"
    if block.frames == 0:
        return ""
    if not 0 < block.frames <= MOST_FRAMES or min(block.rows, block.strips) <= 0:
        return "a block of nothing"
    if np.any(np.diff(block.frame_number) < 1) or not _rising(block.frame_pts_ns):
        return "frames out of order"
    if not _within(block.frame_pts_ns, MOST_NS) or not _within(block.frame_number, MOST_COUNTED):
        return "a time that can't be"
    if block.frame_pts_ns[-1] - block.frame_pts_ns[0] > MOST_LEAP_NS:
        return "a block of days"
    numbers = (block.header.frame_first, block.header.frame_last, block.header.pts_ns)
    if numbers != (block.frame_number[0], block.frame_number[-1], block.frame_pts_ns[0]):
        return "other frames than the header says"
    if not _within(block.level, MOST_LEVEL):
        return "levels that aren't"
    return ""


def _of_estimate(estimate: EnfEstimate) -> str:
    times = (estimate.origin_pts_ns, estimate.start_pts_ns, estimate.end_pts_ns)
    if max(map(abs, times)) >= MOST_NS or not (
        0 <= estimate.end_pts_ns - estimate.start_pts_ns <= MOST_LEAP_NS
    ):
        return "a time that can't be"
    if not _rising(estimate.amplitude_pts_ns) or not _within(estimate.amplitude_pts_ns, MOST_NS):
        return "amplitudes out of order"
    if not 0 <= estimate.rank < MOST_COUNTED or not 1 <= estimate.harmonic < MOST_COUNTED:
        return "no rank or harmonic"
    if estimate.usable and not 0 < estimate.enf_hz < MOST_HZ:
        return "usable, without a frequency"
    if estimate.nominal_hz <= 0 or estimate.nominal_hz > MOST_HZ:  # NaN is unknown
        return "no nominal frequency"
    if estimate.usable and (estimate.enf_var_hz2 < 0 or estimate.enf_var_hz2 > MOST_HZ):
        return "usable, with no variance that could be"
    return ""


def _of_reference(block: ReferenceBlock) -> str:
    if block.samples == 0:
        return ""
    if not LEAST_STEP_NS <= block.step_ns <= MOST_LEAP_NS or not abs(block.t0_ns) < MOST_NS:
        return "a time that can't be"
    if min(block.first, block.total) < 0 or max(block.first, block.total) > MOST_SAMPLES:
        return "no place in a reference"
    if block.nominal_hz <= 0 or block.nominal_hz > MOST_HZ:  # NaN is unknown
        return "no nominal frequency"
    known = block.freq_hz[~np.isnan(block.freq_hz)]
    return "" if _within(known, MOST_HZ) else "frequencies that aren't"


def _rising(values: Any) -> bool:
    """Whether the values don't decrease."""
    return bool(np.all(values[1:] >= values[:-1]))


def _within(values: Any, most: float) -> bool:
    """Whether all absolute values are below a limit; avoids abs, which overflows for integers."""
    # False for NaN.
    return not values.size or bool(-most < values.min() and values.max() < most)

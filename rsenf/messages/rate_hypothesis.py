"""A frame rate that is consistent with the flicker, for rows without frame times."""

from __future__ import annotations

from dataclasses import dataclass

from rsenf.messages.schema import field, message

NAN = float("nan")


@message(2, version=1)
@dataclass(frozen=True, kw_only=True, slots=True)
class RateHypothesis:
    """A possible frame rate, and the camera's parameters at that rate."""

    frame_rate_hz: float = field(1, "with the grid at its nominal frequency", NAN)
    nominal_hz: float = field(2, "50 or 60", NAN)
    idle_ratio: float = field(3, "0 to 1", NAN)
    read_out_s: float = field(4, "time from the first row to the last and one more", NAN)
    direction: str = field(5, "of read-out, 'forward' or 'reverse'", "")
    is_common: bool = field(6, "whether cameras often have this rate", False)

"""An estimate of the idle ratio: the share of the frame period in which no row is read."""

from __future__ import annotations

import math
from dataclasses import dataclass

from rsenf.messages.header import Header
from rsenf.messages.rate_hypothesis import RateHypothesis
from rsenf.messages.schema import field, message

NAN = float("nan")


@message(7, version=1)
@dataclass(frozen=True, kw_only=True, slots=True)
class IdleEstimate:
    """Idle ratio of the camera from everything seen so far in the epoch."""

    header: Header = field(1, "", None)
    method: str = field(2, "name of the estimator", "")
    verdict: str = field(3, "'estimated', 'ambiguous', 'no_signal' or 'refused'", "no_signal")
    reason: str = field(4, "why nothing is claimed; empty when estimated", "")
    idle_ratio: float = field(5, "0 to 1; NaN for none", NAN)
    idle_ratio_var: float = field(6, "its variance", NAN)
    idle_ratio_low: float = field(7, "lower end of the 95 % interval", NAN)
    idle_ratio_high: float = field(8, "upper end of the 95 % interval", NAN)
    read_out_time_s: float = field(9, "time from the first row to the last and one more", NAN)
    read_out_time_var_s2: float = field(10, "its variance", NAN)
    direction: str = field(11, "'forward', 'reverse' or '' when not told apart", "")
    frame_rate_hz: float = field(12, "measured", NAN)
    nominal_hz: float = field(13, "50 or 60", NAN)
    warnings: tuple[str, ...] = field(14, "what a reader should know", ())
    converted: bool = field(
        15, "whether frames were dropped or doubled to give another rate than frame_rate_hz", False
    )
    slips: int = field(16, "places where frames are lost or shown again, the stamps silent", 0)
    rate_hypotheses: tuple[RateHypothesis, ...] = field(
        17, "frame rates that the light goes with, where the rate isn't known or seems wrong", ()
    )

    @property
    def idle_ratio_std(self) -> float:
        """Standard error of the idle ratio."""
        return math.sqrt(self.idle_ratio_var) if self.idle_ratio_var >= 0 else NAN

    @property
    def read_out_time_std_s(self) -> float:
        """Standard error of the read-out time."""
        return math.sqrt(self.read_out_time_var_s2) if self.read_out_time_var_s2 >= 0 else NAN

    @property
    def in_short(self) -> str:
        """Verdict on one line, for logs."""
        if self.verdict != "estimated":
            return f"{self.verdict}: {self.reason}"
        return f"idle {100 * self.idle_ratio:.3f} ± {100 * self.idle_ratio_std:.3f} %"

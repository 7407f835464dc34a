"""Results of monitoring and discovery: liveness, alarms, and named missing effects."""

from __future__ import annotations

from dataclasses import dataclass

from rsenf.messages.header import Header
from rsenf.messages.schema import FloatArray, field, message
from rsenf.timebase import seconds

NAN = float("nan")


@message(14, version=1)
@dataclass(frozen=True, kw_only=True, slots=True)
class Liveness:
    """Whether a feed follows the grid now."""

    header: Header = field(1, "", None)
    verdict: str = field(2, "'live', 'stale', 'frozen', 'no_signal' or 'undecided'", "undecided")
    since_ns: int = field(3, "host's clock when this verdict began", 0)
    lag_s: float = field(4, "age of the picture by its flicker", NAN)
    lag_std_s: float = field(5, "its standard error", NAN)
    clock_ppm: float = field(6, "camera's clock error; positive is fast", NAN)
    clock_std_ppm: float = field(7, "its standard error", NAN)
    log10_lr: float = field(8, "for live against not live", NAN)
    origin_utc_ns: int = field(9, "stale: when the picture was taken, if found; 0 is unknown", 0)
    evidence: str = field(10, "in words", "")

    @property
    def in_short(self) -> str:
        """Verdict on one line, for logs."""
        return f"{self.verdict}: {self.evidence}"


@message(15, version=1)
@dataclass(frozen=True, kw_only=True, slots=True)
class Alarm:
    """An event or state that a person should know of."""

    header: Header = field(1, "", None)
    kind: str = field(2, "'phase_jump', 'loop', 'idle_changed', 'light_changed', 'lost', …", "")
    severity: str = field(3, "'info', 'warning' or 'alarm'", "warning")
    active: bool = field(4, "False when it has ended", True)
    start_pts_ns: int = field(5, "stream clock where it began", 0)
    end_pts_ns: int = field(6, "stream clock where it ended; equal to the start for an instant", 0)
    value: float = field(7, "the quantity that tripped it", NAN)
    limit: float = field(8, "its limit", NAN)
    unit: str = field(9, "unit of value and limit", "")
    text: str = field(10, "one line for a person", "")

    @property
    def in_short(self) -> str:
        """Event and stream time on one line; each epoch's stream has a clock of its own."""
        what = f"{self.severity} {self.kind}" if self.active else f"{self.kind} ended"
        at_s = seconds(self.start_pts_ns if self.active else self.end_pts_ns)
        epoch = f" of epoch {self.header.epoch}" if self.header.epoch else ""
        return f"{what} at {at_s:.1f} s{epoch}: {self.text}"


@message(16, version=1)
@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class FoundEffect:
    """An effect that the data supports, or a class of indistinguishable effects."""

    name: str = field(1, "effect's name; empty when only the class is known", "")
    members: tuple[str, ...] = field(2, "the class, when the data can't tell them apart", ())
    parameter_names: tuple[str, ...] = field(3, "names with units", ())
    parameters: FloatArray = field(4, "their values, in the order of the names", wire="double")
    parameter_std: FloatArray = field(5, "their standard errors", wire="double")
    gap_before: float = field(6, "held-out gap without it", NAN)
    gap_after: float = field(7, "held-out gap with it", NAN)
    evidence: float = field(8, "held-out gain over its limit", NAN)


@message(17, version=1)
@dataclass(frozen=True, kw_only=True, slots=True)
class DiscoveryVerdict:
    """Where model and data of a window disagree, the effects found, and what has changed.

    The header holds the window's frames. The given model is the one found in the windows before;
    frame numbers and phases in effects and model refer to the window's first frame.
    """

    header: Header = field(1, "", None)
    verdict: str = field(
        2, "'no_discrepancy', 'explained', 'unexplained', or 'no_signal' for no rows to judge", ""
    )
    effects: tuple[FoundEffect, ...] = field(3, "those found so far, in order", ())
    gap_before: float = field(4, "held-out, with the model given", NAN)
    gap_after: float = field(5, "held-out, with the model found", NAN)
    gap_floor: float = field(6, "gap of data simulated from the model found", NAN)
    gap_stderr: float = field(7, "standard error of gap_after", NAN)
    unexplained_freq_hz: float = field(8, "where the rest is strongest; NaN for nothing", NAN)
    unexplained_ratio: float = field(9, "share of the gap that is left", NAN)
    unexplained_text: str = field(10, "what the rest looks like, and what would tell", "")
    model_yaml: str = field(11, "the model found, as a model file", "")
    gap_limit: float = field(12, "gaps below it are none", NAN)
    changed: tuple[str, ...] = field(13, "what isn't as in the window before, in words", ())
    reason: str = field(14, "why there is nothing to judge; empty when there is", "")
    frames_missing: int = field(15, "of the window, that never came or were of no use", 0)
    windows_skipped: int = field(16, "since the verdict before, for lack of time", 0)

    @property
    def in_short(self) -> str:
        """Verdict on one line, for logs."""
        if self.verdict == "no_signal":
            return f"{self.verdict}: {self.reason}"
        names = ", ".join(effect.name or " or ".join(effect.members) for effect in self.effects)
        known = f" ({names})" if names else ""
        said = f"{self.verdict}{known}, gap {self.gap_before:.1e} to {self.gap_after:.1e}"
        return "; ".join([said, *self.changed])

"""Results for a person: time of recording, edits, liveness, alarms, effects, nodes' state."""

from __future__ import annotations

from dataclasses import dataclass

from rsenf.messages.estimates import NAN
from rsenf.messages.header import Header
from rsenf.messages.schema import FloatArray, field, message
from rsenf.timebase import seconds, utc_text


@message(8, version=1)
@dataclass(frozen=True, kw_only=True, slots=True)
class Candidate:
    """One candidate lag; lists are sorted, best first."""

    lag_s: float = field(1, "video's first frame minus the reference's first sample", NAN)
    start_utc_ns: int = field(2, "the same as UTC since 1970; 0 is unknown", 0)
    correlation: float = field(3, "normalised cross-correlation, -1 to 1", NAN)
    clock_ppm: float = field(4, "camera's clock error; positive is fast", NAN)
    log10_lr: float = field(5, "against the best lag elsewhere in the reference", NAN)
    seconds_used: float = field(6, "usable seconds that the comparison rests on", 0.0)
    grid: str = field(7, "reference that the lag is in", "")


@message(9, version=1)
@dataclass(frozen=True, kw_only=True, slots=True)
class Segment:
    """A part of an edited clip that matches by itself."""

    from_s: float = field(1, "begin, from the clip's first frame", NAN)
    to_s: float = field(2, "end", NAN)
    grid: str = field(3, "reference that it fits", "")
    lag_s: float = field(4, "its begin minus the reference's first sample", NAN)
    lag_std_s: float = field(5, "its standard error", NAN)
    start_utc_ns: int = field(6, "when it begins, UTC since 1970; 0 is unknown", 0)
    log10_lr: float = field(7, "against none; near or with the other segments, where found so", NAN)


@message(10, version=1)
@dataclass(frozen=True, kw_only=True, slots=True)
class Edit:
    """An apparent edit of a clip, or of the reference, at one place."""

    kind: str = field(
        1,
        "'cut', 'repeated', 'inserted', 'replaced', 'rearranged', 'joined', 'jump', 'end', 'speed' "
        "or 'step' of the reference",
        "",
    )
    at_s: float = field(2, "where, from the clip's first frame", NAN)
    at_std_s: float = field(3, "its standard error", NAN)
    size_s: float = field(4, "seconds missing, shown again, put in, or that fit nothing", NAN)
    size_std_s: float = field(5, "its standard error", NAN)
    text: str = field(6, "in words", "")
    speed_ratio: float = field(7, "of the speed it is played at to the one it was filmed at", NAN)
    speed_ratio_std: float = field(8, "its standard error", NAN)


@message(11, version=1)
@dataclass(frozen=True, kw_only=True, slots=True)
class MatchResult:
    """Best lag, its uncertainty, and the decision."""

    header: Header = field(1, "", None)
    method: str = field(2, "name of the matcher", "")
    grid: str = field(3, "reference compared with", "")
    decision: str = field(4, "'match', 'no_match' or 'no_decision'", "no_decision")
    reason: str = field(5, "why, in words", "")
    lag_s: float = field(6, "video's first frame minus the reference's first sample", NAN)
    lag_std_s: float = field(7, "its standard error", NAN)
    start_utc_ns: int = field(8, "time of the first frame, UTC since 1970; 0 is unknown", 0)
    correlation: float = field(9, "normalised cross-correlation at that lag", NAN)
    log10_lr: float = field(10, "for this time against another time in this reference", NAN)
    log10_lr_absent: float = field(11, "for this time against 'not in this reference'", NAN)
    clock_ppm: float = field(
        12, "camera's clock error; positive is fast, so its ENF reads low", NAN
    )
    clock_std_ppm: float = field(13, "its standard error", NAN)
    residual_std_hz: float = field(14, "ENF less reference at that lag, offset removed", NAN)
    expected_std_hz: float = field(15, "what the estimates' own errors lead one to expect", NAN)
    search_size: int = field(16, "lags compared", 0)
    seconds_used: float = field(17, "usable seconds that the best lag rests on", 0.0)
    idle_ratio: float = field(18, "idle ratio assumed; NaN for none", NAN)
    claim: str = field(19, "'supported', 'refuted', 'undecidable', or empty without a claim", "")
    claimed_utc_ns: int = field(20, "claimed start, UTC since 1970; 0 without a claim", 0)
    verbal: str = field(21, "the likelihood ratio in words", "")
    final: bool = field(22, "whether the stream had ended", False)
    candidates: tuple[Candidate, ...] = field(23, "ranked, the best first", ())
    warnings: tuple[str, ...] = field(24, "what a reader should know", ())
    claim_log10_lr: float = field(25, "for the claimed time against none in the reference", NAN)
    claim_log10_lr_other: float = field(26, "for the claimed time against another time", NAN)
    zone_unknown: bool = field(27, "whether the reference's times told no zone", False)
    segments: tuple[Segment, ...] = field(28, "of an edited clip, in its order", ())
    edits: tuple[Edit, ...] = field(29, "what was done to it, in its order", ())

    @property
    def in_short(self) -> str:
        """Decision on one line, for logs."""
        return f"{self.decision}: {self.reason}"


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
        """Event on one line, with the time on its stream, which each epoch begins anew."""
        return self.line()

    def line(self, *, by_host: bool = False) -> str:
        """Event on one line; ``by_host``: with UTC by the host's clock, where that is known."""
        what = f"{self.severity} {self.kind}" if self.active else f"{self.kind} ended"
        at_ns = self.start_pts_ns if self.active else self.end_pts_ns
        arrival_ns = self.header.arrival_time_ns if by_host else 0
        when = utc_text(arrival_ns and arrival_ns + at_ns - self.header.pts_ns)
        stream = f"epoch {self.header.epoch}" if self.header.epoch else "the stream"
        return f"{what} at {when or f'{seconds(at_ns):.1f} s of {stream}'}: {self.text}"


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
        summary = f"{self.verdict}{known}, gap {self.gap_before:.1e} to {self.gap_after:.1e}"
        return "; ".join([summary, *self.changed])


@message(6, version=1)
@dataclass(frozen=True, kw_only=True, slots=True)
class Health:
    """State and counters of one node, published every second and at every change of state."""

    header: Header = field(1, "", None)
    node: str = field(2, "name in the graph", "")
    kind: str = field(3, "decode, rows, track, …", "")
    state: str = field(
        4, "'starting', 'running', 'waiting', 'done', 'failed', 'restarting' or 'lost'", ""
    )
    detail: str = field(5, "one line for a person", "")
    pid: int = field(6, "process number", 0)
    host: str = field(7, "host's name", "")
    time_ns: int = field(8, "host's clock", 0)
    messages_in: int = field(9, "messages received", 0)
    messages_out: int = field(10, "messages sent", 0)
    dropped: int = field(11, "messages dropped by choice of delivery class", 0)
    missed: int = field(12, "messages that never came, by sequence number", 0)
    rejected: int = field(13, "messages that didn't parse or had another version", 0)
    rate_hz: float = field(14, "messages received per second, lately", 0.0)
    queue_depth: int = field(15, "messages waiting", 0)
    latency_s: float = field(16, "from the arrival of what was filmed to here, lately", 0.0)
    last_input_ns: int = field(17, "host's clock at the last message received; 0 for never", 0)
    lost_peers: tuple[str, ...] = field(18, "nodes it depends on that are gone", ())
    memory_bytes: int = field(19, "resident memory", 0)
    cpu_s: float = field(20, "processor time used", 0.0)
    recovered: int = field(21, "messages that had not come, and were got from their sender", 0)
    restarts: int = field(22, "times it was started again in this run", 0)
    latency_p50_s: float = field(
        23, "median over the last minute, from arrival to here; NaN when nothing came", NAN
    )
    latency_p95_s: float = field(24, "that of the slowest twentieth", NAN)
    exposure_p50_s: float = field(
        25, "median from exposure, by the camera's own clock, to here; NaN when it tells none", NAN
    )
    exposure_p95_s: float = field(26, "that of the slowest twentieth", NAN)

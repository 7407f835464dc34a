"""The result of matching a video's ENF with a reference: time of recording, edits, decision."""

from __future__ import annotations

from dataclasses import dataclass

from rsenf.messages.header import Header
from rsenf.messages.schema import field, message

NAN = float("nan")


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

"""Everything that a report on the time of a recording is made from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from rsenf.match.series import Grid
from rsenf.match.settings import MatchSettings
from rsenf.messages import EnfEstimate, IdleEstimate, MatchResult
from rsenf.report.spectrum import ThinRows


@dataclass(frozen=True, kw_only=True)
class RecordingFacts:
    """The recording's file. ``seconds`` is the length of what could be read of it.

    ``frame_rate_hz`` is by the times of its frames, and ``container`` what the file says of itself,
    if it is a video.
    """

    name: str
    bytes: int
    sha256: str
    seconds: float
    stretches: int
    frame_rate_hz: float | None = None
    container: Mapping[str, Any] | None = None


@dataclass(frozen=True, kw_only=True)
class ReferenceFacts:
    """A reference's file and what is in it. ``bytes`` is None where it is no single file."""

    name: str
    bytes: int | None
    sha256: str
    grid: str
    nominal_hz: float
    t0_ns: int
    step_s: float
    samples: int
    valid_samples: int
    gaps: int
    longest_gap_s: float
    duplicates: int
    notes: Sequence[str] = ()


@dataclass(frozen=True, kw_only=True)
class Case:
    """A verdict with all that it came from.

    Parameters
    ----------
    result : MatchResult
    verdict : dict
        The verdict as ``verify --json`` prints it, warnings included.
    estimates : sequence of EnfEstimate
        Of the stretch that the result is about.
    spectrum : ThinRows
        Of the same stretch.
    grid : Grid or None
        The reference that the result is about.
    recording : RecordingFacts
    references : sequence of ReferenceFacts
        All that were compared with.
    settings : MatchSettings
    command : str
        What to type for the same report; empty where it wasn't typed.
    parameters : mapping of str to mapping
        All parameters in effect, by group; no absolute paths among them.
    versions : mapping of str to str
        Of the program and what it rests on.
    idle : IdleEstimate, optional
        The camera's idle ratio, where it was looked for.
    """

    result: MatchResult
    verdict: dict[str, Any]
    estimates: Sequence[EnfEstimate]
    spectrum: ThinRows
    grid: Grid | None
    recording: RecordingFacts
    references: Sequence[ReferenceFacts]
    settings: MatchSettings = field(default_factory=MatchSettings)
    command: str = ""
    parameters: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=dict)
    idle: IdleEstimate | None = None

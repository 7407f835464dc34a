"""The inputs of a report on the time of a recording."""

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
    """The recording's file. ``seconds`` is the duration of what could be read.

    ``frame_rate_hz`` is measured from the frame times; ``container`` is the metadata of a video.
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
    """A reference's file and its contents. ``bytes`` is None if it isn't a single file."""

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
    """A verdict and everything that it is based on.

    Parameters
    ----------
    result : MatchResult
    verdict : dict
        The verdict as ``verify --json`` prints it, including warnings.
    estimates : sequence of EnfEstimate
        Estimates of the epoch that the result is about.
    spectrum : ThinRows
        Spectrogram of the same epoch.
    grid : Grid or None
        The reference that the result is about.
    recording : RecordingFacts
    references : sequence of ReferenceFacts
        All references that were searched.
    settings : MatchSettings
    command : str
        Command line that reproduces the report; empty if it wasn't made by a command.
    parameters : mapping of str to mapping
        All parameters in effect, by group; without absolute paths.
    versions : mapping of str to str
        Versions of rsenf and of the libraries it uses.
    idle : IdleEstimate, optional
        The camera's idle ratio, if it was estimated.
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

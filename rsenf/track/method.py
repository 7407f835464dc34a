"""Interface of an ENF method, its settings, and the check of its frame rate.

:class:`RateCheck` withholds frequencies if the frame rate is only assumed, and suggests others if
none is found.
"""

from __future__ import annotations

import dataclasses
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

from rsenf.errors import UsageError
from rsenf.flicker.frame_rate import DOUBTFUL, GIVE_RATE, UNTIMED, FrameRateFinder, PerFrame
from rsenf.messages import EnfEstimate, RateBasis, RowBlock
from rsenf.track.paper_templates import INTERPOLATIONS

HARMONICS = (1, 2, 3)


@dataclass(frozen=True)
class TrackSettings:
    """Settings of the ENF methods.

    ``projection`` tracks all harmonics and lines jointly and adapts its window: the fields from
    ``harmonic`` to ``search_hz`` belong to the methods with a fixed window. ``paper`` has such a
    window but tries all lines.

    Parameters
    ----------
    method : str
        Name of the estimator.
    nominal_hz : float, optional
        50 or 60; found from the data when not given.
    harmonic : int
        Harmonic of the illumination frequency.
    line_m : int, optional
        Line ``k·f_0 + m·F_r`` to follow; the strongest when not given.
    window_s : float
        Length of the window, which ``projection`` adapts to the signal.
    hop_s : float
        Time between values; always a second with ``projection``.
    search_hz : float
        Half-width of the band searched, as a deviation of the grid's frequency.
    min_snr : float
        Line power over noise power in a resolution cell, below which there is no signal. Noise
        alone exceeds 40 in about one window of 10^13 per line.
    max_std_hz : float
        Standard error above which an estimate is unusable.
    interpolation : str
        Interpolation that ``paper`` fills the idle period with. A name of
        :data:`rsenf.track.paper_templates.INTERPOLATIONS`.
    """

    # For the validation of configuration files: a misspelt key is an error.
    __pydantic_config__: ClassVar = {"extra": "forbid"}

    method: str = "projection"
    nominal_hz: float | None = None
    harmonic: int = field(default=1, metadata={"choices": HARMONICS})
    line_m: int | None = None
    window_s: float = 20.0
    hop_s: float = 1.0
    search_hz: float = 0.5
    min_snr: float = 40.0
    max_std_hz: float = 0.02
    interpolation: str = "neighbour_mean"

    @property
    def nominals_hz(self) -> tuple[float, ...]:
        """Nominal frequencies to look for (Hz)."""
        return (self.nominal_hz,) if self.nominal_hz else (50.0, 60.0)

    def __post_init__(self) -> None:
        if self.nominal_hz not in (None, 50.0, 60.0):
            raise UsageError(f"nominal frequency {self.nominal_hz} Hz: 50 or 60")
        if self.harmonic not in HARMONICS:
            raise UsageError(f"harmonic {self.harmonic}: 1, 2 or 3")
        for name in ("search_hz", "min_snr", "max_std_hz"):
            if not getattr(self, name) > 0:
                raise UsageError(f"{name} of {getattr(self, name):g}: above 0")
        if not 0 < self.hop_s <= self.window_s:
            raise UsageError(f"hop of {self.hop_s} s with a window of {self.window_s} s")
        if self.interpolation not in INTERPOLATIONS:
            raise UsageError(
                f"no interpolation {self.interpolation!r}", f"one of {', '.join(INTERPOLATIONS)}"
            )


# Settings that some methods don't use, and refuse.
CHOICES = ("harmonic", "line_m", "interpolation")


class EnfMethod(ABC):
    """A :class:`rsenf.stage.Stage` from row blocks to :class:`rsenf.messages.EnfEstimate`.

    Parameters
    ----------
    settings : TrackSettings, optional

    Attributes
    ----------
    name : str
        Name in the registry and in its estimates.
    help : str
        Description in a line.
    obeys : frozenset of str
        Those of :data:`CHOICES` that it uses.
    rows_needed : mapping
        Fields of the rows settings, with the values that it needs.
    shares_follower : bool
        Whether its constructor takes a ``follower`` that it shares with another stage, a
        :class:`rsenf.flicker.follower.Follower`.
    """

    name: ClassVar[str]
    help: ClassVar[str]
    obeys: ClassVar[frozenset[str]] = frozenset()
    rows_needed: ClassVar[Mapping[str, Any]] = {}
    shares_follower: ClassVar[bool] = False

    def __init__(self, settings: TrackSettings | None = None) -> None:
        self.settings = settings or TrackSettings(method=self.name)

    @classmethod
    def ignored(cls, settings: TrackSettings) -> list[str]:
        """Return those of :data:`CHOICES` that are set but that it doesn't use."""
        return [
            name
            for name in CHOICES
            if name not in cls.obeys and getattr(settings, name) != getattr(TrackSettings, name)
        ]

    @classmethod
    def check(cls, settings: TrackSettings) -> None:
        """Refuse settings that it would ignore.

        Raises
        ------
        UsageError
            If there are any.
        """
        ignored = [name.removesuffix("_m") for name in cls.ignored(settings)]
        if ignored:
            raise UsageError(
                f"{cls.name} takes no {' and no '.join(ignored)}: {cls.help}",
                f"leave {' and '.join(ignored)} out, or take another method",
            )

    @abstractmethod
    def update(self, message: RowBlock) -> list[Any]:
        """Take a block of rows; return the estimates that it completes."""

    @abstractmethod
    def flush(self) -> list[Any]:
        """Return the estimates that the end of the stream completes."""


def check_method(name: str, method: type[EnfMethod]) -> None:
    """Check that a registered method is a complete :class:`EnfMethod`, of the name given.

    Parameters
    ----------
    name : str
    method : type

    Raises
    ------
    UsageError
        If it isn't.
    """
    if not (isinstance(method, type) and issubclass(method, EnfMethod)):
        raise UsageError(f"{name} is no rsenf.track.EnfMethod", "derive it from that class")
    missing = [what for what in ("name", "help") if not getattr(method, what, None)]
    missing += sorted(method.__abstractmethods__)
    if missing:
        raise UsageError(f"the ENF method {method.__name__} lacks {', '.join(missing)}")
    if method.name != name:
        raise UsageError(f"the ENF method {method.name} is added as {name}", "give both one name")


class RateCheck:
    """Wraps a tracker, and checks whether the frame rate of its estimates is known.

    Implements ``rsenf.stage.Stage``.

    Parameters
    ----------
    method : EnfMethod
    """

    def __init__(self, method: EnfMethod) -> None:
        self._method = method
        self._finder: FrameRateFinder | None = FrameRateFinder(method.settings.nominal_hz)

    def update(self, message: RowBlock) -> list[Any]:
        """Take a block of rows; return the estimates that it completes."""
        if self._finder is not None:
            self._finder.add(message)
        return self._checked(self._method.update(message))

    def flush(self) -> list[Any]:
        """Return the estimates that the end of the stream completes."""
        return self._checked(self._method.flush())

    def _checked(self, estimates: list[Any]) -> list[Any]:
        if self._finder is None or not estimates:
            return estimates
        if estimates[0].header.rate_basis == RateBasis.ASSUMED:
            return [_untimed(estimate, self._finder.found()) for estimate in estimates]
        if any(estimate.usable for estimate in estimates if estimate.rank == 0):
            self._finder = None  # the rate is right, or near it
            return estimates
        return [self._doubted(estimate, self._finder) for estimate in estimates]

    @staticmethod
    def _doubted(estimate: EnfEstimate, finder: FrameRateFinder) -> EnfEstimate:
        """Add the frame rates at which there would be light, if there is none at this one."""
        found = finder.found() if estimate.reason in DOUBTFUL else None
        rates = found.hypotheses if found else ()
        return dataclasses.replace(estimate, rate_hypotheses=rates)


def _untimed(estimate: EnfEstimate, found: PerFrame | None) -> EnfEstimate:
    """Return an estimate without what depends on a known frame rate."""
    reason = estimate.reason
    if found or estimate.usable:
        reason = f"{UNTIMED}: {found.words if found else GIVE_RATE}"
    return EnfEstimate(
        header=estimate.header,
        method=estimate.method,
        rank=estimate.rank,
        harmonic=estimate.harmonic,
        origin_pts_ns=estimate.origin_pts_ns,
        start_pts_ns=estimate.start_pts_ns,
        end_pts_ns=estimate.end_pts_ns,
        frame_rate_hz=estimate.frame_rate_hz,
        snr_db=estimate.snr_db,
        reason=reason,
        rate_hypotheses=found.hypotheses if found else (),
    )

"""Settings of the ENF methods."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from rsenf.errors import UsageError
from rsenf.track.interpolate import INTERPOLATIONS

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
        :data:`rsenf.track.interpolate.INTERPOLATIONS`.
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

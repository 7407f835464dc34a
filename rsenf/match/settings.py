"""Settings of the matchers, with the reason for each default."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from rsenf.errors import UsageError

Smoothing = Literal["auto", "window", "none"]


@dataclass(frozen=True, kw_only=True)
class MatchSettings:
    """Settings of all matchers.

    Parameters
    ----------
    min_seconds : float
        Fewest usable seconds for a decision.
    min_overlap : float
        Share of the clip's usable seconds that must overlap the reference at a lag.
    smoothing : {'auto', 'window', 'none'}
        ``window`` averages the reference as the tracker's window averages the grid, ``none`` takes
        it as it is, ``auto`` takes the better of the two: published references are sometimes
        averages already, and those of laboratories mostly are. For estimates of 1 s ``auto`` also
        tries averaging the estimates instead.
    reference_std_hz : float
        Standard deviation of a good reference from the grid at the lamp. Two recordings of one
        grid differ by 0.05 to 1.2 mHz in the measured data.
    reference_noise_hz : float
        Standard error of each second of the reference, if it is known to be large.
    clock_scale_ppm : float
        Scale of the Student distribution (3 degrees of freedom) of cameras' clock errors. Most are
        within 30 ppm; one real camera is at 70.
    max_chance : float
        Largest expected number of chance fits as good as the best one, for a match.
    min_log10_lr : float
        Least log10 likelihood ratio of the best time against the second best, for a match.
    min_fit : float
        Least probability of so large a residual at the true time; below it the best time doesn't
        fit.
    tolerance_s : float
        Largest difference between a claimed start and the one found, and largest standard error of
        a match.
    candidates : int
        Number of candidates to report.
    threshold_correlation : float
        Peak correlation above which the paper's metrics decide (``TH_c``).

    Raises
    ------
    UsageError
        If a setting is outside its range.
    """

    min_seconds: float = 30.0
    min_overlap: float = 0.5
    smoothing: Smoothing = "auto"
    reference_std_hz: float = 1e-3
    reference_noise_hz: float = 0.0
    clock_scale_ppm: float = 35.0
    max_chance: float = 0.01
    min_log10_lr: float = 2.0
    min_fit: float = 0.01
    tolerance_s: float = 1.0
    candidates: int = 5
    threshold_correlation: float = 0.94

    def __post_init__(self) -> None:
        if self.smoothing not in get_args(Smoothing):
            known = ", ".join(get_args(Smoothing))
            raise UsageError(f"no smoothing {self.smoothing!r}", f"one of {known}")
        for name in ("tolerance_s", "clock_scale_ppm", "max_chance"):
            if not getattr(self, name) > 0:
                raise UsageError(f"{name} of {getattr(self, name):g}: above 0")
        for name in (
            "min_seconds", "candidates", "reference_std_hz", "reference_noise_hz", "min_log10_lr",
            "min_fit",
        ):  # fmt: skip
            if not getattr(self, name) >= 0:
                raise UsageError(f"{name} of {getattr(self, name):g}: 0 or more")
        if not 0 < self.min_overlap <= 1:
            raise UsageError(f"minimum overlap {self.min_overlap}: above 0, at most 1")
        if not -1 <= self.threshold_correlation <= 1:
            raise UsageError(
                f"threshold of {self.threshold_correlation} for a correlation: -1 to 1"
            )

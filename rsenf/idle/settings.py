"""Settings of the idle methods."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from rsenf.errors import UsageError


@dataclass(frozen=True)
class IdleSettings:
    """Settings of all idle methods.

    Parameters
    ----------
    method : str
        Name of the estimator.
    nominal_hz : float, optional
        50 or 60; found from the data when not given.
    every_s : float
        Stream time between estimates; the last one comes at the end. In a long stream each waits
        until the stream is an eighth longer, twenty seconds at most.
    """

    # For the validation of configuration files: a misspelt key is an error.
    __pydantic_config__: ClassVar = {"extra": "forbid"}

    method: str = "coherent"
    nominal_hz: float | None = None
    every_s: float = 10.0

    def __post_init__(self) -> None:
        if self.nominal_hz not in (None, 50.0, 60.0):
            raise UsageError(f"nominal frequency {self.nominal_hz} Hz: 50 or 60")
        if not self.every_s > 0:
            raise UsageError(f"an estimate every {self.every_s} s")

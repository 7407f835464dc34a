"""Interface of an ENF method."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar

from rsenf.errors import UsageError
from rsenf.messages import RowBlock
from rsenf.track.settings import TrackSettings

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
        Whether its constructor takes a ``follower``, a :class:`rsenf.flicker.shared.Follower` that
        it shares with another stage.
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

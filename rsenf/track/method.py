"""What an ENF method declares of itself."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar

from rsenf.errors import UsageError
from rsenf.messages import RowBlock
from rsenf.track.settings import TrackSettings

# Settings that mean nothing to some methods, and are refused by them.
CHOICES = ("harmonic", "line_m", "interpolation")


class EnfMethod(ABC):
    """A :class:`rsenf.stage.Stage` from row blocks to :class:`rsenf.messages.EnfEstimate`.

    Parameters
    ----------
    settings : TrackSettings, optional

    Attributes
    ----------
    name : str
        As in the registry and in its estimates.
    help : str
        What it is, in a line.
    obeys : frozenset of str
        Which of :data:`CHOICES` it has a use for.
    rows_needed : mapping
        Fields of the rows settings that must have these values for it.
    shares_follower : bool
        Whether it is also made with a ``follower``, a :class:`rsenf.flicker.shared.Follower`
        that follows the flicker for another stage, too.
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
        """Return those of :data:`CHOICES` that are set, and that it has no use for."""
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
            Naming them.
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
    """Check that a method is one, whole, and of the name that it is added by.

    Raises
    ------
    UsageError
        When it isn't.
    """
    if not (isinstance(method, type) and issubclass(method, EnfMethod)):
        raise UsageError(f"{name} is no rsenf.track.EnfMethod", "derive it from that class")
    missing = [what for what in ("name", "help") if not getattr(method, what, None)]
    missing += sorted(method.__abstractmethods__)
    if missing:
        raise UsageError(f"the ENF method {method.__name__} lacks {', '.join(missing)}")
    if method.name != name:
        raise UsageError(f"the ENF method {method.name} is added as {name}", "give both one name")

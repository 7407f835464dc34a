"""Plug-in registries: named items, both rsenf's and those of other packages by entry points.

A package adds an item in its ``pyproject.toml``, without any change to rsenf::

    [project.entry-points."rsenf.methods"]
    my_method = "my_package.my_method:MyTracker"

Groups: ``rsenf.methods`` (ENF), ``rsenf.idle_methods``, ``rsenf.matchers``, ``rsenf.effects``,
``rsenf.nodes``, ``rsenf.inputs``. Items are imported on first access by name.
"""

from __future__ import annotations

import contextlib
import importlib
from collections.abc import Callable, Iterator, Mapping
from importlib.metadata import EntryPoint, entry_points
from typing import Generic, TypeVar

from rsenf.errors import UsageError, did_you_mean

T = TypeVar("T")


class Registry(Mapping[str, T], Generic[T]):
    """Items by name: rsenf's first, in their order, then those of other packages.

    Parameters
    ----------
    what : str
        Description of an item, for messages: ``ENF method``.
    group : str
        Entry-point group for other packages. They can't replace items of rsenf.
    built_in : mapping
        Items by name, or their locations as ``module:attribute``.
    check : callable, optional
        Takes the name and an added item; raises UsageError if the item is invalid.

    Examples
    --------
    >>> shapes = Registry("shape", "rsenf.no_such_group", {"square": 4})
    >>> shapes.register("triangle", 3)
    >>> list(shapes), shapes.hint("squere")
    (['square', 'triangle'], "did you mean 'square'? one of square, triangle")
    """

    def __init__(
        self,
        what: str,
        group: str,
        built_in: Mapping[str, T | str],
        check: Callable[[str, T], None] = lambda name, item: None,
    ) -> None:
        self.what, self.group, self._check = what, group, check
        self._items: dict[str, T | str] = dict(built_in)
        self._others: dict[str, EntryPoint] | None = None

    def __getitem__(self, name: str) -> T:
        """Return an item, importing it if necessary.

        Raises
        ------
        KeyError
            When there is no item of that name.
        UsageError
            When it is from another package and can't be imported.
        """
        if name not in self._items:
            self._items[name] = self._load(self._found()[name])
        item = self._items[name]
        if isinstance(item, str):
            module, _, attribute = item.partition(":")
            loaded: T = getattr(importlib.import_module(module), attribute)
            self._items[name] = item = loaded
        return item

    def __iter__(self) -> Iterator[str]:
        return iter([*self._items, *(n for n in self._found() if n not in self._items)])

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def __contains__(self, name: object) -> bool:
        return name in self._items or name in self._found()

    def find(self, name: str) -> T:
        """Return an item by a name that a user has entered.

        Raises
        ------
        UsageError
            When the name is unknown (with the nearest as a hint), or the item can't be imported.
        """
        if name not in self:
            raise UsageError(f"no {self.what} {name!r}", self.hint(name))
        return self[name]

    def usable(self) -> dict[str, T]:
        """Return all items that can be imported; broken packages are skipped."""
        found = {}
        for name in self:
            with contextlib.suppress(UsageError):
                found[name] = self[name]
        return found

    def hint(self, name: str) -> str:
        """Return the nearest name to an unknown one, and all names."""
        return f"{did_you_mean(name, self)} one of {', '.join(self)}".lstrip()

    def register(self, name: str, item: T) -> None:
        """Add or replace an item, in this process only."""
        self._check(name, item)
        self._items[name] = item

    def _found(self) -> dict[str, EntryPoint]:
        if self._others is None:
            self._others = {point.name: point for point in entry_points(group=self.group)}
        return self._others

    def _load(self, point: EntryPoint) -> T:
        try:
            loaded: T = point.load()
            self._check(point.name, loaded)
        except Exception as exc:  # a foreign module may raise anything
            package = point.dist.name if point.dist else point.value
            why = str(exc) if isinstance(exc, UsageError) else f"{type(exc).__name__}: {exc}"
            raise UsageError(
                f"{self.what} {point.name!r} of the package {package} can't be loaded: {why}",
                f"mend or remove the package {package}",
            ) from exc
        return loaded

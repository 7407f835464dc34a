"""Named things of one kind: rsenf's own, and those that other packages add by entry points.

A package adds its own in its ``pyproject.toml``; nothing of rsenf is touched::

    [project.entry-points."rsenf.methods"]
    my_method = "my_package.my_method:MyTracker"

Groups: ``rsenf.methods`` (ENF), ``rsenf.idle_methods``, ``rsenf.matchers``, ``rsenf.effects``,
``rsenf.nodes``, ``rsenf.inputs``. Nothing is imported before it is asked for by name.
"""

from __future__ import annotations

import contextlib
import difflib
import importlib
from collections.abc import Callable, Iterator, Mapping
from importlib.metadata import EntryPoint, entry_points
from typing import Generic, TypeVar

from rsenf.errors import UsageError

T = TypeVar("T")


class Registry(Mapping[str, T], Generic[T]):
    """Things by name: rsenf's own first, in their order, then those of other packages.

    Parameters
    ----------
    what : str
        What one of them is, for messages: ``ENF method``.
    group : str
        Entry-point group by which other packages add theirs. They can't replace one of rsenf's.
    built_in : mapping
        The things themselves by name, or where they are: ``module:attribute``.
    check : callable, optional
        Given the name and a thing that is added, raises a UsageError where it is no such thing.
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
        """Return a thing, imported if need be.

        Raises
        ------
        KeyError
            When there is none of that name.
        UsageError
            When it is another package's and can't be imported.
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
        """Return a thing by a name that somebody typed.

        Raises
        ------
        UsageError
            When there is none, with the nearest, or when it can't be imported.
        """
        if name not in self:
            raise UsageError(f"no {self.what} {name!r}", self.hint(name))
        return self[name]

    def usable(self) -> dict[str, T]:
        """Return all that can be imported: one broken package takes nothing from the others."""
        found = {}
        for name in self:
            with contextlib.suppress(UsageError):
                found[name] = self[name]
        return found

    def hint(self, name: str) -> str:
        """Return what a misspelt name may have meant, and what there is."""
        close = difflib.get_close_matches(name, self, n=1)
        return (f"did you mean {close[0]!r}? " if close else "") + f"one of {', '.join(self)}"

    def register(self, name: str, item: T) -> None:
        """Add a thing for as long as this process runs; the same name again replaces it."""
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
        except Exception as exc:  # whatever a stranger's module does
            package = point.dist.name if point.dist else point.value
            why = str(exc) if isinstance(exc, UsageError) else f"{type(exc).__name__}: {exc}"
            raise UsageError(
                f"{self.what} {point.name!r} of the package {package} can't be loaded: {why}",
                f"mend or remove the package {package}",
            ) from exc
        return loaded

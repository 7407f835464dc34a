"""Opens a reference by its name: a file, or a grid of the store."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rsenf.errors import UsageError
from rsenf.reference.moments import utc_ns
from rsenf.reference.options import ReadOptions
from rsenf.reference.read import read_reference
from rsenf.reference.reference import Reference

if TYPE_CHECKING:
    from rsenf.reference.store import StoredReference

STORE = "store:"
_LIMITS = ("from", "to")


def open_reference(
    spec: str | Path,
    *,
    store: str | os.PathLike[str] | None = None,
    grid: str = "",
    **reading: Any,
) -> Reference | StoredReference:
    """Open a reference.

    Parameters
    ----------
    spec : str or Path
        A file, for :func:`rsenf.reference.read_reference`; or
        ``store:GRID[@STEP][?from=TIME&to=TIME]``, a grid of the store: its finest step unless one
        is given, and all of it or the samples that begin at or after ``from`` and before ``to``
        (ISO 8601, UTC unless it has a zone). The store is read only on access.
    store : str or Path, optional
        Folder of the store; the default one if None.
    grid : str
        Name of the reference; by default that of the file or of the grid in the store.
    **reading
        Options of :class:`rsenf.reference.options.ReadOptions`. Only ``nominal_hz`` applies to the
        store.

    Raises
    ------
    UsageError
        If there is no such file or grid, or an argument is invalid.
    ReferenceFormatError, SchemaMismatch
        If it can't be read.
    """
    if not str(spec).startswith(STORE):
        return read_reference(spec, grid=grid, **reading)
    options = ReadOptions(**reading)
    reference = _from_store(str(spec), store, grid, options.nominal_hz)
    if replace(options, nominal_hz=None, assumed_hz=None) != ReadOptions():
        line = "what says how files are read (--timezone, --column …) has no bearing on the store"
        reference = replace(reference, notes=(*reference.notes, line))
    return reference


def _from_store(
    spec: str, store: str | os.PathLike[str] | None, grid: str, nominal_hz: float | None
) -> StoredReference:
    from rsenf.reference.store import default_store, open_grid

    name, limits_ns = _parse(spec)
    folder = Path(store) if store else default_store()
    reference = open_grid(folder, name, limits_ns.get("from"), limits_ns.get("to"))
    if nominal_hz not in (None, reference.nominal_hz):
        raise UsageError(
            f"{spec} is of a {reference.nominal_hz:g} Hz grid, not of one of {nominal_hz:g} Hz",
            "correct the nominal frequency, or give another reference",
        )
    return replace(reference, grid=grid or reference.grid)


def _parse(spec: str) -> tuple[str, dict[str, int]]:
    """Return the grid, with its step if there is one, and the limits in ns since 1970."""
    name, _, query = spec.removeprefix(STORE).partition("?")
    limits: dict[str, int] = {}
    for part in filter(None, query.split("&")):
        key, _, text = part.partition("=")
        if key not in _LIMITS:
            raise UsageError(f"{spec}: {key!r} is no limit", "e.g. store:ce@1?from=2024-08-01")
        limits[key] = utc_ns(text, f"{key}=")
    if limits.get("from", 0) >= limits.get("to", 2**63):
        raise UsageError(f"{spec}: ends before it begins", "from is the earlier time")
    return name, limits

"""A reference by what the user calls it: a file, or a grid of the store."""

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
        ``store:GRID[@STEP][?from=TIME&to=TIME]``, a grid of the store: its finest step, unless
        one is named; all there is, or what begins at or after the one time and before the other
        (ISO 8601, UTC unless it says). Of the store nothing is read before it is asked for.
    store : str or Path, optional
        Folder of the store; the default one when not given.
    grid : str
        What to call it; as the file or the grid of the store otherwise.
    **reading
        As :class:`rsenf.reference.options.ReadOptions` takes them. Of them only ``nominal_hz`` has
        a bearing on the store.

    Raises
    ------
    UsageError
        When there is no such file or grid, or an argument can't be meant so.
    ReferenceFormatError, SchemaMismatch
        When it can't be read.
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

"""Where an import comes from, as it stands in its file."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from rsenf.errors import ReferenceFormatError, SchemaMismatch
from rsenf.reference.axis import Raster
from rsenf.reference.options import ReadOptions
from rsenf.timebase import NO_ZONE

VERSION = 1  # of the format of the store's files
KEY = "rsenf"
TAKEN_AS_UTC = "times without a zone taken as UTC"


@dataclass(frozen=True, kw_only=True)
class Record:
    """Where an import comes from.

    ``phase_ns`` is when samples begin, after a whole number of steps since 1970. ``name``,
    ``sha256`` and ``size_bytes`` are the file's; ``options`` are those it was read with, ``notes``
    what was found and assumed; ``rows`` were read, ``samples`` have a reading.
    """

    grid: str
    nominal_hz: float
    step_ns: int
    phase_ns: int
    name: str
    sha256: str
    size_bytes: int
    options: dict[str, Any]
    imported_utc: str
    rsenf: str
    rows: int
    samples: int
    notes: tuple[str, ...]

    @property
    def raster(self) -> Raster:
        """When samples begin; they are numbered from 1970."""
        return Raster(self.phase_ns, self.step_ns)

    @property
    def zone_unknown(self) -> bool:
        """Whether its times told no zone, and nobody said which."""
        return NO_ZONE in self.notes

    def metadata(self) -> dict[str, str]:
        """Return it as Parquet's metadata."""
        return {KEY: json.dumps({"version": VERSION, **asdict(self)})}


def record_in(metadata: dict[bytes, bytes] | None, path: Path) -> Record:
    """Read it from Parquet's metadata.

    Raises
    ------
    ReferenceFormatError
        When the file isn't of the store.
    SchemaMismatch
        When it is of another version.
    """
    text = (metadata or {}).get(KEY.encode())
    if text is None:
        raise ReferenceFormatError(f"{path} is not of the store", "remove it from there")
    held = json.loads(text)
    version = held.pop("version", None)
    if version != VERSION:
        raise SchemaMismatch(
            f"{path}: version {version} of the store's format, not {VERSION}",
            "written by another rsenf: use that one, or import the original again",
        )
    # Of before these were told: options that weren't there, and times that were silently UTC.
    options, notes = asdict(ReadOptions()) | held["options"], tuple(held["notes"])
    if options["timezone"] is None and TAKEN_AS_UTC in notes and NO_ZONE not in notes:
        notes = (*notes, NO_ZONE)
    return Record(**held | {"options": options, "notes": notes})

"""The provenance of an import, stored in its file."""

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
    """Provenance of an import.

    ``phase_ns`` is the start of the samples modulo the step, counted from 1970. ``name``,
    ``sha256`` and ``size_bytes`` are those of the file, ``options`` those of reading, and ``notes``
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
        """The times at which samples begin, numbered from 1970."""
        return Raster(self.phase_ns, self.step_ns)

    @property
    def zone_unknown(self) -> bool:
        """Whether its times have no zone and none was given."""
        return NO_ZONE in self.notes

    def metadata(self) -> dict[str, str]:
        """Return it as Parquet metadata."""
        return {KEY: json.dumps({"version": VERSION, **asdict(self)})}


def record_in(metadata: dict[bytes, bytes] | None, path: Path) -> Record:
    """Read the record in the Parquet metadata of a file.

    Raises
    ------
    ReferenceFormatError
        If the file doesn't belong to the store.
    SchemaMismatch
        If it has another version.
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
    # Older files lack newer options, and the note on times taken as UTC.
    options, notes = asdict(ReadOptions()) | held["options"], tuple(held["notes"])
    if options["timezone"] is None and TAKEN_AS_UTC in notes and NO_ZONE not in notes:
        notes = (*notes, NO_ZONE)
    return Record(**held | {"options": options, "notes": notes})

"""Settings of recording, for a 'record' node and for 'rsenf record'."""

from __future__ import annotations

from pydantic import Field

from rsenf.config.node_kind import Strict
from rsenf.record.limits import AlarmSettings, DiskLimits, Retention, Rotation


class RecordSettings(Strict):
    """Writes topics to an MCAP file, or to an archive of such files."""

    out: str | None = Field(None, description="file; or 'archive'")
    archive: str | None = Field(None, description="folder of files by site, camera and day")
    topics: tuple[str, ...] = Field(("**",), description="key expressions below the site")
    overwrite: bool = Field(False, description="replace a file that is there")
    flush_every_s: float = Field(
        0.5, gt=0, le=60, description="what is lost at most when the power fails"
    )
    compress: bool = Field(True, description="by zstd")
    rotation: Rotation = Field(Rotation(), description="when an archive's next file begins")
    retention: Retention = Field(Retention(), description="what of an archive is deleted")
    alarms: AlarmSettings = Field(AlarmSettings(), description="what an archive keeps about them")
    disk: DiskLimits = Field(DiskLimits(), description="how little of it may be left")

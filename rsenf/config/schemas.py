"""Small schemas beside the graph's: settings of recording, capture models, and case details."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from pydantic import Field

from rsenf.config.check import YamlText, check
from rsenf.config.node_kind import Strict
from rsenf.errors import ConfigError
from rsenf.record.limits import AlarmSettings, DiskLimits, Retention, Rotation

if TYPE_CHECKING:
    from rsenf.model import CaptureModel


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


class SimulatedInput(Strict):
    """The simulator in place of a camera."""

    model: str = Field(description="model file")
    reference: str | None = Field(None, description="grid frequency to film; synthetic without")
    start_s: float = Field(0.0, ge=0)
    duration_s: float = Field(60.0, gt=0)
    seed: int = 1
    timezone: str | None = None
    step_s: float | None = Field(None, gt=0)


def load_model(model: CaptureModel | str | PathLike[str]) -> CaptureModel:
    """Read a model file; a model is returned as it is.

    Raises
    ------
    UsageError, ConfigError
        With file and line, when it can't be read or isn't a model.
    """
    from rsenf.model import CaptureModel, ParameterError

    if isinstance(model, CaptureModel):
        return model
    document = YamlText(Path(model))
    if document.problems:
        raise ConfigError(document.report())
    try:
        return CaptureModel.from_dict(document.data)
    except ParameterError as exc:
        raise ConfigError([f"{document.place(exc.path)}: {exc}"]) from exc


class CaseFile(Strict):
    """The case that a recording belongs to, as stated by its examiner; printed verbatim."""

    case: str = Field("", description="its number or name")
    exhibit: str = Field("", description="what the recording is called there")
    examiner: str = Field("", description="who examines it")
    laboratory: str = Field("", description="where")
    received: str = Field("", description="when the exhibit came, and from whom")


def load_case(path: Path) -> CaseFile:
    """Read a case file.

    Raises
    ------
    UsageError, ConfigError
        With file and line, when it can't be read or has unknown keys.
    """
    return check(YamlText(path, as_text=True), CaseFile)

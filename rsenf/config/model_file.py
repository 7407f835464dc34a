"""Capture models in files: the model file, and the simulator as an input of a graph."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from pydantic import Field

from rsenf.config.node_kind import Strict
from rsenf.config.yaml_lines import YamlText
from rsenf.errors import ConfigError

if TYPE_CHECKING:
    from rsenf.model import CaptureModel


class SimulatedInput(Strict):
    """The simulator in place of a camera."""

    model: str = Field(description="model file")
    reference: str | None = Field(None, description="grid frequency to film; synthetic without")
    start_s: float = Field(0.0, ge=0)
    duration_s: float = Field(60.0, gt=0)
    seed: int = 1
    timezone: str | None = None
    step_s: float | None = Field(None, gt=0)


def load_model(path: Path) -> CaptureModel:
    """Read a model file.

    Raises
    ------
    UsageError, ConfigError
        With file and line, when it can't be read or isn't a model.
    """
    from rsenf.model import CaptureModel, ParameterError

    document = YamlText(path)
    if document.problems:
        raise ConfigError(document.report())
    try:
        return CaptureModel.from_dict(document.data)
    except ParameterError as exc:
        raise ConfigError([f"{document.place(exc.path)}: {exc}"]) from exc

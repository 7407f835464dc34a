"""Model files: the capture model's parameters, from YAML."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from rsenf.config.yaml_lines import YamlText
from rsenf.errors import ConfigError

if TYPE_CHECKING:
    from rsenf.model import CaptureModel


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

"""Case details for a report; they don't take part in any computation."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from rsenf.config.check import check
from rsenf.config.node_kind import Strict
from rsenf.config.yaml_lines import YamlText


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

"""YAML with the line of every key, environment variables filled in, duplicate keys refused."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

import yaml

from rsenf.errors import ConfigError, UsageError

KeyPath = tuple[str | int, ...]

_VARIABLE = re.compile(r"\$\{([A-Za-z_][A-Za-z0-9_]*)(?::-([^}]*))?\}")


class YamlText:
    """A YAML document as plain data, and where each of its keys stands.

    Parameters
    ----------
    path : Path
        File to read.

    Raises
    ------
    UsageError
        When there is no such file.
    ConfigError
        When it isn't YAML, repeats a key, or names a variable that isn't set.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.lines: dict[KeyPath, int] = {}
        self.problems: list[str] = []
        try:
            self.text = path.read_text(encoding="utf-8")
            root = yaml.compose(self.text, Loader=yaml.SafeLoader)
        except FileNotFoundError as exc:
            raise UsageError(f"no such file: {path}") from exc
        except (OSError, UnicodeDecodeError) as exc:
            raise UsageError(f"{path} can't be read as text ({exc})") from exc
        except yaml.MarkedYAMLError as exc:
            line = exc.problem_mark.line + 1 if exc.problem_mark else 1
            raise ConfigError([f"{path}:{line}: not YAML: {exc.problem}"]) from exc
        self.data: Any = self._value(root, ()) if root is not None else None
        if self.problems:
            raise ConfigError(self.problems)

    def place(self, key_path: KeyPath) -> str:
        """``file:line`` of a key, or of the nearest key above it."""
        while key_path and key_path not in self.lines:
            key_path = key_path[:-1]
        return f"{self.path}:{self.lines.get(key_path, 1)}"

    def _value(self, node: yaml.Node, at: KeyPath) -> Any:
        self.lines.setdefault(at, node.start_mark.line + 1)
        if isinstance(node, yaml.MappingNode):
            return self._mapping(node, at)
        if isinstance(node, yaml.SequenceNode):
            return [self._value(child, (*at, i)) for i, child in enumerate(node.value)]
        return self._scalar(node, at)

    def _mapping(self, node: yaml.MappingNode, at: KeyPath) -> dict[str, Any]:
        out: dict[str, Any] = {}
        for key_node, value_node in node.value:
            key, line = str(key_node.value), key_node.start_mark.line + 1
            if key in out:
                self.problems.append(f"{self.path}:{line}: key {key!r} stands here twice")
            self.lines[(*at, key)] = line
            out[key] = self._value(value_node, (*at, key))
        return out

    def _scalar(self, node: yaml.Node, at: KeyPath) -> Any:
        text = str(node.value)
        if "${" not in text:
            return yaml.SafeLoader("").construct_object(node)
        filled = _VARIABLE.sub(lambda m: self._variable(m, at), text)
        # A variable may hold a number: read what came out as YAML would have.
        return yaml.safe_load(filled) if filled else filled

    def _variable(self, match: re.Match[str], at: KeyPath) -> str:
        name, default = match.group(1), match.group(2)
        value = os.environ.get(name, default)
        if value is None:
            self.problems.append(f"{self.place(at)}: environment variable {name} is not set")
            return ""
        return value

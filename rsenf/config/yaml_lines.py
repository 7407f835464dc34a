"""YAML with line numbers of all keys, environment variables and detection of duplicate keys."""

from __future__ import annotations

import math
import os
import re
from pathlib import Path
from typing import Any

import yaml

from rsenf.errors import ConfigError, UsageError

KeyPath = tuple[str | int, ...]
# No graph is nearly as long, or has nearly as many values once all aliases are followed.
MOST_CHARACTERS, MOST_VALUES = 1_000_000, 100_000

_VARIABLE = re.compile(r"\$\{([A-Za-z_][A-Za-z0-9_]*)(?::-([^}]*))?\}")


class YamlText:
    """A YAML document as plain data, with the line of each key.

    Parameters
    ----------
    path : Path
    as_text : bool, optional
        Read every scalar as a string, also 0117 and 2026-01-15.

    Attributes
    ----------
    data : object
        The document: dicts, lists and scalars.
    problems : dict
        Duplicate keys, unset variables and unreadable values, by the path of the key. To be
        reported along with the problems found when the data is validated.

    Raises
    ------
    UsageError
        When the file doesn't exist or isn't readable text.
    ConfigError
        When it isn't YAML.
    """

    def __init__(self, path: Path, *, as_text: bool = False) -> None:
        self.path = path
        self._as_text = as_text
        self.lines: dict[KeyPath, int] = {}
        self.problems: dict[KeyPath, str] = {}
        self._loader = yaml.SafeLoader("")
        try:
            text = path.read_text(encoding="utf-8")
            root = compose(text)
            self.data: Any = self._value(root, ()) if root is not None else None
        except FileNotFoundError as exc:
            raise UsageError(f"no such file: {path}") from exc
        except (OSError, UnicodeDecodeError) as exc:
            raise UsageError(f"{path} can't be read as text ({exc})") from exc
        except yaml.MarkedYAMLError as exc:
            raise ConfigError([f"{path}:{_syntax_error(exc, text)}"]) from exc
        except yaml.YAMLError as exc:
            raise ConfigError([f"{path}:1: not YAML: {str(exc).splitlines()[0]}"]) from exc
        except RecursionError as exc:
            raise ConfigError([f"{path}:1: nested without end"]) from exc

    def place(self, key_path: KeyPath) -> str:
        """Return ``file:line`` of a key, or of its nearest known parent."""
        while key_path and key_path not in self.lines:
            key_path = key_path[:-1]
        return f"{self.path}:{self.lines.get(key_path, 1)}"

    def report(self) -> list[str]:
        """Return one line for each problem."""
        return [f"{self.place(at)}: {text}" for at, text in self.problems.items()]

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
            key = str(key_node.value)
            self.lines[(*at, key)] = key_node.start_mark.line + 1
            if key in out:
                self.problems[(*at, key)] = f"key {key!r} stands here twice"
            out[key] = self._value(value_node, (*at, key))
        return out

    def _scalar(self, node: yaml.Node, at: KeyPath) -> Any:
        if "${" in node.value:
            node.value = _VARIABLE.sub(lambda m: self._variable(m, at), node.value)
            if isinstance(node, yaml.ScalarNode) and node.style is None:
                # An unquoted variable may hold a number: determine its type again.
                node.tag = self._tag(node.value)
        if self._as_text:
            return node.value
        try:
            return self._loader.construct_object(node)
        except (ValueError, yaml.YAMLError):
            self.problems[at] = f"{node.value!r} can't be read as {node.tag.rpartition(':')[2]}"
            return None

    def _tag(self, text: str) -> str:
        tag = self._loader.resolve(yaml.ScalarNode, text, (True, False))  # type: ignore[no-untyped-call]  # untyped in PyYAML's stub
        return str(tag)

    def _variable(self, match: re.Match[str], at: KeyPath) -> str:
        name, default = match.group(1), match.group(2)
        value = os.environ.get(name, default)
        if value is None:
            self.problems[at] = f"environment variable {name} is not set"
            return ""
        return value


def compose(text: str) -> yaml.Node | None:
    """Parse YAML of a size that can be meant; None when it is empty.

    Raises
    ------
    yaml.YAMLError
        When it is no YAML, or too large.
    RecursionError
        When it is nested too deeply.
    """
    if len(text) > MOST_CHARACTERS:
        raise yaml.YAMLError(f"{len(text)} characters, at most {MOST_CHARACTERS} are read")
    root: yaml.Node | None = yaml.compose(text, Loader=yaml.SafeLoader)
    if root is not None and _values(root, {}) > MOST_VALUES:
        raise yaml.YAMLError(f"more than {MOST_VALUES} values, by aliases of aliases")
    return root


def _values(node: yaml.Node, known: dict[int, float]) -> float:
    """How many values a node has with all that its aliases stand for."""
    if id(node) not in known:
        known[id(node)] = math.inf  # of a node that holds itself
        children = node.value if isinstance(node, yaml.CollectionNode) else []
        if isinstance(node, yaml.MappingNode):
            children = [child for pair in node.value for child in pair]
        known[id(node)] = 1.0 + sum(_values(child, known) for child in children)
    return known[id(node)]


def _syntax_error(exc: yaml.MarkedYAMLError, text: str) -> str:
    number = exc.problem_mark.line if exc.problem_mark else 0
    line = text.splitlines()[number : number + 1]
    hint = "; within { } put ${…} in quotes" if line and "${" in line[0] else ""
    return f"{number + 1}: not YAML: {exc.problem}{hint}"

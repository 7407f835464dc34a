"""YAML files: read with the line of each key, and validated against a schema.

Environment variables are filled in and duplicate keys found. All problems are reported at once,
each with its line and a hint. Credentials are redacted in whatever is printed, logged, recorded or
shown, and a foreign name of this host is told to whoever serves pages.
"""

from __future__ import annotations

import ipaddress
import math
import os
import re
import socket
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from rsenf.config.node_kind import NODE_KINDS
from rsenf.decode.source import redact as redact_addresses
from rsenf.errors import ConfigError, UsageError, did_you_mean

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


_SECRET = r"password|passwd|passphrase|secret|token|private_key"
_SECRET_KEY = re.compile(_SECRET, re.IGNORECASE)
# A key that looks like a secret, in YAML, JSON or prose, and its value.
_PAIR = re.compile(
    rf"""([\w./-]*(?:{_SECRET})[\w./-]*["']?\s*[:=]\s*)("[^"]*"|'[^']*'|[^\s,}}\]]+)""",
    re.IGNORECASE,
)


def is_secret(key: str) -> bool:
    """Whether the value of a key must not be shown."""
    return _SECRET_KEY.search(key) is not None


def redact(text: str) -> str:
    """Redact credentials in addresses, and the values of keys that look like secrets.

    For lines of text. Use the more reliable :func:`hide` for structured data.

    Examples
    --------
    >>> redact("rtsp://admin:hunter2@10.0.0.7/cam")
    'rtsp://***@10.0.0.7/cam'
    """
    return _PAIR.sub(r"\1'***'", redact_addresses(text))


def hide(value: Any) -> Any:
    """Return plain data (dicts, lists, scalars) with secrets replaced by ``***``.

    The path of a ``url``, a webhook's, is a secret.

    Examples
    --------
    >>> hide({"user": "ann", "password": "hunter2", "url": "https://hooks.example.org/T1/x7"})
    {'user': 'ann', 'password': '***', 'url': 'https://hooks.example.org/***'}
    """
    if isinstance(value, dict):
        out = {k: "***" if is_secret(str(k)) and v else hide(v) for k, v in value.items()}
        if isinstance(url := out.get("url"), str):
            out["url"] = re.sub(r"(://[^/?#]*/).+", r"\1***", url)
        return out
    if isinstance(value, list | tuple):
        return [hide(v) for v in value]
    return redact(value) if isinstance(value, str) else value


Model = TypeVar("Model", bound=BaseModel)
_Schema = dict[str, Any]

_UNKNOWN = ("extra_forbidden", "unexpected_keyword_argument")
_MISSING = ("missing", "missing_argument")


def is_own_host(header: str, served_at: str) -> bool:
    """Whether an HTTP ``Host`` header names this host, and not a foreign name (DNS rebinding).

    Parameters
    ----------
    header : str
        An IP address, ``localhost``, this host's name or ``served_at`` is accepted, with any port.
    served_at : str
        Address that the server listens at.
    """
    name = header[1:].partition("]")[0] if header.startswith("[") else header.partition(":")[0]
    if name.lower() in {"localhost", socket.gethostname().lower(), served_at.lower()}:
        return True
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def check(document: YamlText, model: type[Model]) -> Model:
    """Validate a document.

    Parameters
    ----------
    document : YamlText
    model : type
        A pydantic model, of which an instance is returned.

    Raises
    ------
    ConfigError
        With one line for each problem.
    """
    if not isinstance(document.data, dict):
        raise ConfigError([f"{document.path}:1: not a mapping of keys to values"])
    try:
        read = model.model_validate(document.data)
    except ValidationError as exc:
        schema = model.model_json_schema()
        found = [_finding(document, schema, error) for error in exc.errors()]
        # A value that couldn't be read or filled in counts as one problem, not two.
        fresh = [f"{document.place(at)}: {t}" for at, t in found if at not in document.problems]
        raise ConfigError(document.report() + fresh) from exc
    if document.problems:
        raise ConfigError(document.report())
    return read


def _finding(document: YamlText, schema: _Schema, error: ErrorDetails) -> tuple[KeyPath, str]:
    """Return the place of an error in the file, and its message."""
    kind, context, last = error["type"], error.get("ctx", {}), str(error["loc"][-1])
    path, node = _follow(document.data, schema, error["loc"])
    name = ".".join(map(str, path)) or "file"
    if kind in _UNKNOWN:
        _, parent = _follow(document.data, schema, error["loc"][:-1])
        allowed = sorted(parent.get("properties", {}))
        above = ".".join(map(str, path[:-1]))
        text = f"{above + ': ' if above else ''}unknown key {last!r}"
        text += f"{did_you_mean(last, allowed, after='; ')}; allowed: {', '.join(allowed)}"
    elif kind in _MISSING:
        text = f"{name}: key {last!r} is missing"
    elif kind == "union_tag_not_found":
        text = f"{name}: key 'kind' is missing; one of {', '.join(_choices(node))}"
    elif kind == "union_tag_invalid":
        path, read = (*path, "kind"), str(context["tag"])
        text = _not_one_of(f"{name}.kind", read, _choices(node))
        if read in NODE_KINDS:  # of an installed package that can't be imported
            text = f"{name}.kind: {_why_broken(read)}"
    elif kind == "literal_error":
        words = context["expected"].replace(" or ", ", ").replace("'", "").split(", ")
        text = _not_one_of(name, str(error["input"]), words)
    else:
        reason = error["msg"].removeprefix("Value error, ").replace("valid tuple", "list")
        hidden = isinstance(error["input"], dict | BaseModel) or is_secret(name)
        text = f"{name}: {reason}" + ("" if hidden else f" (read: {error['input']!r})")
    return path, redact(text)


def _follow(data: Any, schema: _Schema, loc: tuple[int | str, ...]) -> tuple[KeyPath, _Schema]:
    """Translate pydantic's location to keys of the file, and the schema at its end.

    In a union pydantic's location contains the kind chosen, and for an invalid key the part
    ``[key]``: neither is a key of the file.
    """
    path: list[int | str] = []
    node = _plain(schema, schema)
    for part in loc:
        if part == "[key]":
            break
        kinds = node.get("discriminator", {}).get("mapping")
        if kinds or "oneOf" in node:
            branches = [{"$ref": kinds[part]}] if kinds else node["oneOf"]
            plain = [_plain(schema, b) for b in branches]
            node = next((b for b in plain if ("properties" in b) == isinstance(data, dict)), {})
            continue
        inside = dict(enumerate(data)) if isinstance(data, list) else data
        if not isinstance(inside, dict) or part not in inside:
            break
        data = inside[part]
        path.append(part)
        by_pattern: _Schema = next(iter(node.get("patternProperties", {}).values()), {})
        below = node.get("properties", {}).get(part) or node.get("items") or by_pattern
        node = _plain(schema, below)
    return tuple(path), node


def _plain(schema: _Schema, node: Any) -> _Schema:
    """Resolve references, and the choice between a schema and null."""
    while isinstance(node, dict) and ("$ref" in node or "anyOf" in node):
        if "anyOf" in node:
            node = next(n for n in node["anyOf"] if n.get("type") != "null")
        else:
            node = schema["$defs"][node["$ref"].rsplit("/", 1)[-1]]
    return node if isinstance(node, dict) else {}


def _choices(node: _Schema) -> list[str]:
    return list(node.get("discriminator", {}).get("mapping", {}))


def _not_one_of(name: str, read: str, choices: list[str]) -> str:
    near = did_you_mean(read, choices, after="; ")
    return f"{name}: {read!r} is not one of {', '.join(choices)}{near}"


def _why_broken(kind: str) -> str:
    try:
        NODE_KINDS.find(kind)
    except UsageError as exc:
        return str(exc)
    return ""

"""Validates a YAML file against a schema: reports all problems, each with its line and a hint."""

from __future__ import annotations

import difflib
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from rsenf.config.node_kind import NODE_KINDS
from rsenf.config.secrets import is_secret, redact
from rsenf.config.yaml_lines import KeyPath, YamlText
from rsenf.errors import ConfigError, UsageError

Model = TypeVar("Model", bound=BaseModel)
_Schema = dict[str, Any]

_UNKNOWN = ("extra_forbidden", "unexpected_keyword_argument")
_MISSING = ("missing", "missing_argument")


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
        text = f"{above + ': ' if above else ''}unknown key {last!r}{_nearest(last, allowed)}"
        text += f"; allowed: {', '.join(allowed)}"
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
    return f"{name}: {read!r} is not one of {', '.join(choices)}{_nearest(read, choices)}"


def _why_broken(kind: str) -> str:
    try:
        NODE_KINDS.find(kind)
    except UsageError as exc:
        return str(exc)
    return ""


def _nearest(word: str, choices: list[str]) -> str:
    close = difflib.get_close_matches(word, choices, n=1, cutoff=0.5)
    return f"; did you mean {close[0]!r}?" if close else ""

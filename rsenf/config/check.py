"""A YAML file against a schema: every problem at once, each with its line and a way out."""

from __future__ import annotations

import difflib
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from rsenf.config.secrets import redact
from rsenf.config.yaml_lines import KeyPath, YamlText
from rsenf.errors import ConfigError

Model = TypeVar("Model", bound=BaseModel)


def check(document: YamlText, model: type[Model]) -> Model:
    """Validate a document.

    Raises
    ------
    ConfigError
        With one line for each problem.
    """
    if not isinstance(document.data, dict):
        raise ConfigError([f"{document.path}:1: not a mapping of keys to values"])
    try:
        return model.model_validate(document.data)
    except ValidationError as exc:
        schema = model.model_json_schema()
        raise ConfigError([_line(document, schema, error) for error in exc.errors()]) from exc


def _line(document: YamlText, schema: dict[str, Any], error: ErrorDetails) -> str:
    path = _path_in_yaml(document.data, error["loc"])
    name = ".".join(str(p) for p in path) or "file"
    kind, context = error["type"], error.get("ctx", {})
    if kind in ("extra_forbidden", "unexpected_keyword_argument"):
        unknown, allowed = str(path[-1]), _allowed(schema, error["loc"][:-1])
        text = f"unknown key {unknown!r}{_nearest(unknown, allowed)}; allowed: {', '.join(allowed)}"
    elif kind in ("missing", "missing_argument"):
        text = f"{name}: key {str(error['loc'][-1])!r} is missing"
    elif kind in ("literal_error", "union_tag_invalid"):
        choices = str(context.get("expected", context.get("expected_tags", "")))
        read = str(context.get("tag", error["input"]))
        words = [w.strip(" '\"") for w in choices.replace(" or ", ",").split(",")]
        text = f"{name}: {read!r} is not one of {choices}{_nearest(read, words)}"
    elif kind == "union_tag_not_found":
        text = f"{name}: key 'kind' is missing"
    else:
        reason = error["msg"].removeprefix("Value error, ")
        shown = "" if isinstance(error["input"], dict) else f" (read: {error['input']!r})"
        text = f"{name}: {reason}{shown}"
    return redact(f"{document.place(path)}: {text}")


def _path_in_yaml(data: Any, loc: tuple[int | str, ...]) -> KeyPath:
    """Return the part of pydantic's location that names keys of the file, not kinds of a union."""
    path: list[int | str] = []
    for part in loc:
        inside = dict(enumerate(data)) if isinstance(data, list) else data
        if isinstance(inside, dict) and part in inside:
            data = inside[part]
            path.append(part)
    return tuple(path)


def _allowed(schema: dict[str, Any], loc: tuple[int | str, ...]) -> list[str]:
    """Keys that the schema allows at a location."""
    node = schema
    for part in loc:
        node = _resolve(schema, node)
        mapping = node.get("discriminator", {}).get("mapping", {})
        if part in mapping:
            node = {"$ref": mapping[part]}
        elif part in node.get("properties", {}):
            node = node["properties"][part]
        else:
            node = node.get("additionalProperties") or node.get("items") or node
    return sorted(_resolve(schema, node).get("properties", {}))


def _resolve(schema: dict[str, Any], node: dict[str, Any]) -> dict[str, Any]:
    while "$ref" in node or "anyOf" in node:
        if "anyOf" in node:
            node = next((n for n in node["anyOf"] if n.get("type") != "null"), {})
        else:
            node = schema["$defs"][node["$ref"].rsplit("/", 1)[-1]]
    return node


def _nearest(word: str, choices: list[str]) -> str:
    close = difflib.get_close_matches(word, choices, n=1, cutoff=0.5)
    return f"; did you mean {close[0]!r}?" if close else ""

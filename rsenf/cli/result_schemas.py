"""JSON Schemas of the output of verbs with ``--json`` and of a report, generated from types."""

from __future__ import annotations

import typing
from typing import Any

JSON_SCHEMA = "https://json-schema.org/draft/2020-12/schema"


def result_schemas() -> dict[str, dict[str, Any]]:
    """Return the schemas by name. They allow further keys, since results may be extended."""
    from pydantic import TypeAdapter

    from rsenf.api.against import AgainstResult, TogetherResult
    from rsenf.api.idle import IdleComparison, IdleResult
    from rsenf.api.shared import json_fields
    from rsenf.api.track import EstimateJson, TrackResult
    from rsenf.api.verify import VerifyResult
    from rsenf.report.recording_time.document import Document

    documents = {
        "verify": ("rsenf verify --json", VerifyResult),
        "verify-against": ("rsenf verify --against --json", AgainstResult),
        "verify-together": ("rsenf verify --against --against --json", TogetherResult),
        "idle": ("rsenf idle --json", IdleResult),
        "idle-compared": ("rsenf idle A B --json", IdleComparison),
    }
    schemas = {}
    for name, (title, result) in documents.items():
        hints = typing.get_type_hints(result)
        schemas[name] = _schema(title, {f.name: hints[f.name] for f in json_fields(result)}, result)
    line = typing.get_type_hints(EstimateJson)
    schemas["track"] = _schema("a line of rsenf track --json", line, TrackResult)
    schemas["report"] = {"$schema": JSON_SCHEMA, **TypeAdapter(Document).json_schema()}
    return schemas


def _schema(title: str, hints: dict[str, Any], described_by: type) -> dict[str, Any]:
    """Return a schema of keys with their types, and the descriptions of a class's docstring."""
    from pydantic import BaseModel, Field, create_model

    from rsenf.cli.options import field_docs

    docs = field_docs(described_by, "Attributes")
    fields: dict[str, Any] = {
        name: (hint, Field(description=docs.get(name) or None)) for name, hint in hints.items()
    }
    model: type[BaseModel] = create_model(title, **fields)
    return {"$schema": JSON_SCHEMA, **model.model_json_schema()}

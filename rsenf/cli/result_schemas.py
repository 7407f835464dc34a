"""JSON Schemas of what the verbs print with ``--json``, out of the results' own fields."""

from __future__ import annotations

import typing
from typing import Any

JSON_SCHEMA = "https://json-schema.org/draft/2020-12/schema"


def result_schemas() -> dict[str, dict[str, Any]]:
    """Return the schemas by name. Keys may be added to a result, so others are allowed."""
    from pydantic import TypeAdapter

    from rsenf.api.idle import IdleComparison, IdleResult
    from rsenf.api.track import EstimateJson
    from rsenf.api.verify import AgainstResult, VerifyResult

    line = TypeAdapter(EstimateJson).json_schema()
    return {
        "verify": _schema_of("rsenf verify --json", VerifyResult),
        "verify-against": _schema_of("rsenf verify --against --json", AgainstResult),
        "idle": _schema_of("rsenf idle --json", IdleResult),
        "idle-compared": _schema_of("rsenf idle A B --json", IdleComparison),
        "track": {"$schema": JSON_SCHEMA, **line, "title": "a line of rsenf track --json"},
    }


def _schema_of(title: str, result: Any) -> dict[str, Any]:
    from pydantic import BaseModel, Field, create_model

    from rsenf.api.shared import json_fields
    from rsenf.cli.options import field_docs

    hints, docs = typing.get_type_hints(result), field_docs(result, "Attributes")
    fields: dict[str, Any] = {
        f.name: (hints[f.name], Field(description=docs.get(f.name) or None))
        for f in json_fields(result)
    }
    model: type[BaseModel] = create_model(title, **fields)
    return {"$schema": JSON_SCHEMA, **model.model_json_schema()}

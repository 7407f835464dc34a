"""The columns of a table of messages: one line a message, names and units as in its schema."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pyarrow as pa

from rsenf.messages import Header, schema_name
from rsenf.messages.schema import FieldSpec, field_specs, message_classes

_TYPES = {
    "int64": pa.int64(),
    "double": pa.float64(),
    "string": pa.string(),
    "bool": pa.bool_(),
    "float": pa.float32(),
    "sfixed64": pa.int64(),
    "fixed32": pa.uint32(),
}
# What stands before the fields of the header and of the message. The schema goes with its version.
_ABOUT = [("topic", pa.string()), ("schema", pa.string()), ("log_time_ns", pa.int64())]


class Columns:
    """Columns of the messages of one class: all fields but pictures, the header's among them.

    A list stays a list. NaN, which is "unknown" in a message, becomes null.

    Parameters
    ----------
    topic : str
        Topic that they come from.
    cls : type
        Their class.
    """

    def __init__(self, topic: str, cls: type[Any]) -> None:
        self._topic = topic
        self._schema = f"{schema_name(cls)}/{cls.VERSION}"
        self._fields = [spec for spec in field_specs(cls) if _is_column(spec)]
        described = [*field_specs(Header), *self._fields]
        self.schema = pa.schema([*_ABOUT, *((spec.name, _type(spec)) for spec in described)])

    def lines(self, message: Any, log_time_ns: int) -> list[dict[str, Any]]:
        """Return the one line of a message, by column."""
        line = self.about(message.header, log_time_ns)
        line.update((spec.name, _value(getattr(message, spec.name))) for spec in self._fields)
        return [line]

    def about(self, header: Header, log_time_ns: int) -> dict[str, Any]:
        """Return what stands before a message's own fields."""
        about = {"topic": self._topic, "schema": self._schema, "log_time_ns": log_time_ns}
        return about | {spec.name: getattr(header, spec.name) for spec in field_specs(Header)}


def _is_column(spec: FieldSpec) -> bool:
    return spec.wire not in ("bytes", "Header")


def _type(spec: FieldSpec) -> Any:
    inner = message_classes().get(spec.wire)
    kind = _TYPES[spec.wire] if inner is None else pa.struct(
        [(s.name, _type(s)) for s in field_specs(inner)]
    )  # fmt: skip
    return kind if spec.kind == "scalar" else pa.list_(kind)


def _value(value: Any) -> Any:
    """Value as Arrow takes it."""
    if isinstance(value, float):
        return None if math.isnan(value) else value
    if isinstance(value, np.ndarray):
        return _value(tuple(value.ravel().tolist()))
    if isinstance(value, tuple):
        return [_value(one) for one in value]
    if hasattr(value, "VERSION"):
        return {spec.name: _value(getattr(value, spec.name)) for spec in field_specs(type(value))}
    return value

"""A message as plain data, for JSON."""

from __future__ import annotations

import math
from typing import Any

from rsenf.messages.schema import field_specs


def plain(message: Any, longest: int | None = None) -> dict[str, Any]:
    """Return a message's fields as JSON data.

    Times in ns become text (JSON has no exact 64-bit integers), NaN and infinity None, bytes their
    length, and arrays flat lists.

    Parameters
    ----------
    message : object
        Any message.
    longest : int, optional
        Longer arrays are replaced by their length, in words.
    """
    specs = field_specs(type(message))
    return {spec.name: _plain(spec.name, getattr(message, spec.name), longest) for spec in specs}


def _plain(name: str, value: Any, longest: int | None) -> Any:
    if hasattr(value, "VERSION"):
        return plain(value, longest)
    if isinstance(value, bytes):
        return len(value)
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, int) and name.endswith("_ns"):
        return str(value)
    if hasattr(value, "tolist"):
        value = value.ravel().tolist()
    if not isinstance(value, list | tuple):
        return value
    if longest is not None and len(value) > longest:
        return f"{len(value)} values"
    return [_plain(name, one, longest) for one in value]

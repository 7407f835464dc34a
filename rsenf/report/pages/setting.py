"""A parameter's value, for a person."""

from __future__ import annotations

from typing import Any


def setting(value: Any) -> str:
    """Write a parameter's value."""
    if value is None or value == "":
        return "not set"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list | tuple):
        return ", ".join(map(setting, value)) or "not set"
    return f"{value:g}" if isinstance(value, float) else str(value)

"""Text of a parameter's value."""

from __future__ import annotations

from typing import Any


def setting(value: Any) -> str:
    """Return a parameter's value as text.

    >>> setting((0.5, None, True))
    '0.5, not set, yes'
    """
    if value is None or value == "":
        return "not set"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list | tuple):
        return ", ".join(map(setting, value)) or "not set"
    return f"{value:g}" if isinstance(value, float) else str(value)

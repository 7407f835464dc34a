"""Redacts credentials in everything that is printed, logged, recorded or shown."""

from __future__ import annotations

import re
from typing import Any

from rsenf.decode.source import redact as redact_addresses

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

    Examples
    --------
    >>> hide({"user": "ann", "password": "hunter2"})
    {'user': 'ann', 'password': '***'}
    """
    if isinstance(value, dict):
        return {k: "***" if is_secret(str(k)) and v else hide(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [hide(v) for v in value]
    return redact(value) if isinstance(value, str) else value

"""Nothing that is printed, logged, recorded or shown may carry a password."""

from __future__ import annotations

import re
from typing import Any

from rsenf.decode.spec import redact as redact_addresses

_SECRET = r"password|passwd|passphrase|secret|token|private_key"
_SECRET_KEY = re.compile(_SECRET, re.IGNORECASE)
# A key that sounds like a secret, in YAML, JSON or prose, and what is written after it.
_PAIR = re.compile(
    rf"""([\w./-]*(?:{_SECRET})[\w./-]*["']?\s*[:=]\s*)("[^"]*"|'[^']*'|[^\s,}}\]]+)""",
    re.IGNORECASE,
)


def is_secret(key: str) -> bool:
    """Whether what a key holds is not to be shown."""
    return _SECRET_KEY.search(key) is not None


def redact(text: str) -> str:
    """Hide credentials in addresses, and the values of keys that sound like secrets.

    For lines of text. What is still structured goes through :func:`hide`, which can't miss.

    Examples
    --------
    >>> redact("rtsp://admin:hunter2@10.0.0.7/cam")
    'rtsp://***@10.0.0.7/cam'
    """
    return _PAIR.sub(r"\1'***'", redact_addresses(text))


def hide(value: Any) -> Any:
    """Return plain data (dicts, lists, scalars) with its secrets replaced by ``***``."""
    if isinstance(value, dict):
        return {k: "***" if is_secret(str(k)) and v else hide(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [hide(v) for v in value]
    return redact(value) if isinstance(value, str) else value

"""Nothing that is printed, logged, recorded or shown may carry a password."""

from __future__ import annotations

import re

_IN_URL = re.compile(r"(?<=://)[^/@\s'\"]+@")
_IN_YAML = re.compile(
    r"(?im)^(\s*[\w/-]*(?:password|secret|token|passphrase)[\w/-]*\s*:\s*)(\S.*)$"
)


def redact(text: str) -> str:
    """Hide credentials in URLs, and the values of keys that sound like secrets.

    Examples
    --------
    >>> redact("rtsp://admin:hunter2@10.0.0.7/cam")
    'rtsp://***@10.0.0.7/cam'
    """
    return _IN_YAML.sub(r"\1'***'", _IN_URL.sub("***@", text))

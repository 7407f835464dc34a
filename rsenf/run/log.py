"""Structured logging to stderr: one JSON object per event, for log collectors.

Enabled by ``rsenf run --log json``, or RSENF_LOG=json in the environment, which the nodes of a run
inherit. Otherwise messages are plain text.
"""

from __future__ import annotations

import json
import os
import sys
from datetime import UTC, datetime

from rsenf.config import redact

ASKED = "RSENF_LOG"


def ask_for(form: str) -> None:
    """Choose the log format of this process and its children; ``auto`` leaves it unchanged."""
    if form != "auto":
        os.environ[ASKED] = form


def is_json() -> bool:
    """Whether structured logging is enabled."""
    return os.environ.get(ASKED, "") == "json"


def line(level: str, message: str, *, node: str = "", camera: str = "") -> str:
    """Return an event as a line of JSON, with credentials redacted.

    Parameters
    ----------
    level : str
        ``info``, ``warning`` or ``error``.
    message : str
        What happened.
    node, camera : str
        Node and camera of the event (several cameras separated by commas); empty for the run.
    """
    now = datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
    event = {"time": now, "level": level, "node": node, "camera": camera, "message": message}
    return json.dumps({key: redact(value) for key, value in event.items()}, ensure_ascii=False)


def complain(text: str, message: str, *, node: str = "") -> None:
    """Report an error on stderr.

    Parameters
    ----------
    text : str
        Printed, unless structured logging is enabled.
    message : str
        Logged if it is.
    node : str
        Name of the node, for the structured log.
    """
    words = line("error", message, node=node) if is_json() else redact(text)
    print(words, file=sys.stderr, flush=True)

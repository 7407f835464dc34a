"""Words on stderr as structured lines: one JSON object an event, for whoever collects logs.

Asked for by ``rsenf run --log json``, or RSENF_LOG=json in the environment, which the nodes of a
run inherit. Without, the words stay as a person reads them.
"""

from __future__ import annotations

import json
import os
import sys
from datetime import UTC, datetime

from rsenf.config import redact

ASKED = "RSENF_LOG"


def ask_for(form: str) -> None:
    """Choose the form, for this process and those that it starts; ``auto`` leaves it as it is."""
    if form != "auto":
        os.environ[ASKED] = form


def is_json() -> bool:
    """Whether structured lines are asked for."""
    return os.environ.get(ASKED, "") == "json"


def line(level: str, message: str, *, node: str = "", camera: str = "") -> str:
    """Return an event as a line of JSON, with its secrets hidden.

    Parameters
    ----------
    level : str
        ``info``, ``warning`` or ``error``.
    message : str
        What happened.
    node, camera : str
        Whose it is; several cameras with commas between; empty for the run's own.
    """
    now = datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
    event = {"time": now, "level": level, "node": node, "camera": camera, "message": message}
    return json.dumps({key: redact(value) for key, value in event.items()}, ensure_ascii=False)


def complain(text: str, message: str, *, node: str = "") -> None:
    """Tell an error on stderr: as words for a person, or as an event where that is asked for."""
    words = line("error", message, node=node) if is_json() else redact(text)
    print(words, file=sys.stderr, flush=True)

"""Whom a router refuses, and what: one line each, of what Zenoh has in its log.

Zenoh tells it nowhere else, and its log goes to the standard output: that is led through a pipe
for as long as the router runs, while what this process prints goes where it always did.
"""

from __future__ import annotations

import os
import re
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import zenoh

LOG_FILTER = "error,zenoh_link_tls=warn,zenoh::net::routing::interceptor::access_control=trace"
_COLOURS = re.compile(r"\x1b\[[0-9;]*m")
_FORBIDDEN = re.compile(
    r"CertCommonName\((?P<who>[^)]*)\).* is unauthorized to (?P<what>[\w/ ]+) "
    r"\(ingress\) on (?P<key>\S*/\S+)"
)
_NO_CERTIFICATE = "peer sent no certificates"
_WRONG = re.compile(r"invalid peer certificate: (\w+)")
# Whoever is refused tries again and again: the same is told once in this time.
QUIET_S = 60.0
MOST_TOLD = 1000


def refusal(line: str) -> str:
    """Say in words whom a line of Zenoh's log refuses; empty when nobody."""
    line = _COLOURS.sub("", line)
    if found := _FORBIDDEN.search(line):
        return f"refused: {found['who']} may not {found['what'].lower()} {found['key']}"
    if _NO_CERTIFICATE in line:
        return "refused: somebody without a certificate"
    if found := _WRONG.search(line):
        return f"refused: somebody with a wrong certificate ({found[1]})"
    return ""


class Refusals:
    """Tells each refusal once a minute."""

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say = say
        self._told: dict[str, float] = {}

    def take(self, line: str) -> None:
        """Take a line of Zenoh's log."""
        text, now_s = refusal(line), time.monotonic()
        if not text or now_s - self._told.get(text, -QUIET_S) < QUIET_S:
            return
        if len(self._told) >= MOST_TOLD:
            self._told.clear()
        self._told[text] = now_s
        self._say(text)


@contextmanager
def telling_refusals(say: Callable[[str], None]) -> Iterator[None]:
    """Tell what the router of this process refuses, for the duration of a ``with`` block."""
    sys.stdout.flush()
    shown, (reading, writing) = os.dup(1), os.pipe()
    os.dup2(writing, 1)
    os.close(writing)
    before, sys.stdout = sys.stdout, os.fdopen(shown, "w", encoding="utf-8", buffering=1)
    refusals = Refusals(say)

    def read() -> None:
        with os.fdopen(reading, encoding="utf-8", errors="replace") as lines:
            for line in lines:
                refusals.take(line)

    threading.Thread(target=read, name="refusals", daemon=True).start()
    zenoh.init_log_from_env_or(LOG_FILTER)
    try:
        yield
    finally:
        sys.stdout.flush()
        os.dup2(shown, 1)
        sys.stdout = before

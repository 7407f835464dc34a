"""Reports refused connections and messages of the Zenoh router, one line each, from Zenoh's log.

Zenoh reports them nowhere else, and its log goes to standard output. So file descriptor 1 is
replaced by a pipe while the router runs; ``sys.stdout`` of this process keeps its target.
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

LOG_FILTER = "error,zenoh_link_tls=warn,zenoh::net::routing::interceptor=trace"
_COLOURS = re.compile(r"\x1b\[[0-9;]*m")
_NAMED = re.compile(r"(?P<zid>[0-9a-f]+) on \S*CertCommonName\((?P<who>[^)]*)\)")
# Zenoh logs for every key in advance what would be forbidden; it counts once a message is stopped.
_FORBIDDEN = re.compile(
    r"(?P<thread>ThreadId\(\d+\)).*: (?P<zid>[0-9a-f]+) .*is unauthorized to "
    r"(?P<what>[\w/ ]+) \(ingress\) on (?P<key>\S+)"
)
_HELD_UP = re.compile(r"(?P<thread>ThreadId\(\d+\)).*Msg intercepted!")
_NO_CERTIFICATE = "peer sent no certificates"
_WRONG = re.compile(r"invalid peer certificate: (\w+)")
# A refused client tries again and again: the same refusal is reported once in this time.
QUIET_S = 60.0
MOST_TOLD = 1000


class Refusals:
    """Parses Zenoh's log and reports each refusal, at most once a minute.

    Parameters
    ----------
    say : callable
        Called with one line of text for each.
    """

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say = say
        self._told: dict[str, float] = {}
        self._names: dict[str, str] = {}  # common name of the certificate, by session
        self._forbidden: dict[str, str] = {}  # last rule violated, by Zenoh thread

    def take(self, line: str) -> None:
        """Take a line of Zenoh's log."""
        text, now_s = self._refusal(_COLOURS.sub("", line)), time.monotonic()
        if not text or now_s - self._told.get(text, -QUIET_S) < QUIET_S:
            return
        if len(self._told) >= MOST_TOLD:
            self._told.clear()
        self._told[text] = now_s
        self._say(f"refused: {text}")

    def _refusal(self, line: str) -> str:
        """Return the refusal that a log line reports, in words; empty for none."""
        if found := _NAMED.search(line):
            if len(self._names) >= MOST_TOLD:
                self._names.clear()
            self._names[found["zid"]] = found["who"]
        if found := _FORBIDDEN.search(line):
            who = self._names.get(found["zid"], found["zid"])
            self._forbidden[found["thread"]] = (
                f"{who} may not {found['what'].lower()} {found['key']}"
            )
        elif found := _HELD_UP.search(line):
            return self._forbidden.pop(found["thread"], "")
        elif _NO_CERTIFICATE in line:
            return "somebody without a certificate"
        elif found := _WRONG.search(line):
            return f"somebody with a wrong certificate ({found[1]})"
        return ""


@contextmanager
def telling_refusals(say: Callable[[str], None]) -> Iterator[None]:
    """Report what the router of this process refuses, for the duration of a ``with`` block."""
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

"""Access control between hosts: mutual TLS, and the access rules of each Zenoh router.

The common name of the client certificate identifies the sender. A host of the graph uses its host
name and may send only what its nodes send. Any other certificate holder may listen, and may send
what ``access`` in the graph allows. The nodes of a host reach its router over loopback, without
restrictions.

Refused connections and messages are reported, one line each, from Zenoh's log: Zenoh reports them
nowhere else. The log goes to standard output, so file descriptor 1 is replaced by a pipe while the
router runs; ``sys.stdout`` of this process keeps its target.
"""

from __future__ import annotations

import os
import re
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import zenoh

from rsenf.bus.keys import NODES, ROOT, alive_key, health_key, topic_key, word_key
from rsenf.bus.zenoh_bus import ECHO_KEY
from rsenf.config import Graph
from rsenf.config.graph import TlsConfig
from rsenf.errors import UsageError

# Zenoh's wildcards don't match chunks that begin with '@'.
ALL_KEYS = ["**", f"{ROOT}/*/{NODES}/**", ECHO_KEY]
SENDING = ["put", "delete", "declare_queryable", "reply", "liveliness_token"]
HEARING = ["declare_subscriber", "query", "declare_liveliness_subscriber", "liveliness_query"]
BOTH_WAYS = ["ingress", "egress"]


def secured(graph: Graph, host: str) -> dict[str, Any]:
    """Return the TLS and access settings of a host's router, by Zenoh path; {} without TLS.

    Parameters
    ----------
    graph : Graph
    host : str
        Name of the host in the graph.

    Raises
    ------
    UsageError
        When a certificate or key file doesn't exist.
    """
    if graph.tls is None:
        return {}
    return {**certificates(graph.tls, host), "access_control": _rules(graph, host)}


def certificates(tls: TlsConfig, name: str) -> dict[str, Any]:
    """Return the Zenoh TLS settings, by path, of a client or router with a certificate.

    Parameters
    ----------
    tls : TlsConfig
        File names, in which ``{host}`` stands for the name.
    name : str
        Common name of the certificate.

    Raises
    ------
    UsageError
        When a certificate or key file doesn't exist.
    """
    ca, certificate, key = (p.replace("{host}", name) for p in (tls.ca, tls.certificate, tls.key))
    for path in (ca, certificate, key):
        if not Path(path).is_file():
            raise UsageError(f"{path}: no such file", "make it, or correct 'tls' in the graph")
    links = {
        "root_ca_certificate": ca,
        "enable_mtls": True,
        "listen_certificate": certificate,
        "listen_private_key": key,
        "connect_certificate": certificate,
        "connect_private_key": key,
    }
    return {"transport/link/tls": links}


def _rules(graph: Graph, host: str) -> dict[str, Any]:
    rules = [
        _rule("all", [*SENDING, *HEARING], BOTH_WAYS, ALL_KEYS),
        _rule("hear", HEARING, ["ingress"], ALL_KEYS),
        _rule("be sent", [*SENDING, *HEARING], ["egress"], ALL_KEYS),
    ]
    subjects = [{"id": "nodes", "interfaces": ["lo"], "link_protocols": ["tcp"]}]
    policies = [{"rules": ["all"], "subjects": ["nodes"]}]
    for name in dict.fromkeys((*graph.hosts, *graph.access)):
        keys = sent_by(graph, host, name)
        may = ["hear", "be sent"]
        if keys:
            rules.append(_rule(f"send as {name}", SENDING, ["ingress"], keys))
            may.append(f"send as {name}")
        subjects.append({"id": name, "cert_common_names": [name]})
        policies.append({"rules": may, "subjects": [name]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }


def _rule(name: str, messages: list[str], flows: list[str], keys: list[str]) -> dict[str, Any]:
    return {
        "id": name,
        "permission": "allow",
        "messages": messages,
        "flows": flows,
        "key_exprs": keys,
    }


def sent_by(graph: Graph, host: str, name: str) -> list[str]:
    """Return the keys that a router accepts from a peer: the peer's own, and those it forwards.

    Parameters
    ----------
    graph : Graph
        The graph.
    host : str
        Host whose router it is.
    name : str
        The peer: another host, or any other common name of a certificate.
    """
    site, keys = graph.site, []
    for other in sorted(_behind(graph, host, name)):
        keys.append(ECHO_KEY)
        for node in graph.hosts[other].nodes:
            keys += [topic_key(site, of, topic) for topic, of in graph.nodes[node].outputs()]
            keys += [key(site, node) for key in (health_key, word_key, alive_key)]
    # A peer that is no host may connect to any host, which forwards what it sends.
    others = graph.access if name in graph.hosts else {name}
    for other in others:
        access = graph.access.get(other)
        keys += [f"{ROOT}/{site}/{below}" for below in access.publish] if access else []
    return list(dict.fromkeys(keys))


def _behind(graph: Graph, host: str, name: str) -> set[str]:
    """Return the hosts whose messages arrive through a host: itself, and those linked behind it."""
    pairs = [
        {a, b} for a, config in graph.hosts.items() for b in config.links if host not in (a, b)
    ]
    behind, before = {name} & set(graph.hosts), set[str]()
    while behind != before:
        before = set(behind)
        behind = behind.union(*(pair for pair in pairs if pair & behind))
    return behind


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
MOST_LOGGED = 1000


class Refusals:
    """Parses Zenoh's log and reports each refusal, at most once a minute.

    Parameters
    ----------
    say : callable
        Called with one line of text for each.
    """

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say = say
        self._last_logged_s: dict[str, float] = {}
        self._names: dict[str, str] = {}  # common name of the certificate, by session
        self._forbidden: dict[str, str] = {}  # last rule violated, by Zenoh thread

    def take(self, line: str) -> None:
        """Take a line of Zenoh's log."""
        text, now_s = self._refusal(_COLOURS.sub("", line)), time.monotonic()
        if not text or now_s - self._last_logged_s.get(text, -QUIET_S) < QUIET_S:
            return
        if len(self._last_logged_s) >= MOST_LOGGED:
            self._last_logged_s.clear()
        self._last_logged_s[text] = now_s
        self._say(f"refused: {text}")

    def _refusal(self, line: str) -> str:
        """Return the refusal that a log line reports, in words; empty for none."""
        if found := _NAMED.search(line):
            if len(self._names) >= MOST_LOGGED:
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

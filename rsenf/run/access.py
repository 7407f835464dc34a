"""Access control between hosts: mutual TLS, and the access rules of each Zenoh router.

The common name of the client certificate identifies the sender. A host of the graph uses its host
name and may send only what its nodes send. Any other certificate holder may listen, and may send
what ``access`` in the graph allows. The nodes of a host reach its router over loopback, without
restrictions.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rsenf.bus.keys import NODES, ROOT, alive_key, health_key, topic_key
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
            keys += [health_key(site, node), alive_key(site, node)]
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

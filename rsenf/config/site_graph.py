"""Writes a graph file: the nodes that watch a site's cameras, from their addresses.

What a node is stays where it is declared, in its kind: this names the nodes and wires them. Each
kind's line of comment is the first of its docstring.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

import yaml

from rsenf.bus.keys import NAME_RULE, is_name
from rsenf.config.check import hide
from rsenf.config.node_kind import NODE_KINDS
from rsenf.decode.source import kind_of, redact
from rsenf.errors import UsageError

TRUSTED = "trusted"  # name of a camera that is the reference
GRID = "mains"
MQTT_PASSWORD = "MQTT_PASSWORD"
TARGETS = "https://…, mqtt://HOST, mailto:TO?from=SENDER&host=SERVER, or a program"
Nodes = dict[str, dict[str, Any]]
# The reference's forms that aren't files.
_MEASURED = ("sound:", "topic:", "store:", "camera:")


def site_nodes(
    cameras: Mapping[str, str],
    reference: str | None,
    settings: Mapping[str, Mapping[str, Any]] | None = None,
    cores: int = 1,
) -> Nodes:
    """Return the nodes that judge whether cameras are live, as in a graph file.

    Parameters
    ----------
    cameras : mapping
        Address by name.
    reference : str or None
        As the node ``reference`` takes it, or the address of a camera that can be trusted. None:
        the first camera is judged by the second, the others by the first; one alone isn't judged.
    settings : mapping, optional
        Further settings by node kind.
    cores : int, optional
        Over which the tracking of more than two cameras is spread: a node for each.

    Examples
    --------
    >>> list(site_nodes({"door": "rtsp://10.0.0.7/1", "yard": "rtsp://10.0.0.8/1"}, "grid.csv"))
    ['door', 'yard', 'track', 'mains', 'live']
    """
    more = settings or {}
    filmed = dict(cameras)
    if reference and kind_of(reference) != "file":
        filmed[TRUSTED], reference = reference, f"camera:{TRUSTED}"
    nodes: Nodes = {}

    def add(name: str, kind: str, **given: Any) -> None:
        nodes[name] = {"kind": kind, **given, **more.get(kind, {})}

    for name, url in filmed.items():
        add(name, "decode", camera=name, input=url, frames="fused", threads=1, wait_for_source=True)
    parts = min(cores, len(filmed)) if len(filmed) > 2 else 1
    for part in range(parts):
        name = f"track-{part + 1}" if parts > 1 else "track"
        add(name, "track", cameras=list(filmed)[part::parts], idle={})
    if reference:
        grows = not reference.startswith(_MEASURED) and Path(reference).suffix != ".parquet"
        add(GRID, "reference", grid=GRID, input=reference, **({"follow": True} if grows else {}))
        add("live", "live", cameras=list(cameras), grid=GRID)
    elif len(cameras) > 1:
        first, second, *_ = cameras
        for name in (first, second):
            add(f"by-{name}", "reference", grid=name, input=f"camera:{name}")
        add(f"live-{first}", "live", cameras=[first], grid=second)
        add("live", "live", cameras=[name for name in cameras if name != first], grid=first)
    return nodes


def check_names(names: Sequence[str]) -> None:
    """Raise UsageError unless each camera can have its name: no other node has it.

    Parameters
    ----------
    names : sequence of str
        Of all cameras.
    """
    others = {TRUSTED, GRID, "track", "live", "record", "notify", "dashboard"}
    others |= {f"{before}-{name}" for before in ("by", "live") for name in names}
    others |= {f"track-{number}" for number in range(1, len(names) + 2)}
    for number, name in enumerate(names):
        if not is_name(name):
            raise UsageError(f"a camera can't be called {name!r}", NAME_RULE)
        if name in others:
            raise UsageError(f"a camera can't be called {name!r}", "another node has that name")
        if name in names[:number]:
            raise UsageError(f"two cameras have one name, {name}", "give each its own")


def check_reference(reference: str | None) -> None:
    """Raise UsageError for a reference that is a file, and isn't there."""
    is_file = reference and kind_of(reference) == "file" and not reference.startswith(_MEASURED)
    if reference and is_file and not Path(reference).is_file():
        raise UsageError(f"no reference {reference}: no such file", "make it first, if it grows")


def keeping(archive: str, to: Sequence[Mapping[str, Any]] = (), *, page: bool) -> Nodes:
    """Return the nodes that keep the minutes around alarms, tell people, and show all on a page.

    Parameters
    ----------
    archive : str
        Folder.
    to : sequence of mapping, optional
        Who is told, as :func:`target_of` returns them.
    page : bool
        Whether there is a page.
    """
    nodes: Nodes = {"record": {"kind": "record", "archive": archive, "alarms": {"only": True}}}
    if to:
        nodes["notify"] = {"kind": "notify", "queue": "notify.sqlite", "to": [*to]}
    return {**nodes, **({"dashboard": {"kind": "dashboard"}} if page else {})}


def target_of(target: str) -> dict[str, Any]:
    """Return who is told of alarms, as the node ``notify`` has it.

    Parameters
    ----------
    target : str
        The address of a webhook; ``mqtt://[USER@]HOST[:PORT]``, with the user's password in the
        variable MQTT_PASSWORD; ``mailto:TO?from=SENDER&host=SERVER``; or a program with its words.

    Raises
    ------
    UsageError
        When an address lacks something.

    Examples
    --------
    >>> target_of("mqtt://10.0.0.2:1884")
    {'via': 'mqtt', 'host': '10.0.0.2', 'port': 1884}
    >>> target_of("/usr/bin/beep -n")
    {'via': 'exec', 'command': ['/usr/bin/beep', '-n']}
    """
    try:
        parts = urlsplit(target)
        if parts.scheme in ("http", "https"):
            return {"via": "webhook", "url": target}
        if parts.scheme == "mqtt" and parts.hostname:
            port = {"port": parts.port} if parts.port else {}
            user = {"user": parts.username, "password_env": MQTT_PASSWORD} if parts.username else {}
            return {"via": "mqtt", "host": parts.hostname, **port, **user}
        if parts.scheme == "mailto" and parts.path:
            said = parse_qs(parts.query)
            to = parts.path.split(",")
            return {"via": "email", "to": to, "sender": said["from"][0], "host": said["host"][0]}
        words = shlex.split(target)
    except (KeyError, ValueError):
        words = []
    if not words or "://" in words[0] or words[0].startswith("mailto:"):
        raise UsageError(f"{redact(target)}: nobody can be told by this", TARGETS)
    return {"via": "exec", "command": words}


def graph_text(
    site: str, nodes: Nodes, heading: Collection[str] = (), *, restart: bool = True
) -> str:
    """Return a graph file, with a comment for each kind of node.

    Parameters
    ----------
    site : str
    nodes : dict
    heading : collection of str
        Lines of comment at the top.
    restart : bool, optional
        Whether nodes are started again.
    """
    lines = [*(f"# {line}".rstrip() for line in heading), "version: 1", f"site: {_flow(site)}"]
    lines += ["restart: {}   # a node that dies, or hangs, is started again"] if restart else []
    lines += ["nodes:"]
    width = max(map(len, nodes)) + 2
    before = ""
    for name, node in nodes.items():
        if node["kind"] != before:
            before = node["kind"]
            lines.append(f"  # {(NODE_KINDS.find(before).__doc__ or '').splitlines()[0]}")
        lines.append(f"  {name + ':':{width}}{_flow(node)}")
    return "\n".join(lines) + "\n"


def _flow(value: Any) -> str:
    text = yaml.safe_dump(
        value, default_flow_style=True, sort_keys=False, allow_unicode=True, width=10**6
    )
    return text.removesuffix("\n").removesuffix("\n...")


def without_passwords(nodes: Nodes) -> tuple[Nodes, dict[str, str]]:
    """Replace addresses that hold secrets by variables; return the nodes, and the variables.

    Parameters
    ----------
    nodes : dict
    """
    variables: dict[str, str] = {}

    def replaced(value: Any, name: str, key: str = "") -> Any:
        if isinstance(value, dict):
            return {key: replaced(part, name, key) for key, part in value.items()}
        if isinstance(value, list):
            return [replaced(part, name, key) for part in value]
        if not isinstance(value, str) or hide({key: value}) == {key: value}:
            return value
        variable = re.sub(r"\W", "_", f"URL_{len(variables) + 1}_{name}").upper()
        variables[variable] = value
        return f"${{{variable}}}"

    return {name: replaced(node, name) for name, node in nodes.items()}, variables

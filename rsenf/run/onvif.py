"""Finds ONVIF cameras on the local network by WS-Discovery, with the package ``wsdiscovery``.

They answer with the address of their device service, not with that of a stream: which one they send
is behind their password (ONVIF Core Specification, 7.3; OASIS WS-Discovery 1.0).
"""

from __future__ import annotations

import logging
import re
from collections.abc import Iterable
from typing import Any, NamedTuple
from urllib.parse import unquote, urlsplit

from rsenf.bus.keys import is_name
from rsenf.errors import UsageError

TRANSMITTER = "http://www.onvif.org/ver10/network/wsdl", "NetworkVideoTransmitter"
NAMED = "onvif://www.onvif.org/name/"
ANSWER_S = 4


class FoundCamera(NamedTuple):
    """A camera that has answered: a name that suits a graph, and its host."""

    name: str
    host: str


def find_cameras(timeout_s: int = ANSWER_S) -> list[FoundCamera]:
    """Ask all ONVIF cameras on the local network to answer.

    Parameters
    ----------
    timeout_s : int
        Time for their answers.

    Raises
    ------
    UsageError
        When the package isn't installed, or the network can't be asked.
    """
    try:
        from wsdiscovery import QName
        from wsdiscovery.discovery import ThreadedWSDiscovery
    except ImportError as exc:
        raise UsageError("wsdiscovery is not installed", "pip install 'rsenf[onvif]'") from exc
    logging.getLogger("threading").setLevel(logging.CRITICAL)  # it warns of every odd interface
    asking = ThreadedWSDiscovery()
    try:
        asking.start()
        answers = asking.searchServices(types=[QName(*TRANSMITTER)], timeout=timeout_s)
    except OSError as exc:
        raise UsageError(f"the network can't be asked: {exc.strerror}", "--camera NAME=…") from exc
    finally:
        asking.stop()
    return named_cameras(
        (urls, [str(scope) for scope in answer.getScopes()])
        for answer in answers
        if (urls := answer.getXAddrs())
    )


def named_cameras(answers: Iterable[tuple[list[str], list[Any]]]) -> list[FoundCamera]:
    """Return a camera for each host, in the order of the hosts.

    Parameters
    ----------
    answers : iterable
        Of each answer the addresses of its device service, and its scopes.

    Examples
    --------
    >>> named_cameras([(["http://10.0.0.7/onvif/device_service"], [NAMED + "Front%20door"])])
    [FoundCamera(name='Front-door', host='10.0.0.7')]
    """
    found: dict[str, str] = {}
    taken: set[str] = set()
    for urls, scopes in answers:
        host = urlsplit(urls[0]).hostname or ""
        said = next((s.removeprefix(NAMED) for s in scopes if s.startswith(NAMED)), "")
        name = re.sub(r"[^A-Za-z0-9_-]+", "-", unquote(said)).strip("-")[:32]
        name = name if is_name(name) else "camera"
        if host and host not in found:
            number = next(n for n in range(1, 10_000) if _numbered(name, n) not in taken)
            found[host] = _numbered(name, number)
            taken.add(found[host])
    return [FoundCamera(found[host], host) for host in sorted(found)]


def _numbered(name: str, number: int) -> str:
    return name if number == 1 else f"{name}-{number}"

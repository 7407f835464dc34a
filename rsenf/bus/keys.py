"""Keys on the bus: ``rsenf/<site>/<camera>/<topic>`` and ``rsenf/<site>/reference/<grid>``."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from rsenf.errors import UsageError
from rsenf.messages import (
    Alarm,
    DiscoveryVerdict,
    EnfEstimate,
    Frame,
    Health,
    IdleEstimate,
    Liveness,
    MatchResult,
    ReferenceBlock,
    RowBlock,
    VideoPacket,
)

ROOT = "rsenf"
REFERENCE = "reference"
NODES = "@nodes"

# Message class of each topic. 'video' carries compressed pictures, for recording.
TOPICS: dict[str, type[Any]] = {
    "frames": Frame,
    "video": VideoPacket,
    "rows": RowBlock,
    "track": EnfEstimate,
    "idle": IdleEstimate,
    "match": MatchResult,
    "live": Liveness,
    "alarm": Alarm,
    "discover": DiscoveryVerdict,
    REFERENCE: ReferenceBlock,
    "health": Health,
}

# With the topic that is neither read by stages nor recorded: health, sent to the other nodes.
CARRIED: dict[str, type[Any]] = {**TOPICS, "word": Health}

NAME_PATTERN = "[A-Za-z0-9][A-Za-z0-9_.-]*"
NAME_RULE = "letters, digits, '-', '_' and '.', beginning with a letter or digit"


def is_name(text: str) -> bool:
    """Whether a text is valid as a site, camera, grid or node: one key chunk, no wild cards.

    Examples
    --------
    >>> is_name("cam-1"), is_name("cam/1")
    (True, False)
    """
    return re.fullmatch(NAME_PATTERN, text) is not None


def camera_key(site: str, camera: str, topic: str) -> str:
    """Key of one topic of one camera.

    Examples
    --------
    >>> camera_key("lab", "cam1", "track")
    'rsenf/lab/cam1/track'
    """
    return f"{ROOT}/{site}/{camera}/{topic}"


def reference_key(site: str, grid: str) -> str:
    """Key of a grid's reference."""
    return f"{ROOT}/{site}/{REFERENCE}/{grid}"


def topic_key(site: str, of: str, topic: str) -> str:
    """Key of a camera's topic, or of a grid's reference."""
    return reference_key(site, of) if topic == REFERENCE else camera_key(site, of, topic)


def health_key(site: str, node: str) -> str:
    """Key of a node's health messages."""
    return f"{ROOT}/{site}/{NODES}/{node}/health"


def word_key(site: str, node: str) -> str:
    """Key of a node's health at each change of its state, for the other nodes of its graph."""
    return f"{ROOT}/{site}/{NODES}/{node}/word"


def alive_key(site: str, node: str) -> str:
    """Key of a node's liveliness token, which exists while its process is ready."""
    return f"{ROOT}/{site}/{NODES}/{node}/alive"


def node_of(key: str) -> str:
    """Node that a health or liveliness key belongs to."""
    return key.split("/")[3]


def site_of(key: str) -> str:
    """Site that a key belongs to."""
    return key.split("/")[1]


def topic_of(key: str) -> str:
    """Last chunk of a camera's key, or 'reference'."""
    parts = key.split("/")
    return REFERENCE if len(parts) > 2 and parts[2] == REFERENCE else parts[-1]


def source_of(key: str) -> str:
    """``source`` in the headers of a topic's messages: ``<site>/<camera>``."""
    return "/".join(key.split("/")[1:3])


def renamed(below: str, names: Mapping[str, str]) -> str:
    """Return ``<camera>/<topic>`` renamed, by a name for that topic or for its camera.

    Examples
    --------
    >>> renamed("cam1/track", {"cam1": "cam2"}), renamed("cam1/track", {"cam1/track": "a/b"})
    ('cam2/track', 'a/b')
    """
    camera, _, topic = below.partition("/")
    return names.get(below, f"{names.get(camera, camera)}/{topic}")


def matches(key_expr: str, key: str) -> bool:
    """Whether a key expression with wild cards covers a key.

    Raises
    ------
    UsageError
        When the text is no key expression.
    """
    import zenoh

    try:
        return bool(zenoh.KeyExpr(key_expr).includes(zenoh.KeyExpr(key)))
    except zenoh.ZError as exc:
        raise no_key_expression(key_expr) from exc


def no_key_expression(text: str) -> UsageError:
    """Return the error for a text that is no key expression."""
    return UsageError(f"{text!r} is no key expression", "such as 'cam1/track', 'cam1/*' or '**'")

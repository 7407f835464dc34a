"""Keys on the bus, and how their messages are delivered.

A key is ``rsenf/<site>/<camera>/<topic>`` or ``rsenf/<site>/reference/<grid>``. A topic's delivery
class says blocking or dropping, queue length, history, priority.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
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


def start_suffix(node: str, restarts: int) -> str:
    """Return what a restarted node adds to the name of the run, as its numbers begin anew.

    >>> start_suffix("rows", 0), start_suffix("rows", 2)
    ('', '.rows2')
    """
    return f".{node}{restarts}" if restarts else ""


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


@dataclass(frozen=True)
class Delivery:
    """Delivery class of a topic.

    Parameters
    ----------
    lossless : bool
        Sender: block on slow receivers (backpressure) instead of dropping. Receiver: let blocking
        senders wait while its queue is full, instead of dropping the oldest message. Messages that
        were sent as droppable are dropped in either case.
    queue : int
        Messages of one key that a receiver queues at most.
    history : int
        Messages that a sender offers to late joiners, and (if not 0) that a receiver requests.
    kept : int
        Messages that a sender keeps for recovery after a broken link; at least ``history``.
    urgent : bool
        Whether the topic has real-time priority.
    together_s : float
        Longest time that a message waits to be batched, in s, where its sender allows it.
    """

    lossless: bool
    queue: int
    history: int
    kept: int = 0
    urgent: bool = False
    together_s: float = 0.1

    @property
    def recovers(self) -> bool:
        """Whether a receiver requests missed messages; observers don't."""
        return self.lossless and self.history > 0


# File and replay topics block, live pictures are dropped; estimates are small and are kept.
FRAMES_FILE = Delivery(lossless=True, queue=16, history=0)
FRAMES_LIVE = Delivery(lossless=False, queue=16, history=0)
VIDEO = Delivery(lossless=True, queue=64, history=0, together_s=0.25)
# A live camera must not be blocked by a slow link between hosts.
VIDEO_LIVE = Delivery(lossless=False, queue=512, history=0, together_s=0.25)
SIGNALS = Delivery(lossless=True, queue=1024, history=600)
# 1200 blocks of 8 frames are 5 minutes at 30 frames a second.
ROWS = Delivery(lossless=True, queue=256, history=64, kept=1200)
# A node's last health message tells whether it finished or was lost: it must not be dropped, nor
# arrive long after the node's liveliness token has gone.
HEALTH = Delivery(lossless=True, queue=256, history=1, kept=300, urgent=True)
# It is sent every second: a node without any for this long counts as silent.
SILENT_S = 3.5
# For observers, which never block a sender.
LOOKING = Delivery(lossless=False, queue=256, history=1)


def delivery_of(topic: str, *, live: bool = False) -> Delivery:
    """Delivery class of a topic, of a live source or of a file."""
    if topic == "frames":
        return FRAMES_LIVE if live else FRAMES_FILE
    if topic == "video" and live:
        return VIDEO_LIVE
    return {"video": VIDEO, "rows": ROWS, "health": HEALTH}.get(topic, SIGNALS)

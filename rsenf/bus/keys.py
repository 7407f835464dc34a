"""Names on the bus: ``rsenf/<site>/<camera>/<topic>`` and ``rsenf/<site>/reference/<grid>``."""

from __future__ import annotations

import re

ROOT = "rsenf"
# What a camera's stages publish. 'video' is the compressed picture as it came, for recording.
TOPICS = ("frames", "video", "rows", "track", "idle", "match", "live", "alarm", "discover")
REFERENCE = "reference"
NODES = "@nodes"

_CHUNK = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*")


def is_name(text: str) -> bool:
    """Whether a site, camera, grid or node may be called so: one key chunk, no wild cards."""
    return _CHUNK.fullmatch(text) is not None


def camera_key(site: str, camera: str, topic: str) -> str:
    """Key of one topic of one camera."""
    return f"{ROOT}/{site}/{camera}/{topic}"


def reference_key(site: str, grid: str) -> str:
    """Key of a grid's reference."""
    return f"{ROOT}/{site}/{REFERENCE}/{grid}"


def health_key(site: str, node: str) -> str:
    """Key of a node's health messages."""
    return f"{ROOT}/{site}/{NODES}/{node}/health"


def alive_key(site: str, node: str) -> str:
    """Key of a node's liveliness token: there while its process lives and is ready."""
    return f"{ROOT}/{site}/{NODES}/{node}/alive"


def node_of(key: str) -> str:
    """Node that a health or liveliness key belongs to."""
    return key.split("/")[3]


def topic_of(key: str) -> str:
    """Last chunk of a camera's key, or 'reference'."""
    parts = key.split("/")
    return REFERENCE if len(parts) > 2 and parts[2] == REFERENCE else parts[-1]

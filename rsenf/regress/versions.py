"""Decides whether a recording was made by the present versions, so that bits must agree.

The processor counts too: NumPy and its linear algebra choose their inner loops by its features, and
another order of summation rounds differently. Of a graph on several hosts the recording contains
only the recorder's versions.
"""

from __future__ import annotations

from rsenf.bus.keys import topic_of
from rsenf.record import Recording
from rsenf.record.growing import ABOUT
from rsenf.record.provenance import ADDED, program_facts

BESIDE = ("created_utc", "host", "platform")  # where and when it was recorded
# These libraries only carry messages.
_CARRIERS = ("eclipse-zenoh", "mcap", "protobuf", "zstandard")
_NO_MATTER = {*BESIDE, *(f"library {name}" for name in _CARRIERS)}


def changed_since(recording: Recording) -> dict[str, tuple[str, str]]:
    """Return what changed since a recording was made: then and now, by name."""
    then, now = recording.metadata.get(ABOUT, {}), program_facts()
    changed = {
        name: (then.get(name, "unknown"), value)
        for name, value in now.items()
        if name not in _NO_MATTER and then.get(name) != value
        if name in then or not name.startswith(ADDED)  # packages added since made none of it
    }
    gone = [name for name in then if name.startswith(ADDED) and name not in now]
    changed |= {name: (then[name], "not installed") for name in gone}
    if (hosts := _hosts(recording)) - {then.get("host")}:
        changed["host"] = (", ".join(sorted(hosts)), now["host"])
    return changed


def _hosts(recording: Recording) -> set[str]:
    """Hosts of a recording's nodes, from their health messages."""
    topics = [name for name in recording.topics if topic_of(name) == "health"]
    words = recording.messages(topics, tolerant=True) if topics else ()
    return {word.host for _, word, _ in words if word.host}

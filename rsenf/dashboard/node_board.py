"""The nodes of a bus by what they say of themselves, and those that have fallen silent."""

from __future__ import annotations

from typing import Any

from rsenf.config import redact
from rsenf.dashboard.plain import in_ms, rounded
from rsenf.messages import Health
from rsenf.timebase import NS_PER_S

KEPT_NODES = 256
LAST_WORDS = ("done", "failed", "lost")
# Health comes every second; a node that says nothing this long is told from one that is well.
SILENT_NS = 4 * NS_PER_S


class NodeBoard:
    """The latest word of each node."""

    def __init__(self) -> None:
        self._latest: dict[str, Health] = {}
        self._heard_ns: dict[str, int] = {}  # by the clock here: another host's may be wrong

    def update(self, message: Health, now_ns: int) -> None:
        """Take in a word of health."""
        if message.node in self._latest or len(self._latest) < KEPT_NODES:
            self._latest[message.node], self._heard_ns[message.node] = message, now_ns

    def state(self, name: str, now_ns: int) -> str:
        """State of a node; 'silent' when it should have spoken, '' when it is unknown."""
        health = self._latest.get(name)
        if health is None:
            return ""
        is_late = now_ns - self._heard_ns[name] > SILENT_NS
        return "silent" if is_late and health.state not in LAST_WORDS else health.state

    def plain(self, now_ns: int) -> list[dict[str, Any]]:
        """All nodes for JSON."""
        return [
            {
                "name": name,
                "kind": health.kind,
                "state": self.state(name, now_ns),
                "detail": redact(health.detail),
                "host": health.host,
                "rate_hz": rounded(health.rate_hz, 1),
                "latency_s": rounded(health.latency_s, 2) if health.last_input_ns else None,
                "dropped": health.dropped,
                "missed": health.missed,
                "rejected": health.rejected,
                "queue": health.queue_depth,
                "memory_mb": rounded(health.memory_bytes / 1e6, 0),
                "cpu_s": rounded(health.cpu_s, 0),
                "restarts": health.restarts,
                "heard_ms": in_ms(self._heard_ns[name]),
                "lost_peers": list(health.lost_peers),
            }
            for name, health in sorted(self._latest.items())
        ]

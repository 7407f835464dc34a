"""State and counters of a node."""

from __future__ import annotations

from dataclasses import dataclass

from rsenf.messages.header import Header
from rsenf.messages.schema import field, message

NAN = float("nan")


@message(6, version=1)
@dataclass(frozen=True, kw_only=True, slots=True)
class Health:
    """State and counters of one node, published every second and at every change of state."""

    header: Header = field(1, "", None)
    node: str = field(2, "name in the graph", "")
    kind: str = field(3, "decode, rows, track, …", "")
    state: str = field(
        4, "'starting', 'running', 'waiting', 'done', 'failed', 'restarting' or 'lost'", ""
    )
    detail: str = field(5, "one line for a person", "")
    pid: int = field(6, "process number", 0)
    host: str = field(7, "host's name", "")
    time_ns: int = field(8, "host's clock", 0)
    messages_in: int = field(9, "messages received", 0)
    messages_out: int = field(10, "messages sent", 0)
    dropped: int = field(11, "messages dropped by choice of delivery class", 0)
    missed: int = field(12, "messages that never came, by sequence number", 0)
    rejected: int = field(13, "messages that didn't parse or had another version", 0)
    rate_hz: float = field(14, "messages received per second, lately", 0.0)
    queue_depth: int = field(15, "messages waiting", 0)
    latency_s: float = field(16, "from the arrival of what was filmed to here, lately", 0.0)
    last_input_ns: int = field(17, "host's clock at the last message received; 0 for never", 0)
    lost_peers: tuple[str, ...] = field(18, "nodes it depends on that are gone", ())
    memory_bytes: int = field(19, "resident memory", 0)
    cpu_s: float = field(20, "processor time used", 0.0)
    recovered: int = field(21, "messages that had not come, and were got from their sender", 0)
    restarts: int = field(22, "times it was started again in this run", 0)
    latency_p50_s: float = field(
        23, "median over the last minute, from arrival to here; NaN when nothing came", NAN
    )
    latency_p95_s: float = field(24, "that of the slowest twentieth", NAN)
    exposure_p50_s: float = field(
        25, "median from exposure, by the camera's own clock, to here; NaN when it tells none", NAN
    )
    exposure_p95_s: float = field(26, "that of the slowest twentieth", NAN)

"""Prometheus metrics and health endpoints of a running graph, from its supervisor's state.

``/metrics`` for Prometheus, ``/healthz`` (the supervisor lives), ``/readyz`` (every node is running
or done; otherwise 503, with who isn't).
"""

from __future__ import annotations

import math
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import TYPE_CHECKING, Any

from prometheus_client import CollectorRegistry, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily

from rsenf.config.check import is_own_host
from rsenf.errors import RsenfError, UsageError
from rsenf.run.roster import UP

if TYPE_CHECKING:
    from rsenf.messages import Health
    from rsenf.run.graph_run import GraphRun

CONTENT_TYPE = "text/plain; version=0.0.4; charset=utf-8"
REQUEST_S = 10.0  # a request that takes longer is cut off
MOST_REQUESTS = 32
VERDICTS = ("live", "stale", "frozen", "no_signal", "undecided")

_COUNTERS: dict[str, tuple[str, Callable[[Health], float]]] = {
    "rsenf_messages": ("messages taken", lambda h: h.messages_in),
    "rsenf_messages_sent": ("messages sent", lambda h: h.messages_out),
    "rsenf_messages_dropped": ("dropped by choice of delivery class", lambda h: h.dropped),
    "rsenf_messages_missed": ("never came, by sequence number", lambda h: h.missed),
    "rsenf_messages_rejected": ("foreign, broken, of another version", lambda h: h.rejected),
    "rsenf_messages_recovered": ("got from their sender afterwards", lambda h: h.recovered),
    "rsenf_cpu_seconds": ("processor time", lambda h: h.cpu_s),
}
_GAUGES: dict[str, tuple[str, Callable[[Health], float]]] = {
    "rsenf_queue_depth": ("messages waiting", lambda h: h.queue_depth),
    "rsenf_input_rate_hz": ("messages a second, lately", lambda h: h.rate_hz),
    "rsenf_memory_bytes": ("resident memory", lambda h: h.memory_bytes),
    "rsenf_last_input_seconds": ("host's clock at it, since 1970", lambda h: h.last_input_ns / 1e9),
}
_LATENCIES: dict[str, Callable[[Health], tuple[float, float]]] = {
    "arrival": lambda h: (h.latency_p50_s, h.latency_p95_s),
    "exposure": lambda h: (h.exposure_p50_s, h.exposure_p95_s),
}


class GraphMetrics:
    """Collector of the metrics, as ``prometheus_client`` expects one.

    Parameters
    ----------
    run : GraphRun
        The running graph.
    """

    def __init__(self, run: GraphRun) -> None:
        self._run = run

    @property
    def down(self) -> list[str]:
        """Nodes that are neither running nor done, each with its state and detail."""
        nodes = list(self._run.nodes.values())
        return [f"{n.name}: {n.state} {n.detail}".rstrip() for n in nodes if n.state not in UP]

    @property
    def behind(self) -> list[str]:
        """Nodes that are behind a camera, each with how far."""
        nodes = list(self._run.nodes.values())
        return [f"{n.name}: {n.behind}" for n in nodes if n.behind]

    def collect(self) -> Iterator[Any]:
        """Yield every metric (called by ``prometheus_client``)."""
        yield from self._of_nodes()
        yield from self._of_cameras()

    def _of_nodes(self) -> Iterator[Any]:
        labels = ["node", "kind", "camera"]
        states = list(self._run.nodes.values())
        nodes = [(n, [n.name, n.kind, self._cameras(n.name)]) for n in states]
        up = GaugeMetricFamily("rsenf_up", "1 for a node that runs or is done", labels=labels)
        restarts = CounterMetricFamily("rsenf_restarts", "times started again", labels=labels)
        for node, values in nodes:
            up.add_metric(values, float(node.state in UP))
            restarts.add_metric(values, node.restarts)
        yield up
        yield restarts
        heard = [(node.health, values) for node, values in nodes if node.health is not None]
        for family, table in ((CounterMetricFamily, _COUNTERS), (GaugeMetricFamily, _GAUGES)):
            for name, (text, read) in table.items():
                metric = family(name, text, labels=labels)
                for health, values in heard:
                    metric.add_metric(values, read(health))
                yield metric
        latency = GaugeMetricFamily(
            "rsenf_latency_seconds", "of the last minute", labels=[*labels, "since", "quantile"]
        )
        for health, values in heard:
            for since, read_both in _LATENCIES.items():
                for quantile, seconds in zip(("0.5", "0.95"), read_both(health), strict=True):
                    if not math.isnan(seconds):
                        latency.add_metric([*values, since, quantile], seconds)
        yield latency

    def _of_cameras(self) -> Iterator[Any]:
        verdict = GaugeMetricFamily(
            "rsenf_verdict", "1 for the present one", labels=["camera", "verdict"]
        )
        since = GaugeMetricFamily(
            "rsenf_verdict_since_seconds", "host's clock, since 1970", labels=["camera"]
        )
        for source, live in self._run.latest["live"].copy().items():
            for name in VERDICTS:
                verdict.add_metric([source, name], float(live.verdict == name))
            since.add_metric([source], live.since_ns / 1e9)
        yield verdict
        yield since
        alarms = CounterMetricFamily("rsenf_alarms", "that began", labels=["camera", "kind"])
        for (source, kind), count in self._run.alarm_counts.copy().items():
            alarms.add_metric([source, kind], count)
        yield alarms

    def _cameras(self, name: str) -> str:
        config = self._run.graph.nodes.get(name)  # None: removed this moment
        return ",".join(config.feeds if config else ())


class _Server(ThreadingHTTPServer):
    """At most ``MOST_REQUESTS`` at a time; further connections are closed at once."""

    daemon_threads = True
    request_queue_size = 64

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)
        self._free = threading.BoundedSemaphore(MOST_REQUESTS)

    def process_request(self, request: Any, client_address: Any) -> None:
        if self._free.acquire(blocking=False):
            super().process_request(request, client_address)
        else:
            self.shutdown_request(request)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._free.release()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Say nothing: whoever asked has gone away, or sent no HTTP."""


@contextmanager
def serving_metrics(run: GraphRun, where: str) -> Iterator[int]:
    """Serve a graph's metrics over HTTP for the duration of a ``with`` block; yields the port.

    Parameters
    ----------
    run : GraphRun
        The running graph.
    where : str
        ``HOST:PORT``, or a port on 127.0.0.1; port 0 chooses a free one.

    Raises
    ------
    UsageError
        When that is no address.
    RsenfError
        When the server can't listen there.
    """
    host, _, port = where.rpartition(":")
    if not port.isdecimal() or int(port) > 65535:
        raise UsageError(f"{where!r} is no HOST:PORT", "such as 127.0.0.1:9464")
    metrics, registry = GraphMetrics(run), CollectorRegistry()
    registry.register(metrics)

    def ready() -> tuple[int, bytes]:
        down = metrics.down
        lines = [*(down or ["ready"]), *metrics.behind]
        return 503 if down else 200, "".join(f"{line}\n" for line in lines).encode()

    served_at = host.strip("[]") or "127.0.0.1"

    class Handler(BaseHTTPRequestHandler):
        def setup(self) -> None:
            super().setup()
            self._limit = threading.Timer(REQUEST_S, self._time_out)
            self._limit.start()

        def _time_out(self) -> None:
            with suppress(OSError):
                self.connection.shutdown(socket.SHUT_RDWR)

        def finish(self) -> None:
            self._limit.cancel()
            super().finish()

        def do_GET(self) -> None:
            if not is_own_host(self.headers.get("Host", ""), served_at):
                self.send_error(403, "ask for this page by the address of its host")
                return
            pages: dict[str, Callable[[], tuple[int, bytes]]] = {
                "/metrics": lambda: (200, generate_latest(registry)),
                "/healthz": lambda: (200, b"alive\n"),
                "/readyz": ready,
            }
            page = pages.get(self.path.partition("?")[0], lambda: (404, b"no such page\n"))
            status, body = page()
            self.send_response(status)
            self.send_header("Content-Type", CONTENT_TYPE)
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, *_words: object) -> None:
            """Log nothing: requests come every few seconds."""

    try:
        server = _Server((served_at, int(port)), Handler)
    except OSError as exc:
        raise RsenfError(f"no metrics at {where}: {exc.strerror}", "is the port free?") from exc
    with server:
        threading.Thread(target=server.serve_forever, name="metrics", daemon=True).start()
        try:
            yield server.server_port
        finally:
            server.shutdown()

"""Three hosts and a router; a link is cut, the router started again: what was lost, by count.

    python -m tests.run.three_hosts --cut-s 60 --loss 0.01 --delay-ms 40 --film-s 150 --seed 7

The hosts are network namespaces, joined by cables that carry packets with loss and delay; with
--proxies they are this host, joined by TCP proxies. A camera's host sends rows and video, an
analysis host estimates, an archive's host records. What a stream had is told by the number of its
END mark, what came by the recording.
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from rsenf.bus.zenoh_bus import free_endpoint
from rsenf.messages import Health
from rsenf.record.reader import Recording
from tests.conftest import ROOT
from tests.run.cable import Cable, namespaces
from tests.run.link_proxy import LinkProxy

GRAPH = """\
version: 1
site: lab
hosts:
  camera:   {nodes: [decode], links: [router]}
  analysis: {nodes: [grid, track, idle, match], links: [router]}
  archive:  {nodes: [record], links: [router]}
  router:   {address: "${ROUTER}", listen: ["${LISTEN}"]}
nodes:
  decode: {kind: decode, camera: cam, input: "${FILM}", frames: fused, pace: true}
  grid:   {kind: reference, grid: ce, input: "${GRID}"}
  track:  {kind: track, cameras: [cam], track: {nominal_hz: 50}}
  idle:   {kind: idle, cameras: [cam], idle: {nominal_hz: 50}}
  match:  {kind: match, cameras: [cam], grid: ce, interim_every_s: 10}
  record: {kind: record, out: "${OUT}"}
"""
TLS = """\
tls:
  ca: "${CERTIFICATES}/ca.pem"
  certificate: "${CERTIFICATES}/{host}.pem"
  key: "${CERTIFICATES}/{host}.key"
"""
HOSTS = ("camera", "analysis", "archive")
END_S = 60.0  # that everything may take to end after the film


class Host:
    """``rsenf run --host NAME`` in a process of its own."""

    def __init__(
        self, name: str, graph: Path, env: Mapping[str, str], prefix: Sequence[str] = ()
    ) -> None:
        self.name = name
        command = [*prefix, sys.executable, "-m", "rsenf.cli", "run", str(graph), "--host", name]
        self.log = graph.parent / f"{name}.log"
        with self.log.open("ab") as log:
            self.process = subprocess.Popen(
                command, env={**os.environ, **env}, stdout=log, stderr=log
            )

    def end(self) -> None:
        """Stop it in order, or else at once."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)
            try:
                self.process.wait(20)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()


@contextmanager
def running(hosts: list[Host]) -> Iterator[None]:
    """End whatever of the hosts still runs afterwards."""
    try:
        yield
    finally:
        for host in hosts:
            host.end()


def make_film(folder: Path, film_s: float, seed: int) -> dict[str, str]:
    """Simulate a clip on a grid drawn by its seed; returns what the graph file is told of it."""
    import numpy as np

    freq_hz = 50 + np.cumsum(np.random.default_rng(seed).normal(0, 0.002, int(film_s) + 600))
    lines = [f"{k},{f:.6f}" for k, f in enumerate(freq_hz)]
    grid, film = folder / "grid.csv", folder / "film.mp4"
    grid.write_text("\n".join(["time_s,frequency", *lines, ""]), encoding="utf-8")
    words = ["simulate", "--out", film, "--reference", grid, "--start-s", 300, "--duration-s",
             film_s, "--size", "240x180", "--seed", seed]  # fmt: skip
    subprocess.run([sys.executable, "-m", "rsenf.cli", *map(str, words)], check=True)
    return {"FILM": str(film), "GRID": str(grid)}


def make_certificates(folder: Path) -> None:
    """Make one for each host."""
    script = ROOT / "configs" / "deploy" / "certificates.sh"
    words = ["sh", str(script), str(folder), *HOSTS, "router"]
    subprocess.run(words, check=True, capture_output=True)


def account(recording: Path) -> tuple[dict[str, tuple[int, int]], dict[str, Health]]:
    """Count what was recorded.

    Returns
    -------
    topics : dict
        Of each topic how many messages it had, by its END mark (-1 without one), and how many of
        them are there. Every message is in its place and there once.
    health : dict
        Last word of each node that was recorded.
    """
    had: dict[str, int] = {}
    came: Counter[str] = Counter()
    last: dict[str, int] = {}
    health: dict[str, Health] = {}
    for topic, message, _ in Recording(recording).messages():
        if isinstance(message, Health):
            health[message.node] = message
            continue
        seq = message.header.seq
        assert seq > last.get(topic, -1), f"{topic}: {seq} after {last[topic]}"
        last[topic] = seq
        if message.header.is_end:
            had[topic] = seq
        else:
            came[topic] += 1
    return {topic: (had.get(topic, -1), came[topic]) for topic in sorted(last)}, health


@dataclass
class Net:
    """How the hosts reach the router: where it listens, and by which address from each of them."""

    listen: str
    addresses: dict[str, str]
    inside: dict[str, list[str]]  # what to put before a command that is to run on a host
    camera: LinkProxy | Cable


def by_proxies(stack: ExitStack, delay_s: float, loss: float, seed: int, *, tls: bool) -> Net:
    """Join the hosts within this one, each link by a proxy."""
    listen = free_endpoint()
    port = int(listen.rpartition(":")[2])
    if tls:
        listen = listen.replace("tcp/127.0.0.1", "tls/localhost")
    links = [stack.enter_context(LinkProxy(port, delay_s, loss, seed + k)) for k in range(3)]
    start = listen.rpartition(":")[0]
    addresses = {name: f"{start}:{link.port}" for name, link in zip(HOSTS, links, strict=True)}
    return Net(listen, addresses, {}, links[0])


def by_cables(stack: ExitStack, delay_s: float, loss: float, seed: int) -> Net:
    """Make each host a network namespace, with a cable to the router's."""
    names = {name: f"rsenf{os.getpid()}-{name[:3]}" for name in (*HOSTS, "router")}
    stack.enter_context(namespaces(list(names.values())))
    cables = [
        Cable((names[name], names["router"]), f"10.77.{k}", delay_s, loss, seed + k)
        for k, name in enumerate(HOSTS)
    ]
    for cable in cables:
        stack.enter_context(cable)
    return Net(
        "tcp/0.0.0.0:7447",
        {name: f"tcp/10.77.{k}.2:7447" for k, name in enumerate(HOSTS)},
        {name: ["ip", "netns", "exec", space] for name, space in names.items()},
        cables[0],
    )


def play(
    folder: Path,
    make_net: Callable[[ExitStack], Net],
    film_s: float,
    cut_at_s: float,
    cut_s: float,
    restart_at_s: float,
    seed: int,
    *,
    tls: bool = False,
) -> tuple[dict[str, tuple[int, int]], dict[str, Health]]:
    """Run the hosts while the camera's link is cut and the router started again; count."""
    facts = make_film(folder, film_s, seed) | {"OUT": str(folder / "archive.mcap")}
    graph = folder / "hosts.yaml"
    graph.write_text(TLS + GRAPH if tls else GRAPH, encoding="utf-8")
    if tls:
        make_certificates(folder)
    with ExitStack() as stack:
        net = make_net(stack)
        hosts: list[Host] = []
        stack.enter_context(running(hosts))

        def start(name: str) -> Host:
            own = {
                "LISTEN": net.listen,
                "ROUTER": net.addresses.get(name, net.listen),
                "CERTIFICATES": str(folder),
            }
            hosts.append(Host(name, graph, facts | own, net.inside.get(name, ())))
            return hosts[-1]

        router = start("router")
        sources = [start(name) for name in HOSTS]
        begun = _begun(sources[0])
        steps = [(cut_at_s, net.camera.cut), (cut_at_s + cut_s, net.camera.mend)]
        if restart_at_s:
            steps += [(restart_at_s, router.end), (restart_at_s + 1, lambda: start("router"))]
        for at_s, step in steps:
            time.sleep(max(0.0, begun + at_s - time.monotonic()))
            step()
        for host in sources:
            host.process.wait(max(1.0, begun + film_s + END_S - time.monotonic()))
    return account(folder / "archive.mcap")


def _begun(camera: Host) -> float:
    """Wait until the camera sends; returns when."""
    deadline = time.monotonic() + 60
    while "decode: running" not in camera.log.read_text(encoding="utf-8"):
        waits = time.monotonic() < deadline and camera.process.poll() is None
        assert waits, camera.log.read_text(encoding="utf-8")
        time.sleep(0.1)
    return time.monotonic()


def main() -> None:
    """Print what was lost and what was not."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cut-s", type=float, default=60.0)
    parser.add_argument("--loss", type=float, default=0.01)
    parser.add_argument("--delay-ms", type=float, default=40.0)
    parser.add_argument("--film-s", type=float, default=150.0)
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--proxies", action="store_true", help="rather than network namespaces")
    parser.add_argument("--tls", action="store_true", help="certificates; through proxies")
    parser.add_argument("--out", type=Path, help="folder to keep logs and the recording in")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = args.out or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        delay_s = args.delay_ms / 1000

        def make_net(stack: ExitStack) -> Net:
            if args.proxies or args.tls:
                return by_proxies(stack, delay_s, args.loss, args.seed, tls=args.tls)
            return by_cables(stack, delay_s, args.loss, args.seed)

        cut_at_s = 0.15 * args.film_s
        again_s = cut_at_s + args.cut_s + 0.2 * args.film_s
        topics, health = play(
            folder, make_net, args.film_s, cut_at_s, args.cut_s, again_s, args.seed, tls=args.tls
        )  # fmt: skip
    print(f"{'topic':28} {'sent':>6} {'recorded':>8} {'lost':>6}")
    for topic, (had, came) in topics.items():
        print(f"{topic:28} {had:6} {came:8} {had - came:6}")
    for name, word in sorted(health.items()):
        print(f"{name}: missed {word.missed}, recovered {word.recovered}")


if __name__ == "__main__":
    main()

"""A cable between two network namespaces: carries packets with delay and loss, and can be cut.

For kernels without ``tc netem``. Needs the right to make namespaces and TUN devices.
"""

from __future__ import annotations

import ctypes
import fcntl
import heapq
import os
import random
import select
import struct
import subprocess
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType

TUNSETIFF, IFF_TUN, IFF_NO_PI = 0x400454CA, 0x0001, 0x1000
CLONE_NEWNET = 0x40000000
PACKET = 65536


@contextmanager
def namespaces(names: Sequence[str]) -> Iterator[None]:
    """Make network namespaces, for the duration of a ``with`` block.

    Raises
    ------
    PermissionError
        Where that is not allowed.
    """
    made: list[str] = []
    try:
        for name in names:
            done = subprocess.run(["ip", "netns", "add", name], capture_output=True, check=False)
            if done.returncode:
                raise PermissionError(done.stderr.decode().strip())
            made.append(name)
            _ip(name, "link", "set", "lo", "up")
        yield
    finally:
        for name in made:
            subprocess.run(["ip", "netns", "del", name], check=False)


def _ip(namespace: str, *words: str) -> None:
    subprocess.run(["ip", "-n", namespace, *words], check=True, capture_output=True)


class Cable:
    """Joins two namespaces, which must exist, by a device in each.

    Parameters
    ----------
    ends : tuple of str
        The namespaces.
    net : str
        First three numbers of the addresses: the ends get .1 and .2.
    delay_s, loss : float
        Each way; the share of packets that never arrive.
    seed : int
        Of what is lost.
    """

    def __init__(
        self, ends: tuple[str, str], net: str, delay_s: float, loss: float, seed: int
    ) -> None:
        self.device = f"to{net.rpartition('.')[2]}"
        self._tuns = [_open_tun(end, self.device) for end in ends]
        for end, own, other in zip(ends, (1, 2), (2, 1), strict=True):
            peer = ("peer", f"{net}.{other}")
            _ip(end, "addr", "add", f"{net}.{own}", *peer, "dev", self.device)
            _ip(end, "link", "set", self.device, "up")
        self._delay_s, self._loss, self._random = delay_s, loss, random.Random(seed)
        self._whole, self._ended = True, False
        self._thread = threading.Thread(target=self._carry, name="cable", daemon=True)

    def __enter__(self) -> Cable:
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._ended = True
        self._thread.join()
        for tun in self._tuns:
            os.close(tun)

    def cut(self) -> None:
        """Let nothing through any more."""
        self._whole = False

    def mend(self) -> None:
        """Let everything through again."""
        self._whole = True

    def _carry(self) -> None:
        under_way: list[tuple[float, int, int, bytes]] = []
        count = 0
        other = dict(zip(self._tuns, reversed(self._tuns), strict=True))
        while not self._ended:
            wait_s = max(0.0, under_way[0][0] - time.monotonic()) if under_way else 0.1
            for tun in select.select(self._tuns, [], [], min(wait_s, 0.1))[0]:
                packet = os.read(tun, PACKET)
                if self._whole and self._random.random() >= self._loss:
                    count += 1
                    due = time.monotonic() + self._delay_s
                    heapq.heappush(under_way, (due, count, other[tun], packet))
            while under_way and under_way[0][0] <= time.monotonic():
                _, _, to, packet = heapq.heappop(under_way)
                if self._whole:
                    os.write(to, packet)


def _open_tun(namespace: str, device: str) -> int:
    """Make a TUN device in a namespace, by entering it for a moment in a thread of its own."""
    opened: list[int] = []

    def work() -> None:
        with Path(f"/run/netns/{namespace}").open("rb") as there:
            libc = ctypes.CDLL(None, use_errno=True)
            if libc.setns(there.fileno(), CLONE_NEWNET):
                return
        tun = os.open("/dev/net/tun", os.O_RDWR)
        name = struct.pack("16sH", device.encode(), IFF_TUN | IFF_NO_PI)
        fcntl.ioctl(tun, TUNSETIFF, name)
        opened.append(tun)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    if not opened:
        raise PermissionError(f"no TUN device in namespace {namespace}")
    return opened[0]

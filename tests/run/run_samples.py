"""Frames of a flickering wall, stages that only count, and nodes on a bus within the process."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from rsenf.config import Graph
from rsenf.messages import EnfEstimate, Frame, Header, Mark, RowBlock
from rsenf.run.node import NodeProcess
from rsenf.run.restart_policy import NodeState
from tests.loopback import Loopback

GRAPH = {
    "version": 1,
    "site": "lab",
    "nodes": {
        "decode": {"kind": "decode", "camera": "cam", "input": "none.mp4", "frames": "tcp"},
        "rows": {"kind": "rows", "cameras": ["cam"]},
        "track": {"kind": "track", "cameras": ["cam"]},
        "grid": {"kind": "reference", "grid": "ce", "input": "none.csv"},
        "match": {"kind": "match", "cameras": ["cam"], "grid": "ce"},
        "record": {"kind": "record", "out": "none.mcap"},
    },
}


def node_on(
    network: Loopback, name: str, graph: dict[str, Any] | None = None, **more: Any
) -> NodeProcess:
    """A node as its process would make it."""
    return NodeProcess(Graph.model_validate(graph or GRAPH), name, "r", network.bus(name), **more)


def nobody(node: NodeState) -> NoReturn:
    """Stands for what starts a node's process, where none is to be started."""
    raise AssertionError(f"{node.name} was started")


def wall(count: int, *, epoch: int = 0, run_id: str = "r", first: int = 0) -> Iterator[Frame]:
    """Frames at 30 Hz of a wall under a lamp at 50.01 Hz, read out over 80 % of each frame."""
    rng = np.random.default_rng(epoch)
    rows = np.arange(24) / 24 * 0.8 / 30
    for k in range(first, first + count):
        level = 120 + 30 * np.cos(2 * np.pi * 100.02 * (k / 30 + rows))
        luma = np.clip(level[:, None] + rng.normal(0, 3, (24, 32)), 0, 255).astype(np.uint8)
        yield Frame(
            header=Header(
                run_id=run_id,
                source="lab/cam",
                epoch=epoch,
                seq=k,
                frame_first=k,
                frame_last=k,
                pts_ns=k * 1_000_000_000 // 30,
            ),
            height_px=24,
            width_px=32,
            luma=luma,
        )


def end_after(message: Any) -> Any:
    """The END mark that follows a message."""
    return type(message)(header=message.header.numbered(message.header.seq + 1, Mark.END))


class Counting:
    """A stage from row blocks to estimates that only counts; every second message completes one."""

    def __init__(self) -> None:
        self.taken: list[Any] = []

    def update(self, message: Any) -> list[Any]:
        self.taken.append(message)
        return [] if len(self.taken) % 2 else [self._estimate("update")]

    def flush(self) -> list[Any]:
        return [self._estimate("flush")]

    def _estimate(self, method: str) -> EnfEstimate:
        seq = (len(self.taken) + 1) // 2 - (method == "update")
        header = self.taken[-1].header.numbered(seq) if self.taken else Header(seq=seq)
        return EnfEstimate(header=header, method=method, points=0)


def block(seq: int, *, epoch: int = 0, run_id: str = "r") -> RowBlock:
    return RowBlock(header=Header(run_id=run_id, source="lab/cam", epoch=epoch, seq=seq))


def children_of(word: str) -> list[int]:
    """Node processes that are alive with a word, a run's id or a graph's path, in their command."""
    assert word
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                words = (entry / "cmdline").read_bytes().split(b"\0")
                state = (entry / "stat").read_text().rpartition(")")[2].split()[0]
            except OSError:
                continue
            if b"--run-id" in words and word.encode() in words and state != "Z":
                found.append(int(entry.name))
    return found

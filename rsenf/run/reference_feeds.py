"""Publishes references that are still being measured: from a camera, topic, sound card or file."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rsenf.bus.keys import camera_key
from rsenf.messages import Header, Mark, ReferenceBlock
from rsenf.reference.live import (
    CameraReference,
    Growing,
    RelayedReference,
    SoundReference,
    follow_table,
    follow_wav,
)
from rsenf.reference.reference import Notes
from rsenf.run.node import NodeProcess
from rsenf.run.pump import Lane, pump
from rsenf.run.runner import Runner
from rsenf.run.sound_card import listen
from rsenf.stage import Stage

POLL_S = 0.25  # interval of checking a growing file


def publish_feed(node: NodeProcess) -> None:
    """Publish a growing reference until its source ends or the node is told to stop.

    Raises
    ------
    UsageError
        When the source can't be opened.
    """
    config = node.config
    kind, name = config.feed
    site, grid = node.graph.site, config.grid
    if kind == "camera":
        step_s = config.step_s or 1.0
        senders = {
            camera_key(site, name, topic): node.sender_of(topic, name)
            for topic in ("rows", "track")
        }
        _relay(node, senders, CameraReference(grid, step_s, node.run_id), Notes())
    elif kind == "topic":
        site, grid_there = name.split("/")[1::2]
        sender = node.sender_of("reference", grid_there) if site == node.graph.site else ""
        stage = RelayedReference(grid, node.run_id, config.nominal_hz)
        _relay(node, {name: sender}, stage, stage.notes)
    elif kind == "sound":
        _publish(node, _heard(node, config, name))
    else:
        _publish(node, _grown(node, config))


@dataclass(kw_only=True)
class _NotedLane(Lane):
    """A lane whose stage notes what it leaves out; the notes appear in the node's health."""

    notes: Notes
    _said: str = ""

    def send(self, messages: Iterable[Any]) -> None:
        """Send messages; report new notes."""
        super().send(messages)
        noted = "; ".join(self.notes.lines)
        if noted != self._said:
            self._said = noted
            self.node.say("running", noted)


def _relay(node: NodeProcess, senders: dict[str, str], stage: Stage, notes: Notes) -> None:
    """Make the reference of other topics; ``senders`` maps their keys to the sending nodes."""
    lane = _NotedLane(
        node=node,
        # The reference continues over epochs of its inputs: one stage serves all of them.
        runner=Runner("reference", lambda: stage, inputs=len(senders)),
        publishers={ReferenceBlock: node.reference_publisher(node.config.grid)},
        inputs={node.subscribe(key): sender for key, sender in senders.items()},
        notes=notes,
    )
    node.ready()
    pump(node, [lane])


def _publish(node: NodeProcess, blocks: Iterable[ReferenceBlock]) -> None:
    """Publish blocks as they come, then an END mark."""
    grid = node.config.grid
    publisher = node.reference_publisher(grid)
    node.ready()
    header = Header(run_id=node.run_id, source=f"reference/{grid}", seq=-1)
    for block in blocks:
        header = block.header
        node.note_input(header)
        publisher.send(block)
        if node.stop.is_set():  # a file's present content may take long
            break
    publisher.send(ReferenceBlock(header=header.numbered(header.seq + 1, Mark.END)))


def _grown(node: NodeProcess, config: Any) -> Iterator[ReferenceBlock]:
    """Return the blocks of a growing file."""
    path, grid, nominal_hz = Path(config.input), config.grid, config.nominal_hz

    def wait() -> bool:
        return node.stop.wait(POLL_S)

    if path.suffix.lower() == ".wav":
        return follow_wav(path, grid, nominal_hz, wait, node.run_id)
    return follow_table(path, grid, config.reading, wait, node.run_id)


def _heard(node: NodeProcess, config: Any, device: str) -> Iterator[ReferenceBlock]:
    """Yield blocks measured from a sound card's input; report which tone they are based on."""
    growing = Growing(config.grid, run_id=node.run_id)
    reference: SoundReference | None = None
    tone = ""

    def say(line: str) -> None:
        node.say("running", line)

    for sound in listen(device, node.stop, say):
        if reference is None:
            reference = SoundReference(growing, sound.rate_hz, config.nominal_hz)
        elif sound.after_loss:
            reference.lost()
        yield from reference.take(sound.samples, sound.arrival_ns)
        if reference.tone != tone:
            tone = reference.tone
            say(f"{tone} heard")

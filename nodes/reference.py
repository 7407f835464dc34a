"""Reference: publishes a grid's frequency, from a file or while it is measured."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterator
from typing import TYPE_CHECKING, Literal

from pydantic import Field, field_validator

from rsenf.bus.keys import NAME_PATTERN, REFERENCE, ROOT, reference_key
from rsenf.config.node_kind import Input, Name, NodeKind, Problem, Stream, named, not_reserved
from rsenf.reference.readings import ReadOptions
from rsenf.reference.times import checked_format

if TYPE_CHECKING:
    from rsenf.config.graph import Graph
    from rsenf.run.node import NodeProcess

_REFERENCE_KEY = f"{ROOT}/{NAME_PATTERN}/{REFERENCE}/{NAME_PATTERN}"


class ReferenceNode(NodeKind):
    """Publishes a grid's frequency: of a file, of the store, or as it is measured."""

    kind: Literal["reference"]
    grid: Name
    input: str = Field(
        description="path, store:GRID[@STEP][?from=TIME&to=TIME], camera:NAME, sound:[DEVICE], "
        "or topic:rsenf/SITE/reference/GRID"
    )
    follow: bool = Field(False, description="the file, CSV or WAV, grows: go on with it")
    store: str | None = Field(None, description="folder of the store; the user's when not given")
    timezone: str | None = None
    step_s: float | None = Field(None, gt=0)
    column: str | None = None
    time_column: str | None = None
    time_format: str | None = Field(None, description="as strptime takes it: %d.%m.%Y %H:%M:%S")
    nominal_hz: float | None = None
    stamp: Literal["start", "centre"] = "start"

    is_source = True
    sends_again = True
    named_by = "grid"

    @field_validator("input")
    @classmethod
    def _can_be_named(cls, read: str) -> str:
        kind, _, name = read.partition(":")
        if kind == "camera":
            not_reserved(named(name))
        if kind == "topic" and not re.fullmatch(_REFERENCE_KEY, name):
            raise ValueError(f"no key of a reference: {ROOT}/SITE/{REFERENCE}/GRID")
        return read

    @field_validator("time_format")
    @classmethod
    def _tells_a_day(cls, text: str | None) -> str | None:
        if text is not None:
            checked_format(text)
        return text

    @property
    def feed(self) -> tuple[str, str]:
        """Kind and name of a source that is still measuring; ('', '') for a complete reference."""
        kind, _, name = self.input.partition(":")
        if kind in ("camera", "sound", "topic"):
            return kind, name
        return ("file", self.input) if self.follow else ("", "")

    @property
    def reading(self) -> ReadOptions:
        """Options of reading its file."""
        names = (f.name for f in dataclasses.fields(ReadOptions))
        return ReadOptions(**{name: getattr(self, name) for name in names if hasattr(self, name)})

    def outputs(self) -> list[Stream]:
        """Return the reference."""
        return [Stream(REFERENCE, self.grid)]

    def inputs(self) -> list[Input]:
        """Return the topics of a measuring camera; its rows may come from another graph."""
        kind, name = self.feed
        if kind != "camera":
            return []
        return [
            Input(Stream("rows", name), "input", optional=True),
            Input(Stream("track", name), "input"),
        ]

    def problems(self, graph: Graph) -> Iterator[Problem]:
        """Yield a source that can't grow, and a reference to itself."""
        if self.follow and (self.feed[0] != "file" or self.input.startswith("store:")):
            yield ("follow",), f"{self.input} is no file that grows"
        if self.feed == ("topic", reference_key(graph.site, self.grid)):
            yield ("input",), "that is this node's own topic"

    def body(self, node: NodeProcess) -> None:
        """Publish the whole reference, or follow its source; then send the END mark."""
        from rsenf.messages import Header, Mark, ReferenceBlock
        from rsenf.reference import open_reference, reference_blocks
        from rsenf.run.reference_feeds import publish_feed

        if self.feed[0]:
            publish_feed(node)
            return
        reference = open_reference(
            self.input, store=self.store, grid=self.grid, **dataclasses.asdict(self.reading)
        )
        publisher = node.reference_publisher(self.grid)
        node.ready()
        node.wait_for_peers()
        source = f"reference/{self.grid}"
        header = Header(run_id=node.run_id, source=source)
        for block in reference_blocks(reference, source=source, run_id=node.run_id):
            if node.stop.is_set():
                break
            publisher.send(block)
            header = block.header
        publisher.send(ReferenceBlock(header=header.numbered(header.seq + 1, Mark.END)))
        node.say("running", "; ".join(reference.notes))

"""External: a program of the user's, in any language, under supervision."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from rsenf.config.node_kind import Input, NodeKind, Stream, Topic


class ExternalNode(NodeKind):
    """A program of the user's, under supervision; its duties: 'rsenf explain contract'."""

    kind: Literal["external"]
    command: tuple[str, ...] = Field(min_length=1, description="program and its arguments")
    reads: tuple[Topic, ...] = Field((), description="such as cam1/track; told in RSENF_READS")
    sends: tuple[Topic, ...] = Field((), description="that nobody else sends; in RSENF_SENDS")

    named_by = "sends"

    def outputs(self) -> list[Stream]:
        """Return what it is declared to send."""
        return [Stream.below(topic) for topic in self.sends]

    def inputs(self) -> list[Input]:
        """Return what it is declared to read."""
        return [Input(Stream.below(topic), "reads", optional=True) for topic in self.reads]

    def input_of(self, topic: str, camera: str, *, optional: bool = False) -> Input:
        """Return its declared input of a topic: of this camera, or else the first declared."""
        of = [of for name, of in map(Stream.below, self.reads) if name == topic]
        return Input(Stream(topic, camera if camera in of else "".join(of[:1])), "reads", optional)

    def program(self) -> list[str]:
        """Return its command line."""
        return list(self.command)

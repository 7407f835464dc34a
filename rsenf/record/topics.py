"""The topics of a file; a video's pictures and packets count as one topic."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

from rsenf.messages import VideoPacket, schema_name
from rsenf.messages.schema import PACKAGE
from rsenf.record import foxglove
from rsenf.record.channels import COMPANION, VERSION
from rsenf.record.chunk import Extent
from rsenf.record.index import Index
from rsenf.record.stretches import Stretch

PACKETS = schema_name(VideoPacket)


class Route(NamedTuple):
    """Topic, schema and schema version of a channel's messages."""

    topic: str
    schema: str
    version: str

    @property
    def is_ours(self) -> bool:
        """Whether the channel carries messages of rsenf."""
        return _is_ours(self.schema)

    @property
    def is_picture(self) -> bool:
        """Whether the channel carries the pictures of a video topic."""
        return foxglove.knows(self.schema)


def route_of(channel: Any, schema: str) -> Route:
    """Return the route of a channel; pictures and packets of a video have the same topic."""
    topic = channel.topic.removesuffix(COMPANION) if schema == PACKETS else channel.topic
    return Route(topic, schema, channel.metadata.get(VERSION, ""))


@dataclass(frozen=True)
class Topic:
    """One topic of a recording.

    Attributes
    ----------
    stretches : tuple of Stretch
        Times with messages, separated by more than half a second.
    back_ns : int
        Largest step back of its log times; 0 if they only increase.
    """

    name: str
    schema: str
    messages: int
    first_ns: int
    last_ns: int
    stretches: tuple[Stretch, ...] = ()
    back_ns: int = 0

    @property
    def is_ours(self) -> bool:
        """Whether it carries messages of rsenf."""
        return _is_ours(self.schema)


def topics_of(index: Index) -> dict[str, Topic]:
    """Return the topics of a file, in the order of their channels."""
    names = {number: schema.name for number, schema in index.schemas.items()}
    routes = {n: route_of(c, names.get(c.schema_id, "")) for n, c in index.channels.items()}
    videos = {route.topic for route in routes.values() if route.schema == PACKETS}
    found: dict[str, tuple[str, Extent]] = {}
    stretches: dict[str, list[Stretch]] = {}
    for number, route in routes.items():
        extent = index.extents.get(number)
        if extent is None or (route.is_picture and route.topic in videos):
            continue
        _, others = found.get(route.topic, ("", None))
        found[route.topic] = (route.schema, extent.joined(others))
        stretches.setdefault(route.topic, []).extend(index.stretches[number].all())
    return {
        topic: Topic(topic, schema, *extent[:3], tuple(stretches[topic]), extent.back_ns)
        for topic, (schema, extent) in found.items()
    }


def _is_ours(schema: str) -> bool:
    return schema.startswith(PACKAGE + ".")

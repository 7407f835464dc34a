"""Replay: a recording in, any of its topics out."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import TYPE_CHECKING, Literal

from pydantic import Field, ValidationInfo, field_validator

from rsenf.bus.keys import REFERENCE, renamed, topic_of
from rsenf.config.node_kind import NodeKind, Problem, Stream, Topic, ensure_renamed
from rsenf.errors import EXIT_LOSS, RsenfError

if TYPE_CHECKING:
    from rsenf.bus.bus import Publisher
    from rsenf.bus.frames import FrameSender
    from rsenf.config.graph import Graph
    from rsenf.run.node import NodeProcess
    from rsenf.run.replay.control import Control
    from rsenf.run.replay.player import Player


class ReplayNode(NodeKind):
    """Replays topics of a recording to the bus."""

    kind: Literal["replay"]
    input: str = Field(description="MCAP recording")
    topics: tuple[Topic, ...] = Field(
        min_length=1, description="as recorded: cam1/rows; cam1/frames decodes the video again"
    )
    rename: dict[str, str] = Field({}, description="new names by old: of cameras, or of topics")
    rate: float = Field(0.0, ge=0, description="of its speed; 0: as fast as the others take it")
    start_s: float = Field(0.0, ge=0)
    end_s: float | None = Field(None, gt=0)
    loop: int = Field(1, ge=0, description="times to play it; 0: until stopped")
    frames: Literal["ring", "tcp"] = Field("ring", description="shared memory, or over the bus")
    ring_slots: int = Field(8, ge=2, le=256)

    is_source = True
    named_by = "topics"

    @field_validator("rename")
    @classmethod
    def _can_be_renamed(cls, rename: dict[str, str], info: ValidationInfo) -> dict[str, str]:
        for old, new in rename.items():
            ensure_renamed(old, new, info.data.get("topics"))
        return rename

    @property
    def plays(self) -> str:
        """Path of the recording."""
        return self.input

    @property
    def waits(self) -> bool:
        """True: a replay is exact, so it waits for slow readers at any rate."""
        return True

    def outputs(self) -> list[Stream]:
        """Return the topics by their new names."""
        return [Stream.below(renamed(topic, self.rename)) for topic in self.topics]

    def problems(self, graph: Graph) -> Iterator[Problem]:
        """Yield an end that isn't after the start."""
        if self.end_s is not None and self.end_s <= self.start_s:
            yield ("end_s",), f"{self.end_s:g} s isn't after start_s, {self.start_s:g} s"

    def check_ready(self, name: str, site: str) -> None:
        """Open the recording before other nodes start, which might overwrite it."""
        try:
            self.player(site)
        except RsenfError as exc:
            raise type(exc)(f"node {name!r}: {exc.message}", exc.hint) from exc

    def player(self, site: str, *, run_id: str = "", control: Control | None = None) -> Player:
        """Return its player; see :class:`rsenf.run.replay.player.Player` for what it raises.

        Parameters
        ----------
        site : str
            Site to replay to.
        run_id : str
            For the headers.
        control : Control, optional
            To stop it.
        """
        import time

        from rsenf.run.replay.player import Player, Playing

        playing = Playing(
            topics=self.topics,
            rename=self.rename,
            site=site,
            rate=self.rate,
            start_s=self.start_s,
            end_s=self.end_s,
            loop=self.loop,
        )
        return Player(self.input, playing, run_id=run_id, clock_ns=time.time_ns, control=control)

    def body(self, node: NodeProcess) -> None:
        """Play to the end, or until told to stop."""
        from rsenf.run.outlets import open_frames
        from rsenf.run.replay.control import Control
        from rsenf.run.replay.tape import FRAMES

        player = self.player(node.graph.site, run_id=node.run_id, control=Control(node.stop))
        with contextlib.ExitStack() as stack:
            frames: dict[str, FrameSender] = {}
            publishers: dict[str, Publisher] = {}
            for key in player.keys:
                _, _, camera, topic = key.split("/")
                if topic_of(key) == FRAMES:
                    frames[key] = open_frames(
                        node, camera, ring=self.uses_ring, slots=self.ring_slots
                    )
                    stack.callback(frames[key].close)
                elif topic_of(key) == REFERENCE:
                    publishers[key] = node.reference_publisher(topic)
                else:
                    publishers[key] = node.publisher(camera, topic)
            node.ready()
            node.wait_for_peers()
            for key, message in player:
                node.note_input(message.header)
                if key in publishers:
                    publishers[key].send(message)
                elif message.header.is_end:
                    frames[key].finish(message.header.numbered(message.header.seq - 1))
                else:
                    frames[key].send(message)
        if player.loss:
            node.exit_code = EXIT_LOSS
        node.say("running", player.loss)

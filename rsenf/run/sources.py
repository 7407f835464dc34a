"""What a decode node or a command opens: a file, a camera, or the simulator in its place."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rsenf.config.node_kinds import DecodeNode, SimulatedInput
from rsenf.decode.spec import SourceSpec, kind_of
from rsenf.errors import UsageError
from rsenf.run.host_clock import HostClock

if TYPE_CHECKING:
    from rsenf.decode.source import VideoSource
    from rsenf.run.node import NodeProcess


def open_input(config: DecodeNode, node: NodeProcess) -> VideoSource:
    """Open a decode node's input."""
    source = f"{node.graph.site}/{config.camera}"
    if isinstance(config.input, SimulatedInput):
        from rsenf.run.simulated import open_simulated

        return open_simulated(config.input, source, node.run_id, pace=config.pace, stop=node.stop)
    from rsenf.decode.source import open_source

    if not config.input:
        raise UsageError(f"camera {config.camera!r} has no input", "is its variable set?")
    spec = SourceSpec(
        url=config.input.removeprefix("v4l2:"),
        kind=kind_of(config.input),
        threads=config.threads,
        with_packets=config.record_video,
        pace=config.pace,
        open_timeout_s=config.open_timeout_s,
        read_timeout_s=config.read_timeout_s,
        max_reconnects=config.max_reconnects,
        backoff_initial_s=config.backoff_initial_s,
        backoff_max_s=config.backoff_max_s,
        wait_for_source=config.wait_for_source,
    )

    def say(line: str) -> None:
        node.say("running", line)

    def event(line: str) -> None:
        # Of a camera that is lost nothing more may come for hours. Told where its pictures are
        # sent, not where they arrive, as the clock may be.
        node.flush()
        say(line)

    return open_source(
        spec,
        source=source,
        run_id=node.run_id,
        clock_ns=HostClock(say),
        stop=node.stop,
        on_event=event,
    )

"""Decode: a video, a camera or the simulator in, frames and compressed packets out."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable

from rsenf.bus.frames import FrameSender
from rsenf.config.graph import DecodeNode
from rsenf.errors import EXIT_LOSS
from rsenf.messages import Frame, Header, Mark, VideoPacket
from rsenf.rows.stage import Rows
from rsenf.run.node import NodeProcess, run_node
from rsenf.run.runner import Runner
from rsenf.run.sources import open_input


def body(node: NodeProcess) -> None:
    """Send every frame of the source, then the END marks."""
    config: DecodeNode = node.config
    with open_input(config, node) as source, contextlib.ExitStack() as stack:
        live = source.info.live
        send, finish = _frame_outlet(node, config, live, stack)
        video = node.publisher(config.camera, "video") if config.record_video else None
        node.ready()
        node.wait_for_peers()
        name = f"{node.graph.site}/{config.camera}"
        frame = packet = Header(run_id=node.run_id, source=name, seq=-1)
        for item in source:
            if isinstance(item, VideoPacket):
                packet = item.header
                if video:
                    video.send(item)
            else:
                frame = item.header
                node.note_input(frame)
                send(item)
            if node.stop.is_set():
                break
        finish(frame)
        if video:
            video.send(VideoPacket(header=packet.numbered(packet.seq + 1, Mark.END)))
        if source.loss:
            node.say("running", source.loss)
            node.exit_code = EXIT_LOSS


def _frame_outlet(
    node: NodeProcess, config: DecodeNode, live: bool, stack: contextlib.ExitStack
) -> tuple[Callable[[Frame], None], Callable[[Header], None]]:
    """Where frames go: to the node that samples them, or to a rows stage in this process."""
    if config.frames == "fused":
        runner = Runner("rows", lambda: Rows(config.rows))
        rows = node.publisher(config.camera, "rows")

        def sample(frame: Frame) -> None:
            for block in runner.feed(frame):
                rows.send(block)

        def end(header: Header) -> None:
            sample(Frame(header=header.numbered(header.seq + 1, Mark.END)))

        return sample, end
    reader = node.sender_of("rows", config.camera)
    sender = FrameSender(
        node.publisher(config.camera, "frames", live=live),
        f"rsenf-{node.run_id}-{config.camera}" if config.frames == "ring" else "",
        config.ring_slots,
        lossless=not live,
        give_up=lambda: bool(reader) and node.peers.gone_for_s(reader) > 0,
    )
    stack.callback(sender.close)
    return sender.send, sender.finish


if __name__ == "__main__":
    sys.exit(run_node(body))

"""Decode: a video, a camera or the simulator in, frames and compressed packets out."""

from __future__ import annotations

import contextlib

from rsenf.config.node_kinds import DecodeNode
from rsenf.errors import EXIT_LOSS
from rsenf.messages import Frame, Header, Mark, VideoPacket
from rsenf.run.node import NodeProcess, run_node
from rsenf.run.outlets import open_outlet
from rsenf.run.sources import open_input


def body(node: NodeProcess) -> None:
    """Send every frame of the source, then the END marks."""
    config: DecodeNode = node.config
    with contextlib.ExitStack() as stack:
        source = stack.enter_context(open_input(config, node))
        outlet = open_outlet(node, config, live=source.info.live)
        stack.callback(outlet.close)
        live = source.info.live or config.pace
        far = live and bool(node.graph.hosts)
        video = node.publisher(config.camera, "video", live=far) if config.record_video else None
        node.ready()
        node.wait_for_peers(live=live)
        frame = packet = Header(
            run_id=node.run_id, source=f"{node.graph.site}/{config.camera}", seq=-1
        )
        for item in source:
            if isinstance(item, Frame):
                frame = item.header
                node.note_input(frame)
                outlet.send(item)
            elif video:
                packet = item.header
                video.send(item, more=True)
            if node.stop.is_set():
                break
        outlet.finish(frame)
        if video:
            video.send(VideoPacket(header=packet.numbered(packet.seq + 1, Mark.END)))
        if source.loss:
            node.exit_code = EXIT_LOSS
        node.say("running", "; ".join(filter(None, [source.loss, *source.warnings])))


if __name__ == "__main__":
    run_node(body)

"""Reference: a grid's measured frequency from a file, or as it is measured, onto the bus."""

from __future__ import annotations

from rsenf.config.node_kinds import ReferenceNode
from rsenf.messages import Header, Mark, ReferenceBlock
from rsenf.reference import open_reference, reference_blocks
from rsenf.run.node import NodeProcess, run_node
from rsenf.run.reference_feeds import publish_feed


def body(node: NodeProcess) -> None:
    """Publish the whole reference, or what goes on measuring it; then its END mark."""
    config: ReferenceNode = node.config
    if config.feed[0]:
        publish_feed(node)
        return
    reference = open_reference(
        config.input,
        store=config.store,
        timezone=config.timezone,
        step_s=config.step_s,
        column=config.column,
        nominal_hz=config.nominal_hz,
        stamp=config.stamp,
        grid=config.grid,
    )
    publisher = node.reference_publisher(config.grid)
    node.ready()
    node.wait_for_peers()
    source = f"reference/{config.grid}"
    header = Header(run_id=node.run_id, source=source)
    for block in reference_blocks(reference, source=source, run_id=node.run_id):
        publisher.send(block)
        header = block.header
    publisher.send(ReferenceBlock(header=header.numbered(header.seq + 1, Mark.END)))
    node.say("running", "; ".join(reference.notes))


if __name__ == "__main__":
    run_node(body)

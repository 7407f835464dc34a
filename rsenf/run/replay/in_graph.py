"""Replay nodes of a graph: their players, and whether they can play before anything is started."""

from __future__ import annotations

import time

from rsenf.config.node_kinds import ReplayNode
from rsenf.errors import RsenfError
from rsenf.run.replay.control import Control
from rsenf.run.replay.player import Player, Playing


def player_of(
    node: ReplayNode, site: str, *, run_id: str = "", control: Control | None = None
) -> Player:
    """Return the player that a node of a graph asks for; raises as :class:`Player`."""
    playing = Playing(
        topics=node.topics,
        rename=node.rename,
        site=site,
        rate=node.rate,
        start_s=node.start_s,
        end_s=node.end_s,
        loop=node.loop,
    )
    return Player(node.input, playing, run_id=run_id, clock_ns=time.time_ns, control=control)


def ensure_playable(name: str, node: ReplayNode, site: str) -> None:
    """Check a recording before other nodes begin, which may write over what was recorded before.

    Raises
    ------
    RsenfError
        As :class:`Player`, with the name of the node.
    """
    try:
        player_of(node, site)
    except RsenfError as exc:
        raise type(exc)(f"node {name!r}: {exc.message}", exc.hint) from exc

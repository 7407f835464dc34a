"""Runs an external node written in Python: bus, health, signals and shutdown are taken care of.

The environment tells it the bus and its name, as set by ``kind: external`` in a graph and by
``rsenf contract``. ``rsenf new-node`` writes an example, :mod:`rsenf.run.node_template`.
"""

from __future__ import annotations

import os
import secrets
import sys
from collections.abc import Callable
from typing import NoReturn

from rsenf.bus.zenoh_bus import BusSettings, open_bus
from rsenf.config import Graph
from rsenf.errors import EXIT_FAILED, RsenfError, UsageError
from rsenf.run.log import complain
from rsenf.run.node import NodeProcess, install_signals
from rsenf.run.process import end_process


def run_own_node(body: Callable[[NodeProcess], None]) -> NoReturn:
    """Run an external node until its body returns, and end the process.

    Parameters
    ----------
    body : callable
        Opens the node's streams, calls ``node.ready()``, and loops until ``node.stop`` is set.
    """
    code = EXIT_FAILED
    try:
        code = _run(body)
    except RsenfError as exc:
        complain(f"rsenf: {exc}", str(exc), node=os.environ.get("RSENF_NODE", ""))
        code = exc.exit_code
    finally:
        end_process(code)


def _run(body: Callable[[NodeProcess], None]) -> int:
    environ = os.environ
    if "RSENF_CONNECT" not in environ:
        raise UsageError("which bus? RSENF_CONNECT isn't set", "'rsenf run' tells its endpoint")
    name = environ.get("RSENF_NODE", "own")
    config = {
        "kind": "external",
        "command": sys.argv,
        "reads": environ.get("RSENF_READS", "").split(),
        "sends": environ.get("RSENF_SENDS", "").split(),
    }
    graph = Graph.model_validate(
        {"version": 1, "site": environ.get("RSENF_SITE", "own"), "nodes": {name: config}}
    )
    run_id = environ.get("RSENF_RUN_ID") or secrets.token_hex(4)
    restarts = int(environ.get("RSENF_RESTARTS", "0"))
    with open_bus(BusSettings(connect=(environ["RSENF_CONNECT"],))) as bus:
        node = NodeProcess(graph, name, run_id, bus, restarts)
        install_signals(node)
        # Started by a graph, it ends with its parent process; started by hand, it doesn't.
        with node.beating(os.getppid() if "RSENF_NODE" in environ else 0):
            return node.live(body)

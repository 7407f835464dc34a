"""Config: one schema, loaded from YAML, every problem with its file and line."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rsenf.config.graph import Graph
    from rsenf.config.load import load_graph, shown
    from rsenf.config.secrets import redact

# Loaded when asked for: a kind of node imports its base from here while the graph is made of it.
_HOMES = {"Graph": "graph", "load_graph": "load", "shown": "load", "redact": "secrets"}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)


__all__ = ["Graph", "load_graph", "redact", "shown"]

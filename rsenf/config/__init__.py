"""Graph files: one schema (pydantic), read from YAML; every problem is reported with its line.

In: the text of a graph, model or case file. Out: a validated :class:`Graph` (or ``CaseFile``, or
parameters of a model).

Read ``node_kind`` (base class of all kinds of nodes, and names) first; then ``graph`` (the schema),
``check`` (YAML with the lines of keys, validation, redaction) and ``load`` (the checks across
nodes). ``schemas`` has small ones of its own: recording, model file and case file.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rsenf.config.check import redact
    from rsenf.config.graph import Graph
    from rsenf.config.load import load_graph, shown

# Imported lazily: node kinds import their base class from here, and ``graph`` imports them.
_HOMES = {"Graph": "graph", "load_graph": "load", "shown": "load", "redact": "check"}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)


__all__ = ["Graph", "load_graph", "redact", "shown"]

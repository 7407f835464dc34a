"""Graph files: one schema (pydantic), read from YAML; every problem is reported with its line.

In: the text of a graph, model or case file. Out: a validated :class:`Graph` (or ``CaseFile``, or
parameters of a model).

Read ``names`` and ``node_kind`` (base class of all kinds of nodes) first; then ``graph`` (the
schema), ``yaml_lines`` (positions of keys), ``check`` (validation and messages), ``secrets``
(environment variables, redaction) and ``load`` (the checks across nodes). ``recording``,
``model_file`` and ``case_file`` are small schemas of their own.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rsenf.config.graph import Graph
    from rsenf.config.load import load_graph, shown
    from rsenf.config.secrets import redact

# Imported lazily: node kinds import their base class from here, and ``graph`` imports them.
_HOMES = {"Graph": "graph", "load_graph": "load", "shown": "load", "redact": "secrets"}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)


__all__ = ["Graph", "load_graph", "redact", "shown"]

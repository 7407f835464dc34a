"""Config: one schema, loaded from YAML, every problem with its file and line."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rsenf.config.check import check
from rsenf.config.graph import Graph
from rsenf.config.replayed import with_replayed
from rsenf.config.secrets import hide, redact
from rsenf.config.wiring import problems
from rsenf.config.yaml_lines import YamlText
from rsenf.errors import ConfigError


def load_graph(path: str | Path, replayed: Mapping[str, str] | None = None) -> Graph:
    """Read and check a graph file.

    Parameters
    ----------
    path : path
        The file.
    replayed : mapping, optional
        Recordings by the names of the nodes whose place they take.

    Raises
    ------
    UsageError, ConfigError
        When it can't be read, or has problems: all of them at once.
    """
    document = YamlText(Path(path))
    graph = check(document, Graph)
    if found := problems(graph):
        raise ConfigError([f"{document.place(at)}: {'.'.join(at)}: {t}" for at, t in found])
    return with_replayed(graph, replayed or {})


def shown(graph: Graph) -> dict[str, Any]:
    """Return a graph as it was read, defaults included and secrets hidden, as plain data."""
    return dict(hide(graph.model_dump(mode="json")))


__all__ = ["Graph", "load_graph", "redact", "shown"]

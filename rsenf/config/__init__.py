"""Config: one schema, loaded from YAML, every problem with its file and line."""

from pathlib import Path

from rsenf.config.check import check
from rsenf.config.graph import Graph
from rsenf.config.secrets import redact
from rsenf.config.yaml_lines import YamlText
from rsenf.errors import ConfigError


def load_graph(path: str | Path) -> Graph:
    """Read and check a graph file.

    Raises
    ------
    UsageError, ConfigError
        When it can't be read, or has problems: all of them at once.
    """
    document = YamlText(Path(path))
    graph = check(document, Graph)
    problems = [f"{document.place(at)}: {text}" for at, text in graph.problems()]
    if problems:
        raise ConfigError(problems)
    return graph


__all__ = ["Graph", "load_graph", "redact"]

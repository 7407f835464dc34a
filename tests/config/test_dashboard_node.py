"""What a graph tells its dashboard."""

from __future__ import annotations

from pathlib import Path

import pytest

from rsenf.config import load_graph
from rsenf.dashboard.site import key_expressions, wiring_of
from rsenf.errors import ConfigError

GRAPH = """\
version: 1
site: lab
nodes:
  door:  {{kind: decode, camera: door, input: clip.mp4}}
  yard:  {{kind: decode, camera: yard, input: clip.mp4, frames: fused}}
  rows:  {{kind: rows, cameras: [door]}}
  track: {{kind: track, cameras: [door, yard]}}
  keep:  {{kind: record, archive: kept}}
  page:  {{kind: dashboard, {page}}}
"""


def graph_of(tmp_path: Path, page: str = "port: 0"):
    path = tmp_path / "graph.yaml"
    path.write_text(GRAPH.format(page=page), encoding="utf-8")
    return load_graph(path)


def test_the_nodes_of_each_feed_and_the_archive_are_known(tmp_path):
    wiring = wiring_of(graph_of(tmp_path))
    assert wiring.nodes == {
        "lab/door": ["door", "rows", "track"],
        "lab/yard": ["yard", "track"],
    }
    assert wiring.archive == Path("kept")
    assert wiring.judged == frozenset()
    assert key_expressions(wiring) == ["rsenf/lab/door/frames"]
    assert wiring_of(graph_of(tmp_path), "other").archive == Path("other")


@pytest.mark.parametrize(
    ("page", "said"),
    [("port: 70000", "port"), ("topics: ['a//b']", "no key expression"), ("hots: x", "host")],
)
def test_a_mistake_has_its_line(tmp_path, page, said):
    with pytest.raises(ConfigError, match=r"graph\.yaml:9") as refused:
        graph_of(tmp_path, page)
    assert said in str(refused.value)

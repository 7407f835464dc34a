"""What a graph's reference may be: files, and what goes on measuring."""

from __future__ import annotations

from pathlib import Path

import pytest
from rsenf_nodes.reference import ReferenceNode

from rsenf.config import load_graph
from rsenf.errors import ConfigError

GRAPH = """\
version: 1
site: lab
nodes:
  decode: {{kind: decode, camera: cam1, input: clip.mp4, frames: fused}}
  track:  {{kind: track, cameras: [cam1]}}
  grid:   {{kind: reference, grid: ce, input: "{input}"}}
"""


def written(folder: Path, read: str) -> Path:
    path = folder / "g.yaml"
    path.write_text(GRAPH.format(input=read), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("read", "feed"),
    [
        ("camera:cam1", ("camera", "cam1")),
        ("sound:", ("sound", "")),
        ("sound:USB Audio", ("sound", "USB Audio")),
        ("topic:rsenf/lab/reference/other", ("topic", "rsenf/lab/reference/other")),
        ("grid.csv", ("", "")),
        ("store:ce@1", ("", "")),
    ],
)
def test_what_goes_on_measuring_is_told_from_files(
    tmp_path: Path, read: str, feed: tuple[str, str]
) -> None:
    node = load_graph(written(tmp_path, read)).nodes["grid"]
    assert isinstance(node, ReferenceNode)
    assert node.feed == feed


@pytest.mark.parametrize(
    ("read", "problem"),
    [
        ("camera:cam2", "g.yaml:6: nodes.grid.input: nobody sends the track of camera 'cam2'"),
        ("camera:a/b", "g.yaml:6: nodes.grid.input: no name"),
        ("topic:rsenf/*/reference/x", "g.yaml:6: nodes.grid.input: no key of a reference"),
        ("topic:rsenf/lab/reference/ce", "g.yaml:6: nodes.grid.input: that is this node's own"),
        ('camera:cam1", follow: "yes', "g.yaml:6: nodes.grid.follow: camera:cam1 is no file"),
    ],
)
def test_what_cannot_be_one(tmp_path: Path, read: str, problem: str) -> None:
    with pytest.raises(ConfigError, match=problem):
        load_graph(written(tmp_path, read))


@pytest.mark.parametrize("kind", ["live", "match"])
def test_no_camera_bears_witness_for_itself(tmp_path: Path, kind: str) -> None:
    path = written(tmp_path, "camera:cam1")
    with path.open("a", encoding="utf-8") as file:
        file.write(f"  judge:  {{kind: {kind}, cameras: [cam1], grid: ce}}\n")
    with pytest.raises(ConfigError, match=r"g\.yaml:7: nodes\.judge\.cameras: .* with itself"):
        load_graph(path)

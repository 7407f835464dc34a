"""A graph split over hosts: what is wrong with the split is said by line."""

from __future__ import annotations

from pathlib import Path

import pytest

from rsenf.config import load_graph
from rsenf.config.graph import elsewhere, host_of
from rsenf.errors import ConfigError, UsageError
from rsenf.run.supervisor import check_host, router_settings

GOOD = """\
version: 1
site: lab
hosts:
  cam: {nodes: [decode], links: [hub]}
  lab: {nodes: [rows, track, record], links: [hub]}
  hub: {address: tcp/192.0.2.1:7447, listen: [tcp/0.0.0.0:7447]}
nodes:
  decode: {kind: decode, camera: cam1, input: clip.mp4, frames: tcp}
  rows:   {kind: rows, cameras: [cam1]}
  track:  {kind: track, cameras: [cam1]}
  record: {kind: record, out: all.mcap}
"""


def written(folder: Path, *changes: tuple[str, str]) -> Path:
    text = GOOD
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = folder / "g.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def test_each_host_opens_a_router_for_its_nodes_and_links_it(tmp_path: Path) -> None:
    graph = load_graph(written(tmp_path))
    assert host_of(graph, "track") == "lab"
    assert elsewhere(graph, "track") == {"decode"}
    own = ("tcp/127.0.0.1:1",)
    cam, hub = (router_settings(graph, own, host) for host in ("cam", "hub"))
    assert (cam.mode, cam.listen, cam.connect) == ("router", own, ("tcp/192.0.2.1:7447",))
    assert (hub.listen, hub.connect) == ((*own, "tcp/0.0.0.0:7447"), ())


@pytest.mark.parametrize(
    ("old", "new", "line", "says"),
    [
        ("[decode]", "[decode, decod]", 4, "no node 'decod' in this graph"),
        ("[decode]", "[decode, rows]", 5, "node 'rows' runs on host 'cam' already"),
        ("[decode]", "[decode, decode]", 4, "'decode' stands here twice"),
        ("rows, track, record", "rows, track", 11, "runs on no host; one of cam, lab, hub"),
        ("[decode], links: [hub]", "[decode], links: [hob]", 4, "no host 'hob'; one of cam"),
        ("[decode], links: [hub]", "[decode], links: [lab]", 4, "'lab' has no address"),
        ("record], links: [hub]", "record]", 5, "no links lead from here to host 'cam'"),
        ("tcp/192.0.2.1:7447,", "192.0.2.1,", 6, "'192.0.2.1': no setting of Zenoh"),
        (", frames: tcp", "", 8, "node 'rows' reads them on host 'lab'; use 'tcp' or 'fused'"),
        ("site: lab", "site: lab\nbus: {connect: [tcp/a:1]}", 3, "routers of their own"),
    ],
)
def test_what_does_not_hold_together_is_said_by_line(
    tmp_path: Path, old: str, new: str, line: int, says: str
) -> None:
    path = written(tmp_path, (old, new))
    with pytest.raises(ConfigError) as caught:
        load_graph(path)
    assert any(p.startswith(f"{path}:{line}: ") and says in p for p in caught.value.problems)


def test_a_host_has_to_be_one_of_the_graph(tmp_path: Path) -> None:
    graph = load_graph(written(tmp_path))
    check_host(graph, "lab")
    with pytest.raises(UsageError, match="no host 'hob'"):
        check_host(graph, "hob")
    with pytest.raises(UsageError, match="split over hosts"):
        check_host(graph, "")

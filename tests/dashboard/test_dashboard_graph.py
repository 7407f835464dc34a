"""A real graph shows itself, and a bus is looked at from outside."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys

import pytest

from rsenf.cli import main
from rsenf.run.process import Patience
from tests.conftest import ROOT

GRAPH = """\
version: 1
site: lab
bus: {{listen: ["{endpoint}"]}}
nodes:
  decode: {{kind: decode, camera: cam1, input: {{model: "{model}"}}, pace: true}}
  rows:   {{kind: rows, cameras: [cam1]}}
  track:  {{kind: track, cameras: [cam1]}}
  page:   {{kind: dashboard, port: 0}}
"""


def start(*words):
    return subprocess.Popen(
        [sys.executable, "-m", "rsenf.cli", *map(str, words)],
        stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


def url_told(process):
    """Address that a process says it serves at."""
    for line in process.stderr:
        found = re.search(r"http://[\d.:]+/", line)
        if found:
            return found[0]
    raise AssertionError("it serves nothing")


def card_when(url, is_there):
    client = pytest.importorskip("websockets.sync.client")
    patience = Patience(40.0)
    card = {}
    with client.connect(url.replace("http", "ws") + "news") as socket:
        while not patience.over:
            for card in json.loads(socket.recv()).get("cards", []):
                if is_there(card):
                    return card
    raise AssertionError(f"never so: {card}")


@pytest.mark.processes
def test_a_graph_shows_its_camera_and_so_does_a_look_from_outside(tmp_path):
    pytest.importorskip("uvicorn", reason="uvicorn isn't installed")
    from rsenf.bus.zenoh_bus import free_endpoint

    graph = tmp_path / "graph.yaml"
    model = ROOT / "configs" / "model" / "changing_120p.yaml"
    graph.write_text(GRAPH.format(model=model, endpoint=free_endpoint()), encoding="utf-8")
    running = start("run", graph)
    try:
        card = card_when(url_told(running), lambda c: c["steady_ratio"] and c["picture"])
        assert card["name"] == "lab/cam1"
        assert set(card["nodes"]) == {"decode", "rows", "track"}
        looking = start("dashboard", graph, "--port", 0)
        try:
            seen = card_when(url_told(looking), lambda c: c["steady_ratio"])
            assert seen["name"] == "lab/cam1"
            looking.send_signal(signal.SIGINT)
            assert looking.wait(15) == 0
        finally:
            looking.kill()
            looking.communicate()
        running.send_signal(signal.SIGINT)
        assert running.wait(15) in (0, 130)
    finally:
        running.kill()
        running.communicate()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((), "which bus?"),
        (("--connect", "tcp/127.0.0.1:1", "--port", "70000"), "port 70000"),
        (("--connect", "tcp/127.0.0.1:1"), "no bus at tcp/127.0.0.1:1"),
        (("configs/rtsp.yaml",), "wherever a port was free"),
    ],
)
def test_what_cannot_be_shown_is_said_in_a_line(words, said, capsys, monkeypatch):
    monkeypatch.setenv("CAMERA", "rtsp://192.0.2.7/x")
    monkeypatch.setenv("OUT", "x.mcap")
    assert main(["dashboard", *words]) in (1, 2)
    told = capsys.readouterr().err
    assert said in told
    assert len(told.splitlines()) == 1

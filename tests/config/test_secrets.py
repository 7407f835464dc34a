"""No password in anything that is printed, logged or recorded."""

from __future__ import annotations

import argparse
import json
import os
import pickle
import subprocess
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rsenf.cli.console import fill_env
from rsenf.config import load_graph, redact, shown
from rsenf.config.check import hide
from rsenf.errors import ConfigError, UsageError
from rsenf.run.graph_changes import begun_anew

Rsenf = Callable[..., subprocess.CompletedProcess[str]]
SECRET = "hunter2"

GRAPH = """\
version: 1
site: lab
bus:
  connect: [tls/router:7447]
  zenoh:
    transport/auth/usrpwd/user: bob
    transport/auth/usrpwd/password: hunter2
    transport/link/tls/connect_private_key: |
      hunter2
nodes:
  decode: {kind: decode, camera: cam1, input: "rtsp://admin:hunter2@10.0.0.7/cam", frames: tcp}
  other:  {kind: decode, camera: cam2, input: "rtsp://10.0.0.8/?password=hunter2", frames: tcp}
"""


@pytest.mark.parametrize(
    "text",
    [
        "rtsp://admin:hunter2@10.0.0.7/cam: connection refused",
        "read: 'rtsp://admin:hunter2@host/x'",
        "rtsp://host/x?user=a&password=hunter2",
        "password: hunter2",
        "  transport/auth/usrpwd/password: 'hunter2 hunter2'",
        '{"password": "hunter2 hunter2", "a": 1}',
        "{user: a, Password: hunter2}",
        "CAMERA_TOKEN=hunter2",
    ],
)
def test_lines_of_text(text: str) -> None:
    assert SECRET not in redact(text)
    assert "***" in redact(text)


def test_what_is_no_secret_stays() -> None:
    for text in ("nothere.mp4: no such file", "tcp/127.0.0.1:7447", "file:3: nodes.a: no name"):
        assert redact(text) == text


def test_a_password_that_was_replaced_begins_its_node_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "g.yaml"
    notify = "{kind: notify, queue: q.db, to: [{via: webhook, url: 'http://a/b', secret_env: KEY}]}"
    page = "{kind: dashboard, password_env: PW}"
    path.write_text(f"version: 1\nsite: lab\nnodes:\n  page: {page}\n  notify: {notify}\n")
    graphs = []
    for password, key in (("old", "k"), ("old", "k"), ("hunter2", "k"), ("hunter2", "l")):
        monkeypatch.setenv("PW", password)
        monkeypatch.setenv("KEY", key)
        graphs.append(load_graph(path))
    anew = [begun_anew(old, new) for old, new in pairwise(graphs)]
    assert anew == [set(), {"page"}, {"page", "notify"}]
    assert SECRET not in str(pickle.dumps(graphs[-1]))


def test_the_graph_as_shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "g.yaml"
    path.write_text(GRAPH.replace("admin:hunter2", "admin:${PW}"), encoding="utf-8")
    monkeypatch.setenv("PW", SECRET)
    graph = load_graph(path)
    text = json.dumps(shown(graph))
    assert SECRET not in text
    assert "admin" not in text
    assert '"transport/auth/usrpwd/user": "bob"' in text
    # The nodes themselves do get it.
    assert graph.bus.zenoh["transport/auth/usrpwd/password"] == SECRET
    assert f"admin:{SECRET}@" in str(graph.nodes["decode"])


def test_an_endpoint_that_holds_a_key() -> None:
    assert SECRET not in str(hide(["tls/h:7447#connect_private_key_base64=hunter2;x=1"]))


@pytest.mark.parametrize(
    "change",
    [
        ("bob", "bob\n    transport/auth/usrpwd/pasword: hunter2"),
        ("camera: cam1", "camera: 'rtsp://admin:hunter2@10.0.0.7/cam'"),
        ("frames: tcp}", "frames: 'rtsp://admin:hunter2@10.0.0.7/cam'}"),
        ("site: lab", "site: lab\npassword: hunter2"),
        ("site: lab", "site: lab\nsite: rtsp://a:hunter2@b"),
        ("password: hunter2", "password: [hunter2, 1"),
    ],
)
def test_problems_do_not_tell(tmp_path: Path, change: tuple[str, str]) -> None:
    path = tmp_path / "g.yaml"
    path.write_text(GRAPH.replace(*change, 1), encoding="utf-8")
    with pytest.raises(ConfigError) as caught:
        load_graph(path)
    assert SECRET not in str(caught.value)


@given(st.text(max_size=30), st.integers(0, 5))
def test_hiding_reaches_any_depth_and_keeps_the_rest(word: str, depth: int) -> None:
    value: object = {"password": "x", "plain": word.replace("://", "")}
    for _ in range(depth):
        value = {"more": [value, 1, None]}
    hidden = hide(value)
    for _ in range(depth):
        assert hidden["more"][1:] == [1, None]
        hidden = hidden["more"][0]
    assert hidden == {"password": "***", "plain": word.replace("://", "")}


def test_variables_of_a_file_go_with_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("GONE", "NEW"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("KEPT", "the shell's")
    args = argparse.Namespace(env=tmp_path / "graph.env")

    def filled(text: str) -> dict[str, str]:
        args.env.write_text(text, encoding="utf-8")
        fill_env(args)
        return {name: os.environ[name] for name in ("GONE", "KEPT", "NEW") if name in os.environ}

    assert filled("GONE=1\nKEPT='the file''s'\n") == {"GONE": "1", "KEPT": "the files"}
    assert filled("NEW=2\n") == {"KEPT": "the shell's", "NEW": "2"}
    with pytest.raises(UsageError, match=r"graph\.env:2: no variable"):
        filled("KEPT=3\nno variable\n")
    assert filled("") == {"KEPT": "the shell's"}


def test_every_verb_of_a_graph_takes_its_variables(rsenf: Rsenf, tmp_path: Path) -> None:
    """A graph by 'rsenf init' names its cameras' addresses by variables."""
    graph, variables = tmp_path / "graph.yaml", tmp_path / "graph.env"
    text = GRAPH.replace("rtsp://admin:hunter2@10.0.0.7/cam", "${URL_CAM1}")
    graph.write_text(text.replace("tls/router:7447", "tcp/127.0.0.1:9"), encoding="utf-8")
    variables.write_text("URL_CAM1=rtsp://admin:hunter2@10.0.0.7/cam\n", encoding="utf-8")
    for words in (["nodes", graph], ["topic", "list", "--graph", graph], ["dashboard", graph]):
        refused = rsenf(*words)
        assert "environment variable URL_CAM1 is not set" in refused.stderr
        found = rsenf(*words, "--env", variables)
        assert "no bus at tcp/127.0.0.1:9" in found.stderr

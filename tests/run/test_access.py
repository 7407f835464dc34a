"""Who may do what between hosts: by certificate, and by key."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from rsenf.bus import zenoh_bus
from rsenf.bus.zenoh_bus import BusSettings, free_endpoint, open_bus, setting_problem
from rsenf.cli import main
from rsenf.config import load_graph
from rsenf.errors import ConfigError, RsenfError, UsageError
from rsenf.run.access import Refusals, secured, sent_by
from rsenf.run.process import wait_until
from tests.conftest import ROOT

GRAPH = """\
version: 1
site: lab
hosts:
  cam:  {{nodes: [decode], links: [hub]}}
  lab:  {{nodes: [track], links: [hub]}}
  hub:  {{address: "{address}"}}
tls:    {{ca: "{f}/ca.pem", certificate: "{f}/{{host}}.pem", key: "{f}/{{host}}.key"}}
access: {{meter: {{publish: [reference/ce]}}, viewer: {{}}}}
nodes:
  decode: {{kind: decode, camera: cam1, input: clip.mp4, frames: fused}}
  track:  {{kind: track, cameras: [cam1]}}
"""
CAM_KEYS = [
    "rsenf/@echo",
    "rsenf/lab/cam1/rows",
    "rsenf/lab/cam1/video",
    "rsenf/lab/@nodes/decode/health",
    "rsenf/lab/@nodes/decode/word",
    "rsenf/lab/@nodes/decode/alive",
    "rsenf/lab/reference/ce",
]


def graph_file(folder: Path, address: str = "tls/localhost:7447") -> Path:
    path = folder / "hosts.yaml"
    path.write_text(GRAPH.format(f=folder, address=address), encoding="utf-8")
    return path


def test_a_host_may_send_what_its_nodes_send_and_nothing_else(tmp_path: Path) -> None:
    graph = load_graph(graph_file(tmp_path))
    assert sent_by(graph, "hub", "cam") == CAM_KEYS
    assert sent_by(graph, "hub", "meter") == ["rsenf/lab/reference/ce"]
    assert sent_by(graph, "hub", "viewer") == []
    # To the camera's router all others come by way of the hub.
    assert "rsenf/lab/cam1/track" in sent_by(graph, "cam", "hub")
    assert "rsenf/lab/cam1/rows" not in sent_by(graph, "cam", "hub")


def test_a_missing_certificate_is_named(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"ca\.pem: no such file"):
        secured(load_graph(graph_file(tmp_path)), "hub")


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("tls/localhost:7447", "tcp/localhost:7447", "goes past the certificates"),
        ("[reference/ce]", "['a//b']", "no key expression"),
        ("tls:", "# tls:", "nobody can be told apart without 'tls'"),
    ],
)
def test_what_would_not_be_safe_is_no_graph(tmp_path: Path, old: str, new: str, says: str) -> None:
    path = graph_file(tmp_path)
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(ConfigError, match=says):
        load_graph(path)


TRACE = "TRACE rx-0 ThreadId(10) zenoh::net::routing::interceptor"
SESSION = "d9 on Interface(eth0)+CertCommonName(cam)+Transport(Tls)+d9"
PUT = "is unauthorized to Put (ingress) on rsenf/lab/cam2/rows"
CAM_PUTS = "cam may not put rsenf/lab/cam2/rows"
HELD_UP = f"{TRACE}: Msg intercepted!"


@pytest.mark.parametrize(
    ("lines", "says"),
    [
        (
            [f"{TRACE}::access_control: {SESSION} {PUT}", HELD_UP],
            CAM_PUTS,
        ),
        (
            [
                f"{TRACE}::access_control: {SESSION} is authorized to Query (ingress) on rsenf",
                f"{TRACE}::access_control: Using cached result: d9 {PUT}",
                HELD_UP,
            ],
            CAM_PUTS,
        ),
        # Told beforehand, of what nobody has tried.
        ([f"{TRACE}::access_control: {SESSION} {PUT}"], ""),
        (["WARN peer sent no certificates. Hint: …"], "somebody without a certificate"),
        (
            ["WARN invalid peer certificate: BadSignature. Hint: …"],
            "somebody with a wrong certificate (BadSignature)",
        ),
    ],
)
def test_a_refusal_in_one_line(lines: list[str], says: str) -> None:
    told: list[str] = []
    refusals = Refusals(told.append)
    for line in lines:
        refusals.take(line)
    assert told == ([f"refused: {says}"] if says else [])


def test_who_tries_again_and_again_is_told_once() -> None:
    told: list[str] = []
    refusals = Refusals(told.append)
    for _ in range(50):
        refusals.take("WARN peer sent no certificates.")
    assert told == ["refused: somebody without a certificate"]


@pytest.fixture(scope="module")
def certificates(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Certificates of one authority for some, and of another for 'cam' below 'other'."""
    if shutil.which("openssl") is None:
        pytest.skip("openssl, which makes the certificates, is not installed")
    folder = tmp_path_factory.mktemp("certificates")
    script = ROOT / "configs" / "deploy" / "certificates.sh"
    for below, names in ((folder, ["hub", "cam", "viewer"]), (folder / "other", ["cam"])):
        subprocess.run(["sh", str(script), str(below), *names], check=True, capture_output=True)
    return folder


@pytest.fixture(scope="module")
def hub(certificates: Path) -> Iterator[tuple[str, Path]]:
    """A host without nodes, run as anybody would; its endpoint and its log."""
    address = free_endpoint().replace("tcp/127.0.0.1", "tls/localhost")
    graph, log = graph_file(certificates, address), certificates / "hub.log"
    command = [sys.executable, "-m", "rsenf.cli", "run", str(graph), "--host", "hub"]
    with log.open("wb") as stream, subprocess.Popen(command, stderr=stream) as process:
        assert wait_until(lambda: b"bus at" in log.read_bytes(), 30)
        yield address, log
        process.terminate()


def opened(address: str, folder: Path, name: str = "") -> Any:
    """A client with a certificate, or without one."""
    tls: dict[str, Any] = {"root_ca_certificate": str(folder / "ca.pem")}
    if name:
        tls |= {
            "enable_mtls": True,
            "connect_certificate": str(folder / f"{name}.pem"),
            "connect_private_key": str(folder / f"{name}.key"),
        }
    return open_bus(BusSettings(connect=(address,), zenoh={"transport/link/tls": tls}))


@pytest.mark.processes
def test_who_is_not_known_or_not_allowed_is_refused_and_told(
    certificates: Path, hub: tuple[str, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(zenoh_bus, "CONNECT_TIMEOUT_MS", 700)
    address, log = hub
    foreign = certificates / "foreign"
    foreign.mkdir()
    shutil.copy(certificates / "ca.pem", foreign)  # knows the hub, but is not known to it
    for end in ("pem", "key"):
        shutil.copy(certificates / "other" / f"cam.{end}", foreign)
    for name in ("", "cam"):
        with pytest.raises(RsenfError, match="certificate"), opened(address, foreign, name):
            pass
    with opened(address, certificates, "cam") as cam, opened(address, certificates, "viewer") as v:
        heard: list[str] = []
        sub = v._session.declare_subscriber("rsenf/**", lambda s: heard.append(str(s.key_expr)))
        video = "rsenf/lab/cam1/video"
        assert wait_until(lambda: bool(cam._session.put(video, b"x")) or video in heard)
        for key in ("rsenf/lab/cam2/rows", "rsenf/lab/cam1/rows"):
            cam._session.put(key, b"x")
        # One after the other: Zenoh tells what it holds up by thread, not by message.
        assert wait_until(lambda: "cam may not put" in log.read_text(encoding="utf-8"))
        # Zenoh sends only what somebody else listens to, and the hub may learn of it late.
        forged = "rsenf/lab/cam1/enf"
        listening = cam._session.declare_subscriber(forged)
        assert wait_until(
            lambda: (
                bool(v._session.put(forged, b"x"))
                or "viewer may not put" in log.read_text(encoding="utf-8")
            )
        )
        assert wait_until(lambda: heard.count("rsenf/lab/cam1/rows") == 1)
        cam._session.put("rsenf/lab/cam1/rows", b"x")  # it goes on
        assert wait_until(lambda: heard.count("rsenf/lab/cam1/rows") == 2)
        sub.undeclare()
        listening.undeclare()
    assert "rsenf/lab/cam2/rows" not in heard
    for said in (
        "refused: somebody without a certificate",
        "refused: somebody with a wrong certificate",
        "refused: cam may not put rsenf/lab/cam2/rows",
        f"refused: viewer may not put {forged}",
    ):
        assert wait_until(lambda said=said: said in log.read_text(encoding="utf-8"))
        assert log.read_text(encoding="utf-8").count(said) == 1


@pytest.mark.processes
def test_who_looks_shows_a_certificate(
    hub: tuple[str, Path], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("RSENF_CONNECT", raising=False)
    looking = ["nodes", str(hub[1].parent / "hosts.yaml"), "--for-s", "0.3"]
    assert main(looking) == 2
    assert "--as NAME" in capsys.readouterr().err
    assert main([*looking, "--as", "viewer"]) == 0
    assert "lab/decode" in capsys.readouterr().out
    assert main([*looking, "--as", "nobody"]) == 2
    assert "nobody.pem: no such file" in capsys.readouterr().err


def test_the_rules_are_zenohs(certificates: Path) -> None:
    settings = secured(load_graph(graph_file(certificates)), "hub")
    assert [setting_problem(path, value) for path, value in settings.items()] == ["", ""]
    assert os.fspath(certificates) in settings["transport/link/tls"]["listen_private_key"]

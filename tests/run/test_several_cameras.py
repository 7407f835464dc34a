"""Several cameras with passwords: they come and go, and nothing that is left holds a password."""

from __future__ import annotations

import base64
import json
import os
import re
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import quote

import pytest
from live_run import LiveRun
from mcap.reader import make_reader

from rsenf.bus.inbox import Inbox
from rsenf.bus.keys import LOOKING, camera_key, health_key
from rsenf.bus.zenoh_bus import BusSettings, free_endpoint, open_bus
from rsenf.messages import encode
from rsenf.record import open_recording
from rsenf.run.process import Patience
from tests.decode import rtsp_server
from tests.decode.rtsp_server import RtspServer

pytestmark = [pytest.mark.processes, pytest.mark.external]

USER, PASSWORD = "viewer", "hush:9/m@us e?x=1"
WRONG = "n0t%the&one"
ENCODED = quote(PASSWORD, safe="")
GRAPH = """\
version: 1
site: lab
nodes:
  door: {kind: decode, camera: door, input: "${DOOR}", threads: 1, frames: fused,
         backoff_initial_s: 0.2, backoff_max_s: 0.5}
  yard: {kind: decode, camera: yard, input: "${YARD}", threads: 1, frames: fused}
  shut: {kind: decode, camera: shut, input: "${SHUT}", threads: 1, frames: fused,
         wait_for_source: true, backoff_initial_s: 0.2, backoff_max_s: 0.5}
  track: {kind: track, cameras: [door, yard, shut]}
  page: {kind: dashboard, port: 0}
  record: {kind: record, out: "${OUT}"}
"""


def secrets() -> set[bytes]:
    """The passwords in every form that somebody may have brought them into."""
    out = {PASSWORD, ENCODED, quote(PASSWORD), WRONG, quote(WRONG, safe=""), "hush:9", "hush%3A9"}
    logins = {f"{USER}:{word}" for word in (PASSWORD, ENCODED, WRONG)}
    return {word.encode() for word in out} | {base64.b64encode(x.encode()) for x in logins}


def leaks(what: bytes) -> list[bytes]:
    return sorted(word for word in secrets() if word in what)


def command_lines() -> bytes:
    """Arguments of all processes of this machine."""
    lines = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                lines.append((entry / "cmdline").read_bytes())
            except OSError:
                continue
    return b"\n".join(lines)


def contents(recording: Path) -> Iterator[bytes]:
    """Everything in a recording, as it lies there and unpacked."""
    yield recording.read_bytes()
    with recording.open("rb") as file:
        reader = make_reader(file)
        for schema, channel, message in reader.iter_messages():
            yield channel.topic.encode() + b" " + message.data
            yield b"" if schema is None else schema.name.encode()
        yield from (json.dumps(found.metadata).encode() for found in reader.iter_metadata())
        yield from (found.data for found in reader.iter_attachments())


def fetched(url: str) -> bytes:
    with urllib.request.urlopen(url) as answer:
        return bytes(answer.read())


def shown(said: str) -> bytes:
    """What the dashboard serves: its page, and what it tells a browser that looks at a camera."""
    client = pytest.importorskip("websockets.sync.client")
    found = re.search(r"http://[\d.:]+/", said)
    assert found is not None, said
    parts = [fetched(found[0])]
    with client.connect(found[0].replace("http", "ws") + "news") as socket:
        for camera in ("door", "shut"):
            socket.send(json.dumps({"feed": f"lab/{camera}"}))
            parts += [str(socket.recv()).encode() for _ in range(2)]
    return b"\n".join(parts)


def until(inbox: Inbox, camera: str, epoch: int) -> list[bytes]:
    """Wait for rows of an epoch; return all that was heard meanwhile."""
    heard, patience = [], Patience(60.0)
    while not patience.over:
        received = inbox.receive(1.0)
        if received is None:
            continue
        heard.append(received.payload)
        is_rows = received.key == camera_key("lab", camera, "rows")
        if is_rows and received.message.header.epoch == epoch:
            return heard
    raise AssertionError(f"no rows of {camera} in epoch {epoch}")


def test_cameras_with_passwords(tmp_path: Path, live_run: type[LiveRun]) -> None:
    if lacking := rtsp_server.missing():
        pytest.skip(lacking)
    path, out, inbox = tmp_path / "g.yaml", tmp_path / "o.mcap", Inbox()
    path.write_text(GRAPH, encoding="utf-8")
    login = {"user": USER, "password": PASSWORD}
    with RtspServer(**login) as door, RtspServer("h265", **login) as yard:
        environment = {
            **os.environ,
            "DOOR": door.url,
            "YARD": yard.url,
            "SHUT": door.url.replace(ENCODED, quote(WRONG, safe="")),
            "OUT": str(out),
        }
        assert ENCODED in door.url
        assert environment["SHUT"] != door.url
        metrics = free_endpoint().removeprefix("tcp/")
        run = live_run(path, "--json", "--metrics", metrics, env=environment)
        run.until("running", "door", "yard", "shut", "track", "record", "page")
        with open_bus(BusSettings(connect=(run.endpoint,))) as bus:
            for key in (camera_key("lab", "*", "rows"), health_key("lab", "*")):
                bus.subscribe(inbox, key, LOOKING)
            heard = until(inbox, "door", 0) + until(inbox, "yard", 0)
            door.kill()
            with RtspServer(port=door.port, **login):
                heard += until(inbox, "door", 1)
                seen, page = command_lines(), shown("\n".join(run.lines))
                measured = fetched(f"http://{metrics}/metrics")
                run.interrupt()
    assert run.process.stdout is not None
    printed = run.process.stdout.read()
    nodes = json.loads(printed)["nodes"]
    said = "\n".join(run.lines)
    assert "the user or password is refused" in said
    assert "it was away for" in said
    assert "Traceback" not in said
    assert nodes["yard"]["exit_code"] == 0

    assert b"rsenf_nodes" in seen
    assert b"lab/door" in page
    assert leaks(seen) == []
    assert leaks(page) == []
    assert b'node="door"' in measured
    assert leaks(measured) == []
    assert leaks(printed.encode()) == []
    assert leaks(said.encode()) == []
    assert [leaks(payload) for payload in heard if leaks(payload)] == []
    assert [leaks(part) for part in contents(out) if leaks(part)] == []
    # It can be found where it is.
    assert leaks(environment["DOOR"].encode())
    assert leaks(environment["SHUT"].encode())

    # The camera that was away is recorded as such, and the other wasn't touched.
    epochs: dict[str, set[int]] = {}
    words = []
    for topic, message, _ in open_recording(out).messages():
        if topic.endswith("/video") and not message.header.is_end:
            epochs.setdefault(topic.split("/")[-2], set()).add(message.header.epoch)
        if topic.endswith("/health"):
            words.append(encode(message))
    assert epochs == {"door": {0, 1}, "yard": {0}}
    assert any(b"it was away for" in word for word in words)

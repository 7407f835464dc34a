"""Alarms reach people: each once, none lost while the other side, or rsenf, is away."""

from __future__ import annotations

import hashlib
import hmac
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest
from conftest import Film, Graphs
from live_run import LiveRun
from rsenf_nodes.notify import EmailTarget, MqttTarget, NotifyNode, ProgramTarget, WebhookTarget

from rsenf.bus.inbox import Received
from rsenf.config import Graph
from rsenf.errors import UsageError
from rsenf.messages import Alarm, Header
from rsenf.run import notify
from rsenf.run.notify import Notifier
from rsenf.run.process import wait_until

SECRET = "s3cret-of-the-hook"


@pytest.fixture(autouse=True)
def short_pauses(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(notify, "PAUSES_S", (0.05,))
    monkeypatch.setenv("HOOK_KEY", SECRET)


def received(
    seq: int, kind: str = "stale", *, active: bool = True, run: str = "r1", camera: str = "cam"
) -> Received:
    header = Header(run_id=run, source=f"lab/{camera}", seq=seq)
    alarm = Alarm(header=header, kind=kind, severity="alarm", active=active, text=f"text {seq}")
    return Received(f"rsenf/lab/{camera}/alarm", alarm, b"")


class Hook:
    """An HTTP server that can go away and come back at its port."""

    def __init__(self) -> None:
        self.bodies: list[dict[str, Any]] = []
        self.signed: list[bool] = []
        self.status = 200
        self.port = 0
        self._server: ThreadingHTTPServer | None = None
        self.open()

    def open(self) -> None:
        hook = self

        class Handler(BaseHTTPRequestHandler):
            def do_POST(self) -> None:
                data = self.rfile.read(int(self.headers["Content-Length"]))
                if hook.status == 200:
                    hook.bodies.append(json.loads(data))
                    mac = hmac.new(SECRET.encode(), data, hashlib.sha256).hexdigest()
                    hook.signed.append(self.headers["X-Rsenf-Signature"] == f"sha256={mac}")
                self.send_response(hook.status)
                self.end_headers()

            def log_message(self, *_: object) -> None:
                pass

        self._server = ThreadingHTTPServer(("127.0.0.1", self.port), Handler)
        self.port = self._server.server_port
        threading.Thread(target=self._server.serve_forever, daemon=True).start()

    def close(self) -> None:
        if self._server is not None:
            self._server.shutdown()
            self._server.server_close()
            self._server = None

    @property
    def target(self) -> WebhookTarget:
        return WebhookTarget(
            via="webhook", url=f"http://127.0.0.1:{self.port}/x", secret_env="HOOK_KEY"
        )


@pytest.fixture
def hook() -> Iterator[Hook]:
    made = Hook()
    yield made
    made.close()


@contextmanager
def notifier(
    folder: Path, *targets: Any, run: str = "r1", shown: list[str] | None = None
) -> Iterator[Notifier]:
    says = [] if shown is None else shown
    with Notifier(str(folder / "queue.db"), targets, "lab", run, says.append) as made:
        yield made


def sent(made: Notifier) -> bool:
    return wait_until(lambda: made.waiting == 0, 30)


def test_one_message_when_it_begins_and_one_when_it_is_over(tmp_path: Path, hook: Hook) -> None:
    with notifier(tmp_path, hook.target) as made:
        for one in (received(0), received(0), received(1), received(2, active=False)):
            made.take(one)
        assert sent(made)
    begun, over = hook.bodies
    assert (begun["camera"], begun["kind"], begun["active"]) == ("cam", "stale", True)
    assert (over["active"], over["began"], over["text"]) == (False, begun["time"], "text 2")
    assert begun["id"] != over["id"]
    assert hook.signed == [True, True]


def test_none_is_lost_while_the_server_is_away_or_refuses(tmp_path: Path, hook: Hook) -> None:
    shown: list[str] = []
    hook.close()
    with notifier(tmp_path, hook.target, shown=shown) as made:
        for n in range(20):
            made.take(received(n, camera=f"cam{n}"))
        assert wait_until(lambda: any("refused" in line for line in shown), 30)
        assert made.waiting == 20
        hook.status = 503
        hook.open()
        assert wait_until(lambda: any("503" in line for line in shown), 30)
        hook.status = 200
        assert sent(made)
    assert [body["text"] for body in hook.bodies] == [f"text {n}" for n in range(20)]
    assert SECRET not in "".join(shown)


def test_what_waits_survives_a_restart_and_what_was_taken_is_not_taken_again(
    tmp_path: Path, hook: Hook
) -> None:
    hook.close()
    with notifier(tmp_path, hook.target) as made:
        made.take(received(0))
    hook.open()
    with notifier(tmp_path, hook.target) as made:
        made.take(received(0))  # kept by its sender, and sent again to who restarts
        made.take(received(0, run="r1.live1"))  # its node was restarted, too: still the same alarm
        assert sent(made)
    assert [body["text"] for body in hook.bodies] == ["text 0"]
    with notifier(tmp_path, hook.target, run="r2") as made:  # the whole run was started again
        made.take(received(0, run="r2"))
        assert sent(made)
    over, again = hook.bodies[1:]
    assert (over["active"], over["text"]) == (False, "rsenf was started again")
    assert (again["active"], again["text"]) == (True, "text 0")


KILLED = """
import sys, time
sys.path.insert(0, {here!r})
import test_notify
from pathlib import Path
from rsenf.run import notify
notify.PAUSES_S = (0.05,)
hook = test_notify.WebhookTarget(via="webhook", url={url!r}, secret_env="HOOK_KEY")
with test_notify.notifier(Path({folder!r}), hook) as made:
    for n in range(200):
        made.take(test_notify.received(n, camera=f"cam{{n}}"))
        print(n, flush=True)
    time.sleep(60)
"""


def test_a_kill_loses_none(tmp_path: Path, hook: Hook) -> None:
    url = f"http://127.0.0.1:{hook.port}/x"
    code = KILLED.format(here=str(Path(__file__).parent), url=url, folder=str(tmp_path))
    for _ in range(2):
        process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
        assert process.stdout is not None
        taken = [next(process.stdout) for _ in range(60)]
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
        assert taken
    with notifier(tmp_path, hook.target) as made:
        for n in range(200):
            made.take(received(n, camera=f"cam{n}"))
        assert sent(made)
    ids = [body["id"] for body in hook.bodies]
    assert len(set(ids)) == 200
    assert len(ids) <= 202  # what was on its way at a kill comes again, with the same id


def test_filters_and_quiet_hours(tmp_path: Path, hook: Hook) -> None:
    only = hook.target.model_copy(update={"cameras": ("gate*",), "kinds": ("stale", "lost")})
    quiet = only.model_copy(update={"quiet_from": time(0, 0), "quiet_until": time(23, 59, 59)})
    with notifier(tmp_path, only, quiet) as made:
        made.take(received(0, camera="gate1"))
        made.take(received(0, "frozen", camera="gate1"))
        made.take(received(0, camera="yard"))
        made.take(received(1, camera="gate1", active=False))
        assert sent(made)
    assert [(b["camera"], b["active"]) for b in hook.bodies] == [("gate1", True), ("gate1", False)]


def test_a_program_that_fails_or_hangs_is_tried_again(tmp_path: Path) -> None:
    script = tmp_path / "tell.py"
    script.write_text(
        "import json, pathlib, sys, time\n"
        f"log = pathlib.Path({str(tmp_path / 'log')!r})\n"
        "tries = len(log.read_text()) if log.exists() else 0\n"
        "log.open('a').write('x')\n"
        "if tries == 0: sys.exit('no line')\n"
        "if tries == 1: time.sleep(60)\n"
        f"pathlib.Path({str(tmp_path / 'told')!r}).write_text(sys.stdin.read())\n"
    )
    command, shown = (sys.executable, str(script)), list[str]()
    target = ProgramTarget(via="exec", command=command, limit_s=2.0)
    with notifier(tmp_path, target, shown=shown) as made:
        made.take(received(0))
        assert sent(made)
    assert json.loads((tmp_path / "told").read_text())["kind"] == "stale"
    assert any("no line" in line for line in shown)
    assert any("timed out" in line for line in shown)


def free_port() -> int:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        return int(taken.getsockname()[1])


def test_mail(tmp_path: Path) -> None:
    from aiosmtpd.controller import Controller

    mails: list[str] = []

    class Keep:
        async def handle_DATA(self, _server: Any, _session: Any, envelope: Any) -> str:
            mails.append(envelope.content.decode())
            return "250 OK"

    port = free_port()
    target = EmailTarget(
        via="email", to=("a@example.org",), sender="r@example.org",
        host="127.0.0.1", port=port, starttls=False,
    )  # fmt: skip
    with notifier(tmp_path, target) as made:
        made.take(received(0))
        server = Controller(Keep(), hostname="127.0.0.1", port=port)
        server.start()
        try:
            assert sent(made)
        finally:
            server.stop()
    (mail,) = mails
    assert "Subject: rsenf alarm: stale at lab/cam: text 0" in mail


@pytest.mark.skipif(shutil.which("mosquitto") is None, reason="mosquitto is not installed")
def test_a_broker_that_goes_and_comes_back(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    from paho.mqtt import subscribe

    port = free_port()
    target = MqttTarget(via="mqtt", host="127.0.0.1", port=port)
    with notifier(tmp_path, target) as made:
        made.take(received(0))
        made.take(received(1, active=False))
        broker = subprocess.Popen(["mosquitto", "-p", str(port)], stderr=subprocess.DEVNULL)
        try:
            assert sent(made)
            kept = subscribe.simple("#", hostname="127.0.0.1", port=port, msg_count=2)
            made.take(received(2))
            assert sent(made)
            state = subscribe.simple("rsenf/lab/cam/stale", hostname="127.0.0.1", port=port)
        finally:
            broker.terminate()
            broker.wait()
    found = {message.topic: message.payload for message in kept}
    sensor = json.loads(found["homeassistant/binary_sensor/rsenf_lab_cam_stale/config"])
    assert sensor["state_topic"] == "rsenf/lab/cam/stale"
    assert found["rsenf/lab/cam/stale"] == b"OFF"
    assert state.payload == b"ON"
    assert caplog.records == []  # the state of the node tells what fails


GRAPH = {
    "version": 1,
    "site": "lab",
    "nodes": {
        "grid": {"kind": "reference", "grid": "ce", "input": "grid.csv"},
        "tell": {"kind": "notify", "queue": "q.db", "to": [{"via": "exec", "command": ["true"]}]},
    },
}


def test_what_is_missing_is_said_before_the_start(monkeypatch: pytest.MonkeyPatch) -> None:
    node = Graph.model_validate(GRAPH).nodes["tell"]
    assert isinstance(node, NotifyNode)
    hook = WebhookTarget(via="webhook", url="https://example.org", secret_env="NOT_SET_HERE")
    with pytest.raises(UsageError, match="NOT_SET_HERE is not set"):
        node.model_copy(update={"to": (hook,)}).check_ready("tell", "lab")
    half = hook.model_copy(update={"quiet_from": time(22)})
    graph = Graph.model_validate(GRAPH)
    assert list(node.model_copy(update={"to": (half,)}).problems(graph))
    monkeypatch.setattr("importlib.util.find_spec", lambda _name: None)
    broker = MqttTarget(via="mqtt", host="h")
    (problem,) = node.model_copy(update={"to": (broker,)}).problems(graph)
    assert "paho-mqtt" in problem[1]


@pytest.mark.parametrize("quiet_from", [1320, "22:00Z", "22:00+01:00", "ten"])
def test_quiet_hours_are_local_times_in_quotes(quiet_from: object) -> None:
    with pytest.raises(ValueError, match="in quotes"):
        ProgramTarget.model_validate({"via": "exec", "command": ["a"], "quiet_from": quiet_from})


def test_who_is_told_to_stop_does_not_wait_for_a_target_out_of_reach(tmp_path: Path) -> None:
    unreachable = ProgramTarget(via="exec", command=("false",))
    stop = threading.Event()
    with notifier(tmp_path, unreachable) as made:
        made.take(received(0))
        threading.Timer(0.2, stop.set).start()
        made.drain(stop)
        assert stop.is_set()
        assert made.waiting == 1


def test_a_queue_that_cannot_be_opened(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(Exception, match="can't open the queue"), notifier(tmp_path / "file"):
        pass


@pytest.mark.processes
def test_an_alarm_of_a_running_graph(
    short_film: Film, graphs: Graphs, live_run: type[LiveRun], hook: Hook
) -> None:
    path = graphs.write(short_film, pace=True)
    to = f"via: webhook, url: 'http://127.0.0.1:{hook.port}/', secret_env: HOOK_KEY"
    tell = f"kind: notify, queue: '{graphs.folder}/q.db', to: [{{{to}}}]"
    path.write_text(f"{path.read_text()}  tell: {{{tell}}}\n")
    run = live_run(path).until("running", "tell", "record", "decode").until("done", "grid")
    run.kill_node("record")
    assert wait_until(lambda: any("tell: running" in x and "1 sent" in x for x in run.lines))
    run.wait()
    said = "\n".join(run.lines)
    assert [(b["kind"], b["camera"], b["active"]) for b in hook.bodies] == [
        ("unrecorded", "cam", True)
    ], said
    assert "tell: done" in said
    assert "1 sent, 0 waiting" in said

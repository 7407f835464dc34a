"""The page over HTTP: what is served, to whom, and what a connection is told."""

from __future__ import annotations

import base64
import http.client
import json
import os
import re
import shutil
import socket
import ssl
import subprocess
import time
from pathlib import Path
from urllib.parse import urlsplit

import pytest
from messages_of import SITE
from served import FEEDS, camera_now

from rsenf.dashboard.app import STATIC
from rsenf.dashboard.server import DashboardServer, Guard, open_to_all
from rsenf.dashboard.site import Site, Wiring
from rsenf.errors import RsenfError, UsageError
from rsenf.record.limits import AlarmSettings, Retention, Rotation
from rsenf.run.process import wait_until

CONFIGS = Path(__file__).parents[2] / "configs"


def get(served, path, **headers):
    address = urlsplit(served.url).netloc
    connection = http.client.HTTPConnection(address)
    try:
        connection.request("GET", path, headers={"Host": address, **headers})
        answer = connection.getresponse()
        return answer, answer.read()
    finally:
        connection.close()


@pytest.fixture
def news(served):
    client = pytest.importorskip("websockets.sync.client", reason="websockets isn't installed")

    def connect(**more):
        return client.connect(served.url.replace("http", "ws") + "news", **more)

    return connect


def told(socket_, part):
    for _ in range(20):
        said = json.loads(socket_.recv())
        if part in said:
            return said[part]
    raise AssertionError(f"no {part}")


def test_all_that_the_page_asks_for_is_served_from_here(served):
    answer, page = get(served, "/")
    assert answer.status == 200
    policy = answer.headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    named = re.findall(r'(?:src|href)="([^"#]+)"', page.decode())
    assert {"main.js", "dashboard.css", "uPlot.iife.min.js"} <= set(named)
    for name in named:
        assert "//" not in name
        assert get(served, f"/{name}")[0].status == 200, name


def test_no_file_of_the_page_names_another_host():
    for path in STATIC.glob("*"):
        text = path.read_text(encoding="utf-8")
        for address in re.findall(r"https?://[^\s\"'`)]+", text):
            allowed = ("http://www.w3.org/", "https://github.com/leeoniya/uPlot")
            assert address.startswith(allowed), f"{path.name}: {address}"
        imported = re.findall(r'from "([^"]+)"', text) if "uPlot" not in path.name else []
        assert all((STATIC / name).is_file() for name in imported), path.name


@pytest.mark.parametrize("host", ["evil.example", "evil.example:80", "127.0.0.1.evil.example", ""])
def test_a_name_that_was_turned_to_this_host_is_refused(served, host):
    answer, body = get(served, "/", Host=host)
    assert answer.status in (400, 403)
    assert b"rsenf" not in body


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost:8780", "[::1]:8780", "10.1.2.3:80"])
def test_addresses_and_localhost_are_served(served, host):
    assert get(served, "/", Host=host)[0].status == 200


def test_another_sites_page_gets_no_news(served, news):
    websockets = pytest.importorskip("websockets")
    with pytest.raises(websockets.exceptions.InvalidStatus), news(origin="http://evil.example"):
        pass
    own = served.url.rstrip("/")
    with news(origin=own) as socket_:
        assert told(socket_, "site")["feeds"] == [f"{SITE}/{name}" for name in FEEDS]


def test_who_connects_is_told_all_and_then_what_changes(served, news):
    camera = camera_now("door")
    served.put(*camera.seconds(0, 30))
    with news() as socket_:
        socket_.send(json.dumps({"feed": f"{SITE}/door"}))
        assert len(told(socket_, "chart")["t_ms"]) == 30
        served.put(camera.alarm(0, 30))
        assert told(socket_, "alarms")["list"][0]["kind"] == "phase_jump"
        socket_.send("x" * 5000)
        served.put(*camera.seconds(30, 31))
        assert len(told(socket_, "chart")["t_ms"]) == 31


def test_the_picture_of_a_feed(served):
    assert get(served, f"/pictures/{SITE}/door.jpg")[0].status == 404
    served.put(camera_now("door").key_frame(0))
    answer, jpeg = get(served, f"/pictures/{SITE}/door.jpg?1")
    assert (answer.status, answer.headers["content-type"]) == (200, "image/jpeg")
    assert jpeg.startswith(b"\xff\xd8")


def test_an_alarms_recording_is_found_and_downloaded(tmp_path):
    from rsenf.record.archive import ArchiveRecorder

    camera = camera_now("door")
    now_ns = camera.start_ns

    def clock_ns():
        return now_ns

    one = _served_with(tmp_path)
    with one.server:
        with ArchiveRecorder(
            tmp_path, run_info={}, clock_ns=clock_ns, rotation=Rotation(), retention=Retention(),
            alarms=AlarmSettings(),
        ) as archive:  # fmt: skip
            for key, message in [*camera.seconds(0, 25), camera.alarm(0, 20)]:
                one.put((key, message))
                now_ns = max(now_ns, message.header.arrival_time_ns)
                archive.write_encoded(key, type(message), _coded(message), message.header)
            archive.tick()
            assert not files_of(one)[0]["is_whole"]
        (found,) = files_of(one)
        assert found["is_whole"]
        assert found["replay"] == f"rsenf replay {next(tmp_path.rglob('*.mcap'))} --start-s 10"
        answer, body = get(one, f"/{found['url']}")
        assert answer.status == 200
        assert "attachment" in answer.headers["content-disposition"]
        assert body == next(tmp_path.rglob("*.mcap")).read_bytes()


def test_a_recording_that_grows_while_it_is_sent_is_downloaded_whole(tmp_path, monkeypatch):
    from starlette.responses import FileResponse

    folder = tmp_path / "house" / "door" / "2026-09-21"
    folder.mkdir(parents=True)
    path = folder / "120000.mcap"
    path.write_bytes(bytes(100_000))
    monkeypatch.setattr("rsenf.dashboard.app.file_named", lambda archive, name: path)
    told_size = FileResponse.set_stat_headers

    def grows(self, stat_result):
        told_size(self, stat_result)
        path.write_bytes(bytes(200_000))

    monkeypatch.setattr(FileResponse, "set_stat_headers", grows)
    one = _served_with(tmp_path)
    with one.server:
        answer, body = get(one, "/recordings/house/door/2026-09-21/120000.mcap")
    assert (answer.status, len(body)) == (200, 200_000)


def test_more_browsers_than_are_served_are_refused_and_leave_room(news, monkeypatch):
    websockets = pytest.importorskip("websockets")
    monkeypatch.setattr("rsenf.dashboard.app.MOST_BROWSERS", 2)
    with news() as one, news():
        assert told(one, "site")
        with pytest.raises(websockets.exceptions.InvalidStatus), news():
            pass
    for _ in range(50):  # until the server has noticed that they have gone
        try:
            with news() as again:
                assert told(again, "site")
            return
        except websockets.exceptions.InvalidStatus:
            time.sleep(0.1)
    raise AssertionError("no room was made")


@pytest.mark.parametrize(
    "name", ["../secret.mcap", "house/door/2026-09-21/../../../../secret.mcap", "index.json",
             "house/door/alarms.jsonl", "%2e%2e/secret.mcap", "/etc/passwd"]
)  # fmt: skip
def test_nothing_else_of_the_disk_is_served(tmp_path, name):
    (tmp_path / "secret.mcap").write_bytes(b"secret")
    (tmp_path / "archive" / "house" / "door").mkdir(parents=True)
    (tmp_path / "archive" / "house" / "door" / "alarms.jsonl").write_text("{}")
    one = _served_with(tmp_path / "archive")
    with one.server:
        answer, body = get(one, f"/recordings/{name}")
    assert answer.status == 404
    assert b"secret" not in body


def files_of(one):
    return json.loads(get(one, "/alarms/1/recordings")[1])["files"]


def _served_with(archive):
    from served import Served

    return Served(Wiring({f"{SITE}/door": []}, archive=archive))


def _coded(message):
    from rsenf.messages import encode

    return encode(message)


def test_a_port_that_is_taken_is_said_in_a_line():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(RsenfError, match=f"can't serve at 127.0.0.1:{port}: address already"):
            DashboardServer(Site(Wiring(), lambda: 0), "127.0.0.1", port)


@pytest.mark.parametrize("package", ["uvicorn", "websockets", "starlette.applications"])
def test_without_a_package_it_says_what_to_install(monkeypatch, package):
    monkeypatch.setitem(__import__("sys").modules, package, None)
    with pytest.raises(UsageError, match=package) as refused:
        DashboardServer(Site(Wiring(), lambda: 0), "127.0.0.1", 0)
    assert "rsenf[dashboard]" in refused.value.hint


@pytest.mark.parametrize(
    ("host", "open_"),
    [("127.0.0.1", False), ("::1", False), ("localhost", False), ("0.0.0.0", True),
     ("192.168.1.2", True), ("station", True)],
)  # fmt: skip
def test_an_address_for_all_is_warned_of(host, open_):
    assert ("no password" in open_to_all(host)) is open_


def test_the_name_that_is_listened_at_is_served():
    guard = Guard(None, "Station.lan")  # type: ignore[arg-type]  # is never called
    assert guard._may({"host": "station.lan:80"})
    assert not guard._may({"host": "station.lan.evil:80"})
    assert not guard._may({})


def post(served, path, said, **headers):
    address = urlsplit(served.url).netloc
    connection = http.client.HTTPConnection(address)
    headers = {"Host": address, "Content-Type": "application/json", **headers}
    try:
        connection.request("POST", path, said, headers)
        answer = connection.getresponse()
        return answer.status, answer.read().decode()
    finally:
        connection.close()


ACK = "/alarms/1/acknowledgement"
DOOR = json.dumps({"by": "Ann", "note": "the\u0007 door was open"})


@pytest.mark.parametrize("archived", [True, False])
def test_an_acknowledgement_and_the_days_alarms_are_kept(tmp_path, archived):
    camera = camera_now("door")
    folder = tmp_path / "archive" if archived else None
    one = _served_with(folder)
    with one.server:
        one.put(camera.alarm(0, 20))
        assert post(one, ACK, DOOR) == (204, "")
        one.put(camera.alarm(1, 20, active=False))
        (shown,) = one.site.alarms.plain()
        assert (shown["ack"]["by"], shown["ack"]["note"]) == ("Ann", "the door was open")
    again = _served_with(folder)
    with again.server:
        again.put(camera.alarm(0, 20))
        found = json.loads(get(again, "/history")[1])
    (alarm,) = found["alarms"]
    assert found["days"] == [[found["day"], 1]]
    assert alarm["kind"] == "phase_jump"
    assert (alarm["ack"] is not None) is archived
    if archived:  # a line that a crash has cut off hides no other
        with (folder / "alarms.jsonl").open("a") as file:
            file.write('{"id": "x", "start_')
        assert json.loads(get_once(folder))["alarms"] == [alarm]


def get_once(folder):
    one = _served_with(folder)
    with one.server:
        return get(one, "/history?day=1970-01-01")[1]


@pytest.mark.parametrize(
    ("path", "said", "headers", "status"),
    [
        ("/alarms/7/acknowledgement", DOOR, {}, 404),
        (ACK, DOOR, {"Origin": "http://evil.example"}, 403),
        (ACK, DOOR, {"Content-Type": "text/plain"}, 415),
        (ACK, '{"by": " "}', {}, 400),
        (ACK, '{"by": 7}', {}, 400),
        (ACK, "[" * 4000, {}, 400),
        (ACK, json.dumps({"by": "x" * 6000}), {}, 400),
    ],
)
def test_what_is_no_acknowledgement_is_refused(tmp_path, path, said, headers, status):
    one = _served_with(tmp_path)
    with one.server:
        one.put(camera_now("door").alarm(0, 20))
        assert post(one, path, said, **headers)[0] == status
        assert one.site.alarms.plain()[0]["ack"] is None


def test_an_acknowledgement_that_can_not_be_kept_is_none(tmp_path):
    (tmp_path / "archive").write_text("a file in the folder's place")
    one = _served_with(tmp_path / "archive")
    with one.server:
        one.put(camera_now("door").alarm(0, 20))
        assert post(one, ACK, DOOR)[0] == 507
        assert one.site.alarms.plain()[0]["ack"] is None


def test_a_password_is_asked_of_everything():
    websockets = pytest.importorskip("websockets.sync.client", reason="websockets isn't installed")
    site = Site(Wiring({f"{SITE}/door": []}), time.time_ns)
    with DashboardServer(site, "127.0.0.1", 0, "päss") as server:
        for given in (None, "Basic !", "Bearer x", f"Basic {_basic('me:pass')}"):
            headers = {"Authorization": given} if given else {}
            for path in ("/", "/history", "/main.js"):
                answer, _ = get(server, path, **headers)
                assert (answer.status, answer.headers["www-authenticate"][:5]) == (401, "Basic")
        right = {"Authorization": f"Basic {_basic('anybody:päss')}"}
        assert get(server, "/", **right)[0].status == 200
        address = server.url.replace("http", "ws") + "news"
        with pytest.raises(Exception, match="403"):
            websockets.connect(address)
        with websockets.connect(address, additional_headers=right) as socket_:
            assert told(socket_, "site")


def _basic(login):
    return base64.b64encode(login.encode()).decode()


def _free_port():
    with socket.create_server(("127.0.0.1", 0)) as free:
        return free.getsockname()[1]


@pytest.fixture
def proxy(served, tmp_path):
    """The reverse proxy of configs/deploy before a dashboard; its port, and TLS that trusts it."""
    if not (shutil.which("nginx") and shutil.which("openssl")):
        pytest.skip("needs nginx and openssl")
    subprocess.run(
        ["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1",
         "-nodes", "-keyout", tmp_path / "tls.key", "-out", tmp_path / "tls.pem", "-days", "1",
         "-subj", "/CN=localhost", "-addext", "subjectAltName=DNS:localhost"],
        check=True, capture_output=True,
    )  # fmt: skip
    hashed = subprocess.run(["openssl", "passwd", "-6", "secret"], capture_output=True, check=True)
    (tmp_path / "passwords").write_text(f"ann:{hashed.stdout.decode()}")
    tmp_path.chmod(0o755)
    port = _free_port()
    text = (CONFIGS / "deploy" / "nginx.conf").read_text()
    for name, value in (
        ("8443", port), ("127.0.0.1:8780", urlsplit(served.url).netloc), ("LOGS", tmp_path),
        ("CERTIFICATE", tmp_path / "tls"), ("PASSWORDS", tmp_path / "passwords"),
    ):  # fmt: skip
        text = text.replace(name, str(value))
    conf = tmp_path / "nginx.conf"
    conf.write_text(f"daemon off; user root; {text}" if os.getuid() == 0 else f"daemon off; {text}")
    with subprocess.Popen(["nginx", "-c", str(conf), "-e", str(tmp_path / "error.log")]) as nginx:
        trusting = ssl.create_default_context(cafile=str(tmp_path / "tls.pem"))
        assert wait_until(lambda: not socket.socket().connect_ex(("127.0.0.1", port)), 30)
        yield port, trusting
        nginx.terminate()


@pytest.mark.external
def test_a_reverse_proxy_asks_for_the_password_and_passes_everything_on(served, proxy):
    client = pytest.importorskip("websockets.sync.client", reason="websockets isn't installed")
    port, trusting = proxy
    login = {"Authorization": f"Basic {_basic('ann:secret')}"}

    def status(method, path, said=None, **headers):
        connection = http.client.HTTPSConnection("localhost", port, context=trusting)
        try:
            connection.request(method, path, said, headers)
            return connection.getresponse().status
        finally:
            connection.close()

    ours = {"Origin": f"https://localhost:{port}"}
    theirs = {"Origin": "https://evil.example"}
    said = {**login, "Content-Type": "application/json"}
    served.put(camera_now("door").alarm(0, 20))
    number = served.site.alarms.plain()[0]["number"]
    path = f"/alarms/{number}/acknowledgement"
    assert status("GET", "/") == 401
    assert status("GET", "/", **login) == 200
    assert status("POST", path, DOOR, **said, **theirs) == 403
    assert status("POST", path, DOOR, **said, **ours) == 204
    address = f"wss://localhost:{port}/news"
    with client.connect(address, ssl=trusting, additional_headers={**login, **ours}) as socket_:
        assert told(socket_, "site")

"""The page over HTTP: what is served, to whom, and what a connection is told."""

from __future__ import annotations

import http.client
import json
import re
import socket
import time
from urllib.parse import urlsplit

import pytest
from messages_of import SITE
from served import FEEDS, camera_now

from rsenf.dashboard.app import STATIC, Guard
from rsenf.dashboard.server import DashboardServer, open_to_all
from rsenf.dashboard.site import Site, Wiring
from rsenf.errors import RsenfError, UsageError
from rsenf.record.limits import AlarmSettings, Retention, Rotation


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
    assert guard._may({"headers": [(b"host", b"station.lan:80")]})
    assert not guard._may({"headers": [(b"host", b"station.lan.evil:80")]})
    assert not guard._may({"headers": []})

"""The page in a real browser: one for all tests, each of which goes on from the one before."""

from __future__ import annotations

import time
from collections.abc import Iterator
from urllib.parse import urlsplit

import pytest
from browser import Browser, chromium
from messages_of import SITE, Camera, grid_hz, health, reference
from served import FEEDS, Served, camera_now

from rsenf.dashboard.server import DashboardServer
from rsenf.dashboard.site import Wiring
from rsenf.record.archive.alarms import AlarmLog
from tests.in_time import in_time

pytestmark = [
    pytest.mark.external,
    pytest.mark.skipif(not chromium(), reason="chromium isn't on this machine"),
]
SECONDS = 60
PAINTED = """(id) => {
  const canvas = document.getElementById(id);
  const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
  return data.reduce((sum, level, i) => sum + (i % 4 === 3 && level > 0), 0);
}"""
OVERFLOW = "document.documentElement.scrollWidth - document.documentElement.clientWidth"

CUT = """[...document.querySelectorAll("main *:not(.unseen)")].filter(
  (e) => e.getBoundingClientRect().right > document.documentElement.clientWidth + 1)"""


COUNT_TONES = """(() => {
  const create = AudioContext.prototype.createOscillator;
  window.tones = 0;
  AudioContext.prototype.createOscillator = function () {
    window.tones += 1;
    return create.call(this);
  };
})()"""


class Watched:
    """What is watched, the cameras before it, and who watches."""

    def __init__(self, served: Served, browser: Browser) -> None:
        self.served, self.browser = served, browser
        self.door, self.yard = (camera_now(name, SECONDS) for name in FEEDS)

    def text(self, selector: str) -> str:
        return str(self.browser.value(f"document.querySelector({selector!r}).innerText"))

    def press_enter(self, selector: str) -> None:
        """As a person does: a click by a script may start no sound."""
        self.browser.value(f"document.querySelector({selector!r}).focus()")
        for kind in ("rawKeyDown", "char", "keyUp"):
            self.browser.call("Input.dispatchKeyEvent", type=kind, key="Enter", code="Enter",
                  windowsVirtualKeyCode=13, text="\r" if kind == "char" else "")  # fmt: skip

    def until_text(self, selector: str, text: str, timeout_s: float = 10.0) -> float:
        return self.browser.until(
            f"document.querySelector({selector!r})?.innerText.includes({text!r})", timeout_s
        )


@pytest.fixture(scope="module")
def watched() -> Iterator[Watched]:
    pytest.importorskip("uvicorn", reason="uvicorn isn't installed")
    pytest.importorskip("websockets", reason="websockets isn't installed")
    feeds = {f"{SITE}/{name}": [f"decode-{name}", "track"] for name in FEEDS}
    served = Served(Wiring(feeds, frozenset(feeds)))
    with served.site, served.server, Browser() as browser:
        one = Watched(served, browser)
        served.put(reference(grid_hz(600), one.door.start_ns))
        served.put(one.door.key_frame(0), *one.door.seconds(0, SECONDS))
        served.put(*one.yard.seconds(0, 5), one.door.live(0), one.yard.live(0, "frozen"))
        browser.size(1280, 900)
        browser.open(served.url)
        yield one


def test_it_loads_and_asks_nobody_else(watched):
    page = watched.browser
    page.until("document.querySelectorAll('#cards li').length === 2")
    watched.until_text("#verdict", "live")
    watched.until_text("#chart-words", "mHz rms apart")
    page.until("document.querySelector('#picture').naturalWidth === 320")
    assert watched.text("#cards li:nth-child(1) .name") == "yard"  # bad feeds first
    assert watched.text("#cards li:nth-child(2) .name") == "door"
    assert "2 feeds" not in watched.text("#tally")
    assert watched.text("#tally").startswith("1 live · 1 frozen")
    for name in ("strip", "spectrogram"):
        page.until(f"({PAINTED})({name!r}) > 1000")
    assert {urlsplit(asked).netloc for asked in page.requests} == {
        urlsplit(watched.served.url).netloc
    }
    assert page.complaints == []


def test_it_follows(watched):
    key, estimate = watched.door.enf(SECONDS)
    watched.served.put((key, estimate), watched.door.live(1, "stale"))
    assert in_time(watched.until_text("#facts", f"{estimate.enf_hz:.5f}"), 3)
    assert in_time(watched.until_text("#verdict", "stale"), 3)


def test_an_alarm_is_seen_within_seconds(watched):
    page = watched.browser
    page.value(COUNT_TONES)
    watched.press_enter("#sound")
    page.until("document.getElementById('sound').getAttribute('aria-pressed') === 'true'")
    page.until("window.tones === 2")  # how it sounds
    watched.served.put(watched.yard.alarm(0, 5, kind="loop", text="it repeats itself"))
    assert in_time(watched.until_text("#alarm-list", "loop"), 3)
    assert watched.text("#cards li:nth-child(2) .alarms") == "1 alarm"
    assert "it repeats itself" in watched.browser.value(
        "document.querySelector('[role=alert]').textContent"
    )
    assert watched.browser.value("document.title") == "(1) rsenf"
    page.until("window.tones === 4")
    watched.press_enter("#sound")
    page.until("document.getElementById('sound').getAttribute('aria-pressed') === 'false'")
    assert page.complaints == []


def test_an_alarm_is_acknowledged_and_found_by_day(watched):
    page = watched.browser
    page.value("document.querySelector('#alarm-list details').open = true")
    for name, text in (("by", "Ann"), ("note", "the guard looked")):
        page.value(f"document.querySelector('#alarm-list input[name={name}]').focus()")
        page.call("Input.insertText", text=text)
    watched.press_enter("#alarm-list form button")
    watched.until_text("#alarm-list .seen", "Acknowledged by Ann")
    page.until("document.querySelector('#alarm-list form').hidden")
    page.value("document.getElementById('history').open = true")
    watched.until_text("#history-list", "the guard looked")
    assert page.value("document.getElementById('day').options.length") == 1
    assert page.complaints == []
    page.value("document.getElementById('history').open = false")


def test_alarms_that_can_not_be_written_are_told(watched, tmp_path):
    alarms, folder = watched.served.site.alarms, tmp_path / "archive"
    folder.write_text("a file in the folder's place")
    before, alarms.log = alarms.log, AlarmLog(folder)
    watched.served.put(watched.yard.alarm(1, 6, kind="stale"))
    watched.until_text("#unwritten", f"{folder}: file exists; ")
    folder.unlink()
    watched.served.put(watched.yard.alarm(2, 6, kind="stale", active=False))
    watched.browser.until("document.querySelector('#unwritten').textContent === ''")
    alarms.log = before


def test_keys_alone_reach_every_feed(watched):
    page = watched.browser
    watched.press_enter("#cards li:nth-child(2) a")
    watched.until_text("#name", "yard")
    watched.until_text("#verdict", "frozen")
    page.value("location.hash = '#feed=house%2Fdoor'")
    watched.until_text("#name", "door")
    page.until(f"({PAINTED})('strip') > 1000")


def test_a_nodes_restart_is_survived_and_told(watched):
    now_ns = time.time_ns()
    watched.served.put(
        health("track", "track", now_ns), health("track", "track", now_ns, 1, restarts=1)
    )
    again = Camera("door", grid_hz(60), now_ns, run_id="b")
    watched.served.put(*again.seconds(0, 3))
    watched.until_text("#facts", "began 2 times")
    watched.until_text("#node-list", "started again once")
    watched.until_text("#chart-words", "usable")


def test_a_phone_shows_it_without_scrolling_sideways(watched):
    page = watched.browser
    page.size(360, 740, phone=True)
    page.value("document.querySelector('#alarm-list details').open = true")
    watched.until_text("#alarm-list .files", "No archive is configured")
    assert page.value(OVERFLOW) == 0
    page.until(f"({CUT}).length === 0")
    page.size(1280, 900)


def test_a_dashboard_that_restarts_is_found_again(watched):
    watched.until_text("#link", "connected")
    before = len(watched.browser.complaints)
    address = urlsplit(watched.served.url)
    watched.served.server.__exit__(None, None, None)
    watched.until_text("#link", "disconnected")
    assert "disconnected" in watched.browser.value("document.body.className")
    with DashboardServer(watched.served.site, "127.0.0.1", address.port):
        watched.browser.until("!document.body.className.includes('disconnected')")
        watched.served.put(watched.door.live(9, "no_signal"))
        watched.until_text("#verdict", "no signal")
    # A refused connection is the browser's own line; nothing else may be there.
    assert all("ERR_CONNECTION" in c for c in watched.browser.complaints[before:])

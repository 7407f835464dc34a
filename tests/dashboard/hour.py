"""An hour at the page, sped up: does the page stay light, and its server?

    python -m tests.dashboard.hour [FEEDS] [SECONDS]

Messages of so many feeds (4) for so many seconds (3600) go through the dashboard as fast as it
takes them while a headless Chromium looks at one. Prints, twelve times, what the page and the
server hold. Exit code 1 when they grow in the second half.
"""

from __future__ import annotations

import dataclasses
import sys
import time
from pathlib import Path

import psutil

sys.path.insert(0, str(Path(__file__).parent))

from browser import Browser
from messages_of import SITE, Camera, S, grid_hz, health, reference

from rsenf.dashboard.server import DashboardServer
from rsenf.dashboard.site import Site, Wiring

LOOKS = 12


def main(feeds: int, seconds: int) -> int:
    """Feed, look, and judge."""
    freq_hz, start_ns = grid_hz(seconds + 60), time.time_ns()
    cameras = [Camera(f"cam{n}", freq_hz, start_ns, seed=n) for n in range(feeds)]
    names = {f"{SITE}/{c.name}": [c.name, "track"] for c in cameras}
    clock = {"ns": start_ns}
    site = Site(Wiring(names, frozenset(names)), lambda: clock["ns"])
    looks = []
    with site, DashboardServer(site, "127.0.0.1", 0) as server, Browser() as browser:
        site.update(*reference(freq_hz, start_ns))
        browser.size(1280, 900)
        browser.open(server.url)
        browser.until("document.querySelectorAll('#cards li').length")
        print("  s of feeds   JS heap MB   DOM nodes   listeners   server MB   CPU s", flush=True)
        for second in range(seconds):
            clock["ns"] = start_ns + (second + 1) * S
            for camera in cameras:
                _second(site, camera, second)
            if second % 10 == 0:
                browser.value("0")  # takes what it has told meanwhile
            if second % (seconds // LOOKS) == seconds // LOOKS - 1:
                time.sleep(1.5)  # until the page has caught up
                looks.append(_look(browser, second + 1))
        said = browser.complaints
    half = looks[len(looks) // 2]
    grown = [name for name in ("heap", "nodes", "server") if looks[-1][name] > 1.15 * half[name]]
    print(f"grew in the second half: {', '.join(grown) or 'nothing'}; complaints: {said or 'none'}")
    return 1 if grown or said else 0


def _second(site: Site, camera: Camera, second: int) -> None:
    site.update(*camera.rows(second))
    site.update(*camera.enf(second, usable=second % 300 > 20))
    site.update(*camera.live(second, "live" if second % 600 > 60 else "stale", since=second))
    now_ns = camera.start_ns + second * S
    site.update(*health(camera.name, "decode", now_ns, second))
    if second % 5 == 0:
        site.update(*camera.key_frame(second))
        site.update(*camera.idle(second))
        site.update(*camera.match(second))
    if second % 30 == 0:
        key, alarm = camera.alarm(second, second)
        site.update(key, alarm)
        over = dataclasses.replace(alarm, active=False)
        site.update(key, over)


def _look(browser: Browser, second: int) -> dict[str, float]:
    metrics, process = browser.metrics(), psutil.Process()
    look = {
        "heap": metrics["JSHeapUsedSize"] / 1e6,
        "nodes": metrics["Nodes"],
        "server": process.memory_info().rss / 1e6,
    }
    print(
        f"  {second:10d}   {look['heap']:10.1f}   {look['nodes']:9.0f}   "
        f"{metrics['JSEventListeners']:9.0f}   {look['server']:9.0f}   "
        f"{process.cpu_times().user:5.0f}",
        flush=True,
    )
    return look


if __name__ == "__main__":
    given = [int(word) for word in sys.argv[1:]]
    sys.exit(main(*[*given, *(4, 3600)[len(given) :]]))

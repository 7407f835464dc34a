"""A camera that films the present: a film served over RTSP in real time, which may turn bad.

Run by the system's Python, which has GStreamer's bindings, as ``tests/decode/rtsp_server.py`` is. A
film is its compressed pictures one after the other (``FILM.h264``), and where each begins
(``FILM.json``); picture ``n`` is sent when the ``n``-th period since it began is over. So a server
that was away goes on where the film would be by now.
"""

from __future__ import annotations

import argparse
import json
import mmap
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any


class Film:
    """The pictures of a film, by number."""

    def __init__(self, path: Path) -> None:
        about = json.loads(path.with_suffix(".json").read_text())
        with path.open("rb") as file:
            self._data = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        self._begins: list[int] = [*about["begins"], len(self._data)]
        self.gop: int = about["gop_frames"]
        self.period_s: float = about["period_s"]

    def __len__(self) -> int:
        return len(self._begins) - 1

    def picture(self, number: int) -> bytes:
        """Return a picture; every ``gop``-th needs no other."""
        return self._data[self._begins[number] : self._begins[number + 1]]


def shown(film: Film, mode: str, after_s: float, loop_s: float) -> Callable[[int], int]:
    """Return which picture is shown as the n-th: another one, once the feed has turned bad."""
    turn = round(after_s / film.period_s / film.gop) * film.gop
    length = max(round(loop_s / film.period_s / film.gop), 1) * film.gop

    def number(n: int) -> int:
        if mode == "live" or n < turn:
            return n
        return turn - film.gop if mode == "frozen" else turn - length + (n - turn) % length

    return number


def push(source: Any, film: Film, number: Callable[[int], int], began_s: float) -> None:
    """Send the pictures, each in its time, until nobody takes them or the film is over."""
    from gi.repository import Gst

    now = int((time.time() - began_s) / film.period_s)
    first = max(-(-now // film.gop) * film.gop, 0)
    period_ns = round(film.period_s * 1e9)
    for n in range(first, len(film)):
        time.sleep(max(began_s + (n + 1) * film.period_s - time.time(), 0.0))
        picture = Gst.Buffer.new_wrapped(film.picture(number(n)))
        picture.pts = picture.dts = round((n - first) * film.period_s * 1e9)
        picture.duration = period_ns
        if source.emit("push-buffer", picture) != Gst.FlowReturn.OK:
            return
    source.emit("end-of-stream")


def main() -> int:
    """Serve until killed."""
    parser = argparse.ArgumentParser()
    parser.add_argument("film", type=Path)
    parser.add_argument("--began-s", type=float, required=True, help="Unix time")
    parser.add_argument("--port", default="0")
    parser.add_argument("--mode", choices=("live", "loop", "frozen"), default="live")
    parser.add_argument("--after-s", type=float, default=0.0, help="when it turns bad")
    parser.add_argument("--loop-s", type=float, default=30.0)
    args = parser.parse_args()
    import gi

    gi.require_version("Gst", "1.0")
    gi.require_version("GstRtspServer", "1.0")
    from gi.repository import GLib, Gst, GstRtspServer

    Gst.init(None)
    film = Film(args.film)
    number = shown(film, args.mode, args.after_s, args.loop_s)

    def configure(_factory: Any, media: Any) -> None:
        source = media.get_element().get_by_name("film")
        caps = "video/x-h264,stream-format=byte-stream,alignment=au"
        source.set_property("caps", Gst.Caps.from_string(caps))
        threading.Thread(
            target=push, args=(source, film, number, args.began_s), daemon=True
        ).start()

    factory = GstRtspServer.RTSPMediaFactory.new()
    factory.set_launch(
        "( appsrc name=film is-live=true format=time ! h264parse ! "
        "rtph264pay config-interval=0 name=pay0 pt=96 )"
    )
    factory.set_shared(True)
    factory.connect("media-configure", configure)
    server = GstRtspServer.RTSPServer.new()
    server.set_address("127.0.0.1")
    server.set_service(args.port)
    server.get_mount_points().add_factory("/cam", factory)
    server.attach(None)
    print(server.get_bound_port(), flush=True)
    GLib.MainLoop().run()
    return 0


if __name__ == "__main__":
    sys.exit(main())

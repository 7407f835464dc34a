"""RTSP, with a real server in a process of its own, and with servers that never answer."""

from __future__ import annotations

import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from threading import Event, Thread
from typing import Any

import av
import numpy as np
import pytest
import rtsp_server
from decode_clips import only_frames, only_packets
from rtsp_server import RtspServer

from rsenf.decode import SourceSpec, VideoSource, open_source
from rsenf.decode.packets import parameter_sets
from rsenf.decode.pump import Pump
from rsenf.errors import EXIT_FAILED, SourceLost

RTP_TICK_NS = 1.01 * 1e9 / 90_000


@pytest.fixture(scope="module")
def needs_server() -> None:
    if lacking := rtsp_server.missing():
        pytest.skip(lacking)


external = [pytest.mark.external, pytest.mark.usefixtures("needs_server")]


@pytest.fixture
def mute() -> Iterator[str]:
    """Address of a server that accepts connections and never says a word."""
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        listener.listen()
        yield f"rtsp://admin:secret@127.0.0.1:{listener.getsockname()[1]}/cam"


def open_rtsp(
    url: str, *, stop: Event | None = None, on_event: Callable[[str], Any] = str, **spec: Any
) -> VideoSource:
    values = {"open_timeout_s": 120.0, "read_timeout_s": 2.0, "backoff_initial_s": 0.1}
    values = {**values, "effort": "full", **spec}  # whatever the machine is busy with
    return open_source(
        SourceSpec(url=url, kind="rtsp", **values),
        source="lab/cam",
        run_id="r",
        clock_ns=time.time_ns,
        stop=stop,
        on_event=on_event,
    )


def take(source: VideoSource, count: int) -> list[Any]:
    """The first items, up to a number of frames; then closed."""
    items: list[Any] = []
    for item in source:
        items.append(item)
        if len(only_frames(items)) == count:
            source.close()
    return items


def test_an_unreachable_address_is_one_clear_error_without_the_password(mute: str) -> None:
    with socket.socket() as nobody:
        nobody.bind(("127.0.0.1", 0))
        closed = f"rtsp://admin:secret@127.0.0.1:{nobody.getsockname()[1]}/cam"
    for url, reason in (
        (closed, "connection refused"),
        (mute, "no answer within 0.3 s"),
        ("rtsp://admin:secret@127.0.0.1:port/cam", "can't be read"),
    ):
        with pytest.raises(SourceLost, match=reason) as caught:
            open_rtsp(url, open_timeout_s=0.3)
        assert caught.value.exit_code == EXIT_FAILED
        assert caught.value.hint
        assert "secret" not in str(caught.value)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize("wait", [False, True])
def test_a_stop_ends_opening_and_backing_off(mute: str, wait: bool) -> None:
    stop, opened = Event(), []
    url = mute if not wait else "rtsp://127.0.0.1:1/cam"
    opening = Thread(
        target=lambda: opened.append(
            open_rtsp(
                url, stop=stop, open_timeout_s=3600, backoff_initial_s=3600, wait_for_source=wait
            )
        ),
        daemon=True,
    )
    opening.start()
    stop.set()
    opening.join(30)
    assert list(opened[0]) == []
    assert opened[0].info.live


def test_a_thread_that_hangs_in_ffmpeg_does_not_keep_the_program(mute: str) -> None:
    program = (
        "import threading, sys\n"
        "from rsenf.decode import SourceSpec, open_source\n"
        "stop = threading.Event()\n"
        "threading.Timer(0.3, stop.set).start()\n"
        "spec = SourceSpec(url=sys.argv[1], kind='rtsp', open_timeout_s=3600)\n"
        "open_source(spec, source='a/b', run_id='r', clock_ns=lambda: 0, stop=stop)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, mute],
        timeout=60,
        check=False,
        capture_output=True,
        text=True,
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


class TestWithServer:
    pytestmark = external

    @pytest.mark.parametrize("codec", ["h264", "h264-no-sets", "h265", "mjpeg"])
    def test_frames_times_and_packets(self, codec: str, capfd: pytest.CaptureFixture[str]) -> None:
        with RtspServer(codec) as server:
            source = open_rtsp(server.url, with_packets=True)
            items = take(source, 40)
        frames, packets = only_frames(items), only_packets(items)
        assert source.info.live
        assert source.loss == ""
        assert (source.info.width_px, source.info.height_px) == (320, 240)
        assert {f.luma.shape for f in frames} == {(240, 320)}
        assert [f.header.seq for f in frames] == list(range(40))
        steps_ns = np.diff([f.header.pts_ns for f in frames])
        assert np.all(np.abs(steps_ns - 1e9 / 30) < RTP_TICK_NS)
        assert {f.header.pts_ns for f in frames} <= {p.header.pts_ns for p in packets}
        assert packets[0].keyframe
        name = {"h265": "hevc", "mjpeg": "mjpeg"}.get(codec, "h264")
        assert source.info.codec == name
        if name != "mjpeg":
            assert all(parameter_sets(p.data, name)[0] for p in packets if p.keyframe)
        assert capfd.readouterr() == ("", "")

        context = av.CodecContext.create(name, "r")
        assert isinstance(context, av.VideoCodecContext)
        context.thread_type = "NONE"
        again = [f for p in packets for f in context.decode(av.Packet(p.data))]
        for frame, other in zip(frames, again, strict=False):
            assert np.array_equal(frame.luma, other.to_ndarray()[:240])

    def test_the_cameras_clock_is_followed_beside_a_sound_track(self) -> None:
        with RtspServer(audio=True) as server:
            items = take(open_rtsp(server.url, threads=1), 270)
        frames = only_frames(items)
        # The first RTCP report comes after some seconds; server and client share this clock.
        known = [f.header for f in frames if f.header.camera_time_ns]
        assert len(known) > 10
        for header in known:
            late_s = (header.arrival_time_ns - header.camera_time_ns) / 1e9
            assert -0.1 < late_s < 10
        steps_ns = np.diff([f.header.pts_ns for f in frames])
        assert np.all(np.abs(steps_ns - 1e9 / 30) < RTP_TICK_NS)  # not re-timed by the report

    def test_a_stall_and_a_restart_are_new_epochs(self) -> None:
        events: list[str] = []
        seen: list[tuple[int, int]] = []
        with RtspServer() as first, ExitStack() as later:
            # It goes on as soon as the stall has been noticed.
            source = open_rtsp(
                first.url,
                read_timeout_s=1.0,
                on_event=lambda line: (events.append(line), len(events) == 1 and first.resume()),
            )
            for item in source:
                seen.append((item.header.epoch, item.header.seq))
                if seen[-1] == (0, 20):
                    first.stall()
                elif seen[-1] == (1, 20):
                    first.kill()
                    later.enter_context(RtspServer(port=first.port))
                elif seen[-1] == (2, 5):
                    source.close()
        assert "sent nothing for 1 s" in events[0]
        assert any("ended the stream" in line or "broke" in line for line in events)
        assert [n for e, n in seen if e == 1][:5] == [0, 1, 2, 3, 4]
        assert seen[-1] == (2, 5)
        assert source.loss.startswith("lost the source 2 times")

    def test_a_silence_that_ffmpeg_notices_first_is_said_as_one(
        self, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        get = Pump.get
        monkeypatch.setattr(Pump, "get", lambda pump, timeout_s: get(pump, timeout_s + 30.0))
        events: list[str] = []
        stop = Event()

        def note(line: str) -> None:
            events.append(line)
            stop.set()

        with RtspServer() as server:
            source = open_rtsp(server.url, read_timeout_s=1.0, stop=stop, on_event=note)
            for number, _ in enumerate(source):
                if number == 5:
                    server.stall()
        assert "sent nothing for 1 s" in events[0]

    def test_it_is_given_up_after_the_attempts_allowed(self) -> None:
        with RtspServer() as server:
            source = open_rtsp(server.url, max_reconnects=2, backoff_max_s=0.2)
            items = iter(source)
            next(items)
            server.kill()
            with pytest.raises(SourceLost, match="connection refused"):
                list(items)

    def test_wrong_password_and_wrong_path_say_so(self) -> None:
        with RtspServer(user="bob", password="se/cr:et@1") as server:
            assert take(open_rtsp(server.url), 1)
            for url, reason in (
                (server.url.replace("bob", "eve"), "user or password is refused"),
                (server.url + "2", "no such stream"),
            ):
                with pytest.raises(SourceLost, match=reason) as caught:
                    open_rtsp(url)
                assert "cr" not in caught.value.message

    def test_closing_ends_a_blocked_read(self) -> None:
        with RtspServer() as server:
            source = open_rtsp(server.url, read_timeout_s=3600)
            rest: list[Any] = []
            started = Event()

            def read_on() -> None:
                for item in source:
                    rest.append(item)
                    started.set()

            reading = Thread(target=read_on, daemon=True)
            reading.start()
            assert started.wait(30)
            server.stall()
            source.close()
            reading.join(30)
            assert not reading.is_alive()
            server.resume()

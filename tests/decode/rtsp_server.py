"""A real RTSP server in a process of its own, for tests of live sources.

As a module: :class:`RtspServer`, a context manager around that process. As a program (run by the
system's Python, which has GStreamer's bindings): the server itself. It needs Debian's
``gir1.2-gst-rtsp-server-1.0`` and the plugin sets good, bad and ugly.
"""

from __future__ import annotations

import argparse
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from types import TracebackType
from urllib.parse import quote

SYSTEM_PYTHON = "/usr/bin/python3"
_FAST = "tune=zerolatency speed-preset=ultrafast key-int-max=15"
# Sliced pictures would get parameter sets before every slice, and FFmpeg take each for a picture.
_X264 = f"x264enc sliced-threads=false {_FAST}"
ENCODERS = {
    "h264": f"{_X264} ! rtph264pay config-interval=-1",
    # Parameter sets only in the session description, as many cameras do.
    "h264-no-sets": f"{_X264} ! video/x-h264,stream-format=avc ! rtph264pay config-interval=0",
    "h265": f"x265enc {_FAST} ! rtph265pay config-interval=-1",
    "mjpeg": "jpegenc ! rtpjpegpay",
}


def missing() -> str:
    """What this machine lacks for the server; empty when it lacks nothing."""
    if not shutil.which(SYSTEM_PYTHON):
        return f"needs {SYSTEM_PYTHON} with GStreamer's bindings"
    probe = subprocess.run(
        [SYSTEM_PYTHON, __file__, "--probe"], capture_output=True, text=True, check=False
    )
    return probe.stdout.strip() if probe.returncode else ""


class RtspServer:
    """Serves a moving test picture, or a file, at ``self.url`` until the block ends.

    Parameters
    ----------
    codec : str
        One of :data:`ENCODERS`.
    port : int
        0 for a free one; give the port of an earlier server to come back at its address.
    user, password : str
        Asked of the client when not empty.
    audio : bool
        Add an audio stream, as most cameras do.
    file : path or None
        An H.264 mp4 to serve instead of the test picture.
    """

    def __init__(
        self,
        codec: str = "h264",
        *,
        port: int = 0,
        width_px: int = 320,
        height_px: int = 240,
        rate_hz: str = "30/1",
        user: str = "",
        password: str = "",
        audio: bool = False,
        file: Path | None = None,
    ) -> None:
        self._command = [
            SYSTEM_PYTHON,
            __file__,
            *("--codec", codec, "--port", str(port), "--rate", rate_hz),
            *("--width", str(width_px), "--height", str(height_px)),
            *(("--audio",) if audio else ()),
            *(("--file", str(file)) if file else ()),
        ]
        # Not among the arguments, which everybody can see.
        self._environment = {**os.environ, "RTSP_USER": user, "RTSP_PASSWORD": password}
        self._login = f"{quote(user)}:{quote(password, safe='')}@" if user else ""
        self.port = port
        self.url = ""

    def __enter__(self) -> RtspServer:
        self._process = subprocess.Popen(
            self._command, stdout=subprocess.PIPE, text=True, env=self._environment
        )
        assert self._process.stdout is not None
        self.port = int(self._process.stdout.readline())  # printed once it listens
        self.url = f"rtsp://{self._login}127.0.0.1:{self.port}/cam"
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.kill()

    def stall(self) -> None:
        """Stop sending without closing anything, as a hung camera does."""
        self._process.send_signal(signal.SIGSTOP)

    def resume(self) -> None:
        """Go on after :meth:`stall`."""
        self._process.send_signal(signal.SIGCONT)

    def kill(self) -> None:
        """End at once, as at a power cut."""
        self._process.kill()
        self._process.wait()
        if self._process.stdout is not None:
            self._process.stdout.close()


def _launch_line(args: argparse.Namespace) -> str:
    if args.file:
        parsed = f"filesrc location={args.file} ! qtdemux ! h264parse"
        video = f"{parsed} ! rtph264pay config-interval=-1"
    else:
        video = (
            f"videotestsrc is-live=true pattern=ball ! video/x-raw,format=I420,width={args.width},"
            f"height={args.height},framerate={args.rate} ! {ENCODERS[args.codec]}"
        )
    audio = " audiotestsrc is-live=true ! alawenc ! rtppcmapay name=pay1" if args.audio else ""
    return f"( {video} name=pay0 pt={26 if args.codec == 'mjpeg' else 96}{audio} )"


def _serve() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--probe", action="store_true")
    parser.add_argument("--codec", default="h264")
    parser.add_argument("--port", default="0")
    parser.add_argument("--rate", default="30/1")
    parser.add_argument("--width", type=int, default=320)
    parser.add_argument("--height", type=int, default=240)
    parser.add_argument("--audio", action="store_true")
    parser.add_argument("--file", default="")
    args = parser.parse_args()
    try:
        import gi

        gi.require_version("Gst", "1.0")
        gi.require_version("GstRtspServer", "1.0")
        from gi.repository import GLib, Gst, GstRtspServer
    except (ImportError, ValueError):
        print("needs gir1.2-gst-rtsp-server-1.0")
        return 1
    Gst.init(None)
    lacking = [
        name
        for name in ("x264enc", "rtph264pay", "qtdemux", "jpegenc", "videotestsrc")
        if Gst.ElementFactory.find(name) is None
    ]
    if lacking:
        print(f"needs the GStreamer plugins with {', '.join(lacking)}")
        return 1
    if args.probe:
        return 0
    server = GstRtspServer.RTSPServer.new()
    server.set_address("127.0.0.1")
    server.set_service(args.port)
    factory = GstRtspServer.RTSPMediaFactory.new()
    factory.set_launch(_launch_line(args))
    factory.set_shared(not args.file)
    user, password = (os.environ.get(f"RTSP_{word}", "") for word in ("USER", "PASSWORD"))
    if user:
        auth = GstRtspServer.RTSPAuth.new()
        token = GstRtspServer.RTSPToken.new()
        token.set_string(GstRtspServer.RTSP_TOKEN_MEDIA_FACTORY_ROLE, "viewer")
        auth.add_basic(GstRtspServer.RTSPAuth.make_basic(user, password), token)
        server.set_auth(auth)
        factory.add_role_from_structure(
            Gst.Structure.from_string(
                "viewer, media.factory.access=(boolean)true, media.factory.construct=(boolean)true"
            )[0]
        )
    server.get_mount_points().add_factory("/cam", factory)
    server.attach(None)
    print(server.get_bound_port(), flush=True)
    GLib.MainLoop().run()
    return 0


if __name__ == "__main__":
    sys.exit(_serve())

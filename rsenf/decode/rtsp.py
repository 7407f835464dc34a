"""A camera on the network as a source: RTSP, with RTP over TCP, or HTTP."""

from __future__ import annotations

import dataclasses
import socket
import time
from collections.abc import Callable, Iterable, Iterator
from urllib.parse import urlsplit

import av
from av.container import InputContainer

from rsenf.decode.decoder import Packet
from rsenf.decode.live import LiveSource
from rsenf.decode.pump import Disconnected, Pump, Stop, Stopped
from rsenf.decode.source import Effort, Item, SourceSpec, Stamp, VideoSource
from rsenf.decode.stream import StreamDecoder
from rsenf.messages import Frame

_OPTIONS = {
    "rtsp_transport": "tcp",
    # With a second stream FFmpeg adjusts the times of both at every RTCP report: jitter in the
    # clock that phases are measured on. A single stream keeps its RTP time stamps.
    "allowed_media_types": "video",
}
_DEFAULT_PORTS = {"rtsp": 554, "rtsps": 322, "http": 80, "https": 443}
# Limit of packets before the first one with a time stamp.
_UNTIMED_LIMIT = 100

_Timed = tuple[Packet, int]  # a packet and when it arrived


class EffortControl:
    """Chooses how a feed is decoded by its backlog, with hysteresis.

    A quarter of the queue waiting: fast, from the next key frame on (PyAV can't leave out the loop
    filter of an open decoder). Next to nothing waiting for half a minute: in full again.
    That time doubles with each return, so that a machine that is just too slow rarely changes.
    """

    BEHIND, CAUGHT_UP, AIR_S, MOST_AIR_S = 16, 2, 30.0, 1920.0

    def __init__(self) -> None:
        self.effort: Effort = "full"
        self._air_s = self.AIR_S
        self._since_s: float | None = None  # as long nothing has waited

    def update(self, waiting: int, now_s: float) -> Effort:
        """Return the effort.

        Parameters
        ----------
        waiting : int
            Packets in the queue.
        now_s : float
            By a monotonic clock.
        """
        if waiting > self.CAUGHT_UP:
            self._since_s = None
        elif self._since_s is None:
            self._since_s = now_s
        if self.effort == "full" and waiting >= self.BEHIND:
            self.effort = "fast"
        air_s = 0.0 if self._since_s is None else now_s - self._since_s
        if self.effort == "fast" and air_s > self._air_s:
            self.effort, self._air_s = "full", min(2 * self._air_s, self.MOST_AIR_S)
        return self.effort


def open_rtsp(
    spec: SourceSpec, stamp: Stamp, stop: Stop, on_event: Callable[[str], None]
) -> VideoSource:
    """Open an RTSP source; see :func:`rsenf.decode.open_source`."""

    def connect(epoch: int) -> _RtspConnection:
        return _RtspConnection(spec, stamp, stop, epoch, on_event)

    return LiveSource(spec, stamp, stop, connect, on_event)


class _RtspConnection:
    """One RTSP session: a thread receives packets, the consumer's thread decodes them."""

    def __init__(
        self,
        spec: SourceSpec,
        stamp: Stamp,
        stop: Stop,
        epoch: int,
        on_event: Callable[[str], None],
    ) -> None:
        self._spec, self._timeout_s = spec, spec.read_timeout_s
        self._on_event = on_event
        self._control = EffortControl() if spec.effort == "auto" else None
        self.pump = Pump(lambda: _session(spec, stamp, epoch), stop, lambda it: it[1].is_keyframe)
        try:
            self._decoder, packet, arrival_ns = self.pump.get(spec.open_timeout_s)
            self._picture_s = time.monotonic()
            self._ahead = self._decoder.feed(packet, arrival_ns)
            while not self._decoder.started:
                self._ahead += self._next_items()
        except TimeoutError:
            self.pump.close()
            raise Disconnected(f"no answer within {spec.open_timeout_s:g} s") from None
        except BaseException:
            self.pump.close()
            raise
        self.info = dataclasses.replace(
            self._decoder.info, live=True, duration_s=None, frame_count=None
        )

    def _next_items(self) -> list[Item]:
        if self._decoder.ended:
            raise Disconnected(self._decoder.ended)
        try:
            _, packet, arrival_ns = self.pump.get(self._timeout_s)
        except TimeoutError:
            raise Disconnected(f"it sent nothing for {self._timeout_s:g} s") from None
        self._decoder.skip(self.pump.skipped)
        before = self._decoder.decoder.effort
        if self._control and self.pump.may_drop:
            self._decoder.decoder.ask_for(self._control.update(self.pump.waiting, time.monotonic()))
        items = self._decoder.feed(packet, arrival_ns)
        if (effort := self._decoder.decoder.effort) != before:
            why = "it comes faster than it is decoded" if effort == "fast" else "there is time"
            self._on_event(f"{self._spec.name}: {why}: decoded with effort {effort}")
        if any(isinstance(item, Frame) for item in items):
            self._picture_s = time.monotonic()
        elif time.monotonic() - self._picture_s > self._timeout_s:
            raise Disconnected(f"no picture of {self._timeout_s:g} s could be decoded")
        return items

    def items(self) -> Iterator[Item]:
        """Yield packets and frames."""
        self.pump.may_drop = not _is_recording(self._spec, self._decoder)
        yield from self._ahead
        self._ahead = []
        while True:
            yield from self._next_items()

    @property
    def damaged(self) -> int:
        """Frames and packets that could not be used."""
        return self._decoder.damaged_packets + self._decoder.damaged_frames

    @property
    def warnings(self) -> list[str]:
        """Warnings that belong in a result, one line each."""
        return list(filter(None, (self._decoder.guesses, self._decoder.decoder.without_device)))

    def close(self) -> None:
        """End the session, without waiting."""
        self.pump.close()


def _session(
    spec: SourceSpec, stamp: Stamp, epoch: int
) -> Iterator[tuple[StreamDecoder, Packet, int]]:
    """Yield the packets of one session, with their decoder; runs in the pump's thread."""
    with _open(spec) as container:
        if not container.streams.video:
            raise Disconnected("it sends no video")
        stream = container.streams.video[0]
        if stream.codec_context is None:
            raise Disconnected("there is no decoder for its video")
        decoder = StreamDecoder(container, stream, spec, stamp, epoch=epoch, live=True)
        arriving = ((packet, stamp.clock_ns()) for packet in container.demux(stream))
        try:
            for packet, arrival_ns in _with_times(arriving):
                yield decoder, packet, arrival_ns
        except av.ExitError:  # FFmpeg's own limit, which may run out before the reader's
            raise TimeoutError from None
        except av.FFmpegError as exc:
            raise Disconnected(f"the connection broke: {exc.strerror}") from None
        if _is_recording(spec, decoder):
            raise Stopped


def _is_recording(spec: SourceSpec, decoder: StreamDecoder) -> bool:
    """Whether it is a file on a web server, which comes as fast as it is taken, and ends."""
    return urlsplit(spec.url).scheme in ("http", "https") and bool(decoder.info.duration_s)


def _with_times(packets: Iterable[_Timed]) -> Iterator[_Timed]:
    """Give the first packets their time stamps.

    FFmpeg loses the RTP time stamp of the first picture of an H.264 or H.265 session. The picture
    can't be dropped, since later ones are predicted from it; its time is set one declared period
    before the second.
    """
    untimed: list[_Timed] = []
    for packet, arrival_ns in packets:
        if packet.size and packet.pts is None:
            untimed.append((packet, arrival_ns))
            if len(untimed) > _UNTIMED_LIMIT:
                raise Disconnected("it sends no time stamps")
            continue
        for places, (earlier, _) in enumerate(reversed(untimed), start=1):
            if packet.pts is not None:
                earlier.pts = earlier.dts = packet.pts - places * (packet.duration or 1)
        yield from untimed
        untimed.clear()
        yield packet, arrival_ns


def _open(spec: SourceSpec) -> InputContainer:
    begun_s = time.monotonic()
    try:
        return av.open(
            spec.url,
            "r",
            options=_OPTIONS,
            timeout=(spec.open_timeout_s, spec.read_timeout_s),
            metadata_errors="replace",
        )
    # FFmpeg's messages contain the full address with its password: they must not be shown.
    except (av.HTTPUnauthorizedError, av.HTTPForbiddenError):
        raise Disconnected(
            "the user or password is refused", "write it as user:password@…, percent-encoded"
        ) from None
    except av.HTTPNotFoundError:
        raise Disconnected("it has no such stream", "check the path of the address") from None
    except av.FFmpegError:
        if time.monotonic() - begun_s >= spec.open_timeout_s:  # FFmpeg calls it invalid data
            raise TimeoutError from None
        raise Disconnected(_why_unreachable(spec)) from None


def _why_unreachable(spec: SourceSpec) -> str:
    """Return why there is no session, which FFmpeg doesn't say, by trying a TCP connection."""
    try:
        parts = urlsplit(spec.url)
        address = (parts.hostname or "", parts.port or _DEFAULT_PORTS[parts.scheme])
        socket.create_connection(address, timeout=spec.open_timeout_s).close()
    except ValueError:
        return "the address can't be read"
    except socket.gaierror:
        return "its host name is unknown"
    except TimeoutError:
        return "no answer"
    except OSError as exc:
        return (exc.strerror or "no connection").lower()
    return "it doesn't answer with video"

"""The state of one camera, as the page shows it, with a thumbnail once a second at most."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsenf.bus.ring import RingReader
from rsenf.config import redact
from rsenf.dashboard.enf_series import EnfSeries, Point, References, in_ms, rounded, sensible
from rsenf.dashboard.spectrogram import RowStrip, Spectrogram
from rsenf.errors import SchemaMismatch
from rsenf.messages import (
    EnfEstimate,
    Frame,
    Header,
    IdleEstimate,
    Liveness,
    Mark,
    MatchResult,
    RowBlock,
    VideoPacket,
)
from rsenf.record.sequence import Timeline
from rsenf.timebase import NS_PER_S

WIDTH_PX = 320
QUALITY = 70
LEAST_PX = 16


class Preview:
    """The newest picture, as JPEG.

    Attributes
    ----------
    jpeg : bytes
        Empty before the first picture.
    number : int
        Number of pictures so far.
    """

    def __init__(self) -> None:
        self.jpeg, self.number = b"", 0
        self._taken_ns = 0
        self._ring: RingReader | None = None

    def take_frame(self, frame: Frame, now_ns: int) -> None:
        """Take a frame with pixels in its message or in a ring; skip it if they are unavailable."""
        if self._is_due(now_ns):
            luma = self._peek(frame) if frame.ring else _sent(frame)
            if luma is not None:
                self._keep(luma, now_ns)

    def take_packet(self, packet: VideoPacket, now_ns: int) -> None:
        """Take a packet of compressed video; skip it unless it is a key frame that decodes."""
        if packet.keyframe and packet.data and self._is_due(now_ns):
            picture = _decoded(packet)
            if picture is not None:
                self._keep(picture, now_ns)

    def _is_due(self, now_ns: int) -> bool:
        return not 0 <= now_ns - self._taken_ns < NS_PER_S

    def _keep(self, picture: NDArray[np.uint8], now_ns: int) -> None:
        import cv2

        height, width = picture.shape[:2]
        if min(height, width) < LEAST_PX:
            return
        size = (WIDTH_PX, max(LEAST_PX, round(height * WIDTH_PX / width)))
        small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
        done, coded = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
        if done:
            self.jpeg, self.number, self._taken_ns = coded.tobytes(), self.number + 1, now_ns

    def _peek(self, frame: Frame) -> NDArray[np.uint8] | None:
        """Copy a plane from the ring without releasing it: the ring's reader is another process."""
        try:
            if self._ring is None or self._ring.path.name != frame.ring:
                self.close()
                self._ring = RingReader(frame.ring)
            place = frame.ring_slot, frame.ring_ticket, frame.height_px, frame.width_px
            luma = self._ring.view(*place)
            copy = None if luma is None else luma.copy()
            del luma
            return copy if self._ring.view(*place) is not None else None
        except (OSError, SchemaMismatch, ValueError):  # ring of another host, removed, or invalid
            return None

    def close(self) -> None:
        """Detach from the ring."""
        if self._ring is not None:
            self._ring.close()
            self._ring = None


def _sent(frame: Frame) -> NDArray[np.uint8] | None:
    plane = np.frombuffer(frame.pixels, np.uint8)
    fits = plane.size and plane.size == frame.height_px * frame.width_px
    return plane.reshape(frame.height_px, frame.width_px) if fits else None


def _decoded(packet: VideoPacket) -> NDArray[np.uint8] | None:
    import av

    from rsenf.decode.packets import PacketDecoder

    try:
        decoder = PacketDecoder(packet.codec)
        pictures: list[Any] = [*decoder.decode(packet.data, None), *decoder.rest()]
        if not pictures:
            return None
        picture = pictures[0].picture
        height = max(2, round(picture.height * WIDTH_PX / picture.width))
        return np.asarray(picture.to_ndarray(width=WIDTH_PX, height=height, format="bgr24"))
    except (av.FFmpegError, ValueError):  # damaged packet or missing codec
        return None


KEPT_STREAMS = 20
LONGEST_LAG_S = 1e9  # some thirty years


class Feed:
    """One camera's state: takes its messages, returns JSON data.

    Parameters
    ----------
    name : str
        ``<site>/<camera>``.
    references : References
        References to compare its ENF with.
    clock_ns : callable
        Wall clock, UTC since 1970, in ns.
    claimed_ns : int
        Claimed time of its first frame, UTC in ns; 0 for a live feed.
    """

    def __init__(
        self, name: str, references: References, clock_ns: Callable[[], int], claimed_ns: int = 0
    ) -> None:
        self.name, self._claimed_ns = name, claimed_ns
        self.preview, self.series = Preview(), EnfSeries()
        self.strip, self.spectrogram = RowStrip(), Spectrogram()
        self.timeline = Timeline(clock_ns)
        self._references, self._clock_ns = references, clock_ns
        self._enf: EnfEstimate | None = None
        self._idle: IdleEstimate | None = None
        self._match: MatchResult | None = None
        self._live: Liveness | None = None
        self._rows: RowBlock | None = None
        self._heard_ns = 0
        self._known_streams: deque[tuple[str, int]] = deque(maxlen=KEPT_STREAMS)
        # Arrival of each stream's first message; each start and reconnection begins a new stream.
        self._began_ns: deque[int] = deque(maxlen=KEPT_STREAMS)
        self._streams, self._has_ended = 0, False
        self._first_frame_ns = 0
        self._take: dict[type[Any], Callable[[Any], None]] = {
            EnfEstimate: self._take_enf,
            IdleEstimate: self._take_idle,
            MatchResult: self._take_match,
            Liveness: self._take_live,
            RowBlock: self._take_rows,
            Frame: lambda frame: self.preview.take_frame(frame, clock_ns()),
            VideoPacket: lambda packet: self.preview.take_packet(packet, clock_ns()),
        }

    def update(self, message: Any) -> None:
        """Take a message of this camera; kinds that aren't shown are ignored."""
        take, header = self._take.get(type(message)), message.header
        if take is None:
            return
        self._heard_ns = self._clock_ns() // NS_PER_S * NS_PER_S
        if header.mark == Mark.DATA:
            self._note_stream(header)
            take(message)
        elif isinstance(message, RowBlock | EnfEstimate) and header.is_end:
            self._has_ended = True

    def close(self) -> None:
        """Detach from the frame ring."""
        self.preview.close()

    # --- messages --------------------------------------------------------------------------

    def _note_stream(self, header: Header) -> None:
        stream = header.run_id, header.epoch
        # Stages that were restarted at different times send messages of different streams.
        if stream in self._known_streams:
            return
        self._known_streams.append(stream)
        self._has_ended = False
        self._streams += 1
        self._began_ns.append(header.arrival_time_ns or self._clock_ns())
        self.spectrogram.begin_anew()

    def _take_enf(self, message: EnfEstimate) -> None:
        if message.rank:
            return
        self._enf = message
        if 40 < message.nominal_hz < 70:
            self.spectrogram.nominal_hz = message.nominal_hz
        header = message.header
        start_ns = self.timeline.log_time_ns(EnfEstimate, header) - header.pts_ns
        self._first_frame_ns = sensible(start_ns + message.origin_pts_ns)
        centre_ns = start_ns + (message.start_pts_ns + message.end_pts_ns) // 2
        if not sensible(centre_ns):
            return
        nan, found = math.nan, (message.enf_hz, message.enf_std_hz)
        enf_hz, std_hz = found if message.usable else (nan, nan)
        self.series.add(Point(centre_ns, enf_hz, std_hz, message.snr_db))

    def _take_idle(self, message: IdleEstimate) -> None:
        self._idle = message
        if message.verdict == "estimated" and 0 <= message.idle_ratio < 1:
            sign = -1.0 if message.direction == "reverse" else 1.0
            self.spectrogram.read_out_ratio = sign * (1.0 - message.idle_ratio)

    def _take_match(self, message: MatchResult) -> None:
        self._match = message

    def _take_live(self, message: Liveness) -> None:
        self._live = message

    def _take_rows(self, message: RowBlock) -> None:
        self._rows = message
        self.timeline.log_time_ns(RowBlock, message.header)
        if message.frames == len(message.frame_pts_ns) > 0 and message.rows > 0:
            self.strip.update(message)
            self.spectrogram.update(message)

    # --- JSON ------------------------------------------------------------------------------

    def card(self) -> dict[str, Any]:
        """Return the summary of the feed, for JSON."""
        enf, rows = self._enf, self._rows
        return {
            "name": self.name,
            "live": self._live_plain(),
            "enf_hz": rounded(enf.enf_hz, 5) if enf and enf.usable else None,
            "enf_std_hz": rounded(enf.enf_std_hz, 6) if enf and enf.usable else None,
            "enf_reason": redact(enf.reason) if enf and not enf.usable else "",
            "snr_db": rounded(enf.snr_db, 1) if enf else None,
            "nominal_hz": rounded(enf.nominal_hz, 0) if enf else None,
            "rows_reason": redact(rows.reason) if rows and not rows.usable else "",
            "steady_ratio": rounded(rows.steady_ratio, 2) if rows else None,
            "idle": self._idle_plain(),
            "match": self._match_plain(),
            "sparks_hz": self.series.sparks(),
            "picture": self.preview.number,
            "heard_ms": in_ms(self._heard_ns),
            "began_ms": [in_ms(t_ns) for t_ns in self._began_ns],
            "streams": self._streams,
            "has_ended": self._has_ended,
        }

    def chart(self, series: str) -> dict[str, Any]:
        """Return the ENF and the reference over time, for JSON; ``series`` as in EnfSeries."""
        placed = self._placed_reference()
        if placed is None:
            plain = self.series.plain(series, lambda t_ns: np.full(t_ns.shape, np.nan))
            return {"series": series, "placed": None, **plain}
        grid, first_sample_ns, how = placed
        plain = self.series.plain(
            series, lambda t_ns: self._references.at(grid, t_ns, first_sample_ns)
        )
        return {"series": series, "placed": {"grid": grid, "how": how}, **plain}

    def spectrogram_plain(self, seen: tuple[int, int]) -> dict[str, Any]:
        """Return the columns of the spectrogram after those seen, for JSON."""
        plain = self.spectrogram.columns.since(seen)
        if self._rows is not None:
            header = self._rows.header
            start_ns = self.timeline.log_time_ns(RowBlock, header) - header.pts_ns
            plain["t_ms"] = in_ms(start_ns + self.spectrogram.centre_pts_ns)
        return {**plain, "nominal_hz": self.spectrogram.nominal_hz}

    def strip_plain(self, seen: tuple[int, int]) -> dict[str, Any]:
        """Return the columns of the row strip after those seen, for JSON."""
        return {
            **self.strip.columns.since(seen),
            "rms_level": rounded(self.strip.rms_level, 3),
            "frame_rate_hz": rounded(self.strip.frame_rate_hz, 3),
            "axis": self._rows.read_out_axis if self._rows else "rows",
        }

    def _placed_reference(self) -> tuple[str, int, str] | None:
        """Grid to draw, time of its first sample on the feed's clock, and the source of that time.

        The source is 'claim', 'clock' or 'match'.
        """
        claimed_ns = self._claimed_ns - self._first_frame_ns if self._claimed_ns else 0
        found = self._references.by_clock(self.series.last_ns + claimed_ns)
        if found is not None:
            grid, t0_ns = found
            return grid, t0_ns - claimed_ns, "claim" if claimed_ns else "clock"
        match = self._match
        if match is None or match.decision != "match" or not self._first_frame_ns:
            return None
        if not abs(match.lag_s) < LONGEST_LAG_S:
            return None
        return match.grid, self._first_frame_ns - round(match.lag_s * 1e9), "match"

    def _live_plain(self) -> dict[str, Any] | None:
        live = self._live
        if live is None:
            return None
        # For a file, the verdict's times are in claimed time, the page's in time of replay.
        since_ns = live.since_ns
        if self._claimed_ns:
            first_ns = self._first_frame_ns
            since_ns = first_ns + since_ns - self._claimed_ns if first_ns else 0
        return {
            "verdict": live.verdict,
            "since_ms": in_ms(since_ns),
            "lag_s": rounded(live.lag_s, 2),
            "lag_std_s": rounded(live.lag_std_s, 2),
            "clock_ppm": rounded(live.clock_ppm, 1),
            "clock_std_ppm": rounded(live.clock_std_ppm, 1),
            "log10_lr": rounded(live.log10_lr, 1),
            "origin_ms": in_ms(live.origin_utc_ns),
            "evidence": redact(live.evidence),
        }

    def _idle_plain(self) -> dict[str, Any] | None:
        idle = self._idle
        if idle is None:
            return None
        return {
            "verdict": idle.verdict,
            "reason": redact(idle.reason),
            "ratio": rounded(idle.idle_ratio, 6),
            "low": rounded(idle.idle_ratio_low, 6),
            "high": rounded(idle.idle_ratio_high, 6),
            "read_out_ms": rounded(1e3 * idle.read_out_time_s, 3),
            "frame_rate_hz": rounded(idle.frame_rate_hz, 3),
        }

    def _match_plain(self) -> dict[str, Any] | None:
        match = self._match
        if match is None:
            return None
        return {
            "decision": match.decision,
            "grid": match.grid,
            "log10_lr": rounded(match.log10_lr, 1),
            "correlation": rounded(match.correlation, 3),
            "start_ms": in_ms(match.start_utc_ns),
            "clock_ppm": rounded(match.clock_ppm, 1),
            "seconds_used": rounded(match.seconds_used, 0),
            "text": redact(match.verbal or match.reason),
        }

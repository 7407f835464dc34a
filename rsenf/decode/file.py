"""A video file as a source, and its metadata. A separate thread decodes ahead of the consumer."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import cast

import av
import numpy as np
from av.container import InputContainer

from rsenf.decode.container import (
    HINT,
    duration_s,
    fraction,
    missing_bytes,
    open_container,
    rate_basis,
    video_stream,
)
from rsenf.decode.decoder import Packet
from rsenf.decode.pump import Disconnected, Pump, Stop, Stopped
from rsenf.decode.source import Item, SourceSpec, Stamp, VideoSource, cores
from rsenf.decode.stream import StreamDecoder
from rsenf.errors import InputError
from rsenf.messages import Frame, RateBasis

# Limits of decoding ahead: batches in the queue, and luma or frames in a batch. Stages process a
# second of video at a time, during which decoding should go on; but a 4K picture is 12 MB. Batches,
# because handing over single frames between two threads slows both down.
BATCHES = 3
BATCH_BYTES, BATCH_FRAMES = 4_000_000, 8
_FOREVER_S = float("inf")


@dataclass(frozen=True)
class DecodedStep:
    """Items decoded from one packet, and the source's loss and warnings after it."""

    items: list[Item]
    loss: str
    warnings: list[str]


def ahead(steps: Callable[[], Iterator[DecodedStep]], stop: Stop) -> Iterator[DecodedStep]:
    """Yield steps that another thread produces ahead.

    Parameters
    ----------
    steps : callable
        Returns the steps; called and iterated in that thread. Its exceptions are raised here, after
        the steps before them.
    stop : Stop
        Ends both threads, as does closing this iterator.
    """
    pump = Pump(lambda: _batches(steps()), stop, depth=BATCHES)
    try:
        while True:
            yield from pump.get(_FOREVER_S)
    except (Disconnected, Stopped):
        return
    finally:
        pump.close()


def _batches(steps: Iterator[DecodedStep]) -> Iterator[list[DecodedStep]]:
    batch: list[DecodedStep] = []
    frames = luma_bytes = 0
    try:
        for step in steps:
            batch.append(step)
            for item in step.items:
                if isinstance(item, Frame) and item.luma is not None:
                    frames, luma_bytes = frames + 1, luma_bytes + item.luma.nbytes
            if frames >= BATCH_FRAMES or luma_bytes >= BATCH_BYTES:
                yield batch
                batch, frames, luma_bytes = [], 0, 0
    except Exception:
        yield batch
        raise
    yield batch


_MOST_THREADS = 16  # FFmpeg's limit for its automatic choice


class FileSource(VideoSource):
    """Frames of a video file, as fast as they are consumed.

    A separate thread decodes ahead, unless frames are paced.

    Parameters
    ----------
    spec : SourceSpec
        Its ``url`` is a path.
    stamp, stop : Stamp, Stop
        As for every source.

    Raises
    ------
    UsageError
        When the file doesn't exist or can't be read.
    InputError
        When no frame can be decoded.
    """

    def __init__(self, spec: SourceSpec, stamp: Stamp, stop: Stop) -> None:
        super().__init__(stamp, stop, pace=spec.pace)
        self._path = Path(spec.url)
        self._container = open_container(self._path)
        stream = video_stream(self._container, self._path)
        self._records = spec.with_packets
        self._several = len(self._container.streams.video) > 1
        self._is_avi = self._container.format.name == "avi"
        spec = dataclasses.replace(spec, threads=_threads(spec))
        self._decoder = StreamDecoder(self._container, stream, spec, stamp)
        self._packets = self._container.demux(stream)
        self._missing_bytes = missing_bytes(self._path)
        self._broken_off = ""
        # The container must not be closed while another thread reads from it.
        self._lock = Lock()
        self._taken = DecodedStep([], self._loss(), self._warnings())
        self._first = self._first_items()
        self.info = self._decoder.info

    def _first_items(self) -> list[Item]:
        first: list[Item] = []
        while not self._decoder.started and not self._stop.is_set():
            step = self._step()
            if step is None:
                self.close()
                because = f" ({self.loss})" if self.loss else ""
                raise InputError(f"{self._path}: no frame can be decoded{because}", HINT)
            first += self._take(step)
        # Packets before the first picture: the camera's time is known with that.
        times_ns = [self._decoder.camera_time_ns(item.header.pts_ns) for item in first]
        return [
            dataclasses.replace(i, header=dataclasses.replace(i.header, camera_time_ns=t_ns))
            for i, t_ns in zip(first, times_ns, strict=True)
        ]

    def _take(self, step: DecodedStep) -> list[Item]:
        self._taken = step
        return step.items

    def _step(self) -> DecodedStep | None:
        """Decode one packet; None at the end."""
        packet: Packet | None
        with self._lock:
            if self._stop.is_set() or self._decoder.ended:
                return None
            try:
                packet = next(self._packets, None)
            except av.FFmpegError as exc:
                self._broken_off = f"reading stopped: {exc.strerror}"
                packet = cast(Packet, av.Packet())  # an empty packet flushes the decoder
            if packet is None:
                return None
            items = self._decoder.feed(packet, self._stamp.clock_ns())
            return DecodedStep(items, self._loss(), self._warnings())

    def _steps(self) -> Iterator[DecodedStep]:
        while (step := self._step()) is not None:
            yield step

    def _items(self) -> Iterator[Item]:
        first, self._first = self._first, []
        yield from first
        for step in self._steps() if self._pacer else ahead(self._steps, self._stop):
            yield from self._take(step)

    @property
    def loss(self) -> str:
        """What was lost until now, in one line; empty for nothing."""
        return self._taken.loss

    @property
    def warnings(self) -> list[str]:
        """Warnings that belong in a result though nothing was lost, one line each."""
        return self._taken.warnings

    def _loss(self) -> str:
        decoder = self._decoder
        lost = []
        if self._missing_bytes:
            lost.append(f"the file is cut short: {self._missing_bytes} bytes are missing")
        if reason := self._broken_off or decoder.ended:
            lost.append(reason)
        if lost:
            lost.append(f"decoded up to {decoder.time_s:.3f} s")
        if decoder.damaged_packets:
            lost.append(f"damaged packets: {decoder.damaged_packets}")
        if decoder.damaged_frames:
            lost.append(f"damaged frames, left out: {decoder.damaged_frames}")
        return "; ".join(lost)

    def _warnings(self) -> list[str]:
        found = []
        if self._several:
            found.append("it has several video streams: one was taken")
        if self._records and not self._decoder.info.packets_recordable:
            found.append(f"its video isn't recorded: {self._decoder.info.packets_reason}")
        guesses = self._decoder.guesses
        if self._is_avi and self._decoder.info.rate_basis is RateBasis.DECLARED:
            guesses = "AVI holds no frame times, only a rate: a varying rate would not show"
        found += filter(None, (guesses, self._decoder.decoder.without_device))
        if self._decoder.backward:
            found.append(f"frames that are not later than the one before: {self._decoder.backward}")
        return found

    def close(self) -> None:
        """Stop the iteration and close the file."""
        super().close()
        with self._lock:
            self._container.close()


def _threads(spec: SourceSpec) -> int:
    """Return the number of decoder threads; 0 for FFmpeg's choice.

    FFmpeg chooses one more than there are cores (a single one on one core). When decoding ahead it
    is another one more, so that a picture is in work while the reading thread waits for the GIL.
    """
    if spec.threads or spec.pace or cores() == 1:
        return spec.threads
    return min(cores() + 2, _MOST_THREADS)


# Metadata keys for each fact: QuickTime's and Android's names beside the plain one.
_SAID = {
    "creation_time": ("creation_time", "com.apple.quicktime.creationdate", "date"),
    "encoder": ("encoder", "com.apple.quicktime.software", "software", "firmware"),
    "make": ("make", "com.apple.quicktime.make", "com.android.manufacturer", "manufacturer"),
    "model": ("model", "com.apple.quicktime.model", "com.android.model"),
}


@dataclass(frozen=True, kw_only=True)
class ContainerFacts:
    """Metadata of a video file. Anyone could have written or changed them.

    Attributes
    ----------
    format, codec, pixel_format : str
        FFmpeg's names.
    width_px, height_px : int
    bit_rate_bps : int or None
        Of the whole file.
    duration_s : float or None
    declared_rate_hz : float or None
    rate_basis : str
        Source of the frame times, as in RateBasis; empty if frames have time stamps.
    stamped_frames : int
        Number of frames with a time stamp.
    shortest_s, median_s, longest_s : float or None
        Intervals between successive time stamps.
    creation_time, encoder, make, model : str
        Empty if not in the file.
    """

    format: str
    codec: str
    pixel_format: str
    width_px: int
    height_px: int
    bit_rate_bps: int | None
    duration_s: float | None
    declared_rate_hz: float | None
    rate_basis: str
    stamped_frames: int
    shortest_s: float | None
    median_s: float | None
    longest_s: float | None
    creation_time: str
    encoder: str
    make: str
    model: str


def container_facts(path: Path) -> ContainerFacts | None:
    """Read the metadata of a file; None if it is no video. Reads all packets, decodes none."""
    try:
        with open_container(path) as container:
            return _facts(container, video_stream(container, path))
    except InputError:
        return None


def _facts(container: InputContainer, stream: av.VideoStream) -> ContainerFacts:
    basis, context = rate_basis(container, stream), stream.codec_context
    rate_hz = float(fraction(None if basis is RateBasis.ASSUMED else stream.guessed_rate))
    ticks = np.sort(list(_stamps(container, stream)) if not basis else [])
    gaps_s = np.diff(ticks) * float(fraction(stream.time_base))
    shortest_s, median_s, longest_s = (
        map(float, np.quantile(gaps_s, (0.0, 0.5, 1.0))) if gaps_s.size else (None, None, None)
    )
    return ContainerFacts(
        format=container.format.long_name,
        codec=" ".join(filter(None, [context.name, context.profile])),
        pixel_format=context.pix_fmt or "",
        width_px=context.width,
        height_px=context.height,
        bit_rate_bps=container.bit_rate or None,
        duration_s=duration_s(container, stream),
        declared_rate_hz=rate_hz or None,
        rate_basis=str(basis),
        stamped_frames=ticks.size,
        shortest_s=shortest_s,
        median_s=median_s,
        longest_s=longest_s,
        **_said(container, stream),
    )


def _stamps(container: InputContainer, stream: av.VideoStream) -> Iterator[int]:
    """Yield presentation time stamps in ticks, as far as the file can be read."""
    try:
        for packet in container.demux(stream):
            if packet.pts is not None:
                yield packet.pts
    except av.FFmpegError:
        return


def _said(container: InputContainer, stream: av.VideoStream) -> dict[str, str]:
    """Return metadata by plain names; both values where the file and the stream differ."""
    metadata = [{k.lower(): v for k, v in of.metadata.items()} for of in (container, stream)]
    return {
        name: "; ".join(dict.fromkeys(one[key] for key in keys for one in metadata if key in one))
        for name, keys in _SAID.items()
    }

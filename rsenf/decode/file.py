"""A video file as a source. A separate thread decodes ahead while the consumer works."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import cast

import av
from av.container import InputContainer
from av.stream import Disposition

from rsenf.decode.pump import Disconnected, Pump, Stopped
from rsenf.decode.source import Item, Stamp, VideoSource
from rsenf.decode.spec import SourceSpec, cores
from rsenf.decode.stream import Packet, StreamDecoder
from rsenf.decode.structure import lacks_index, missing_bytes
from rsenf.decode.waiting import Stop
from rsenf.errors import InputError, UsageError
from rsenf.messages import Frame, RateBasis

# Limits of decoding ahead: batches in the queue, and luma or frames in a batch. Stages process a
# second of video at a time, during which decoding should go on; but a 4K picture is 12 MB. Batches,
# because handing over single frames between two threads slows both down.
BATCHES = 3
BATCH_BYTES, BATCH_FRAMES = 4_000_000, 8
_FOREVER_S = float("inf")


@dataclass(frozen=True)
class Step:
    """Items decoded from one packet, and the source's loss and warnings after it."""

    items: list[Item]
    loss: str
    warnings: list[str]


def ahead(steps: Callable[[], Iterator[Step]], stop: Stop) -> Iterator[Step]:
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


def _batches(steps: Iterator[Step]) -> Iterator[list[Step]]:
    batch: list[Step] = []
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


# Concatenated JPEG pictures, which FFmpeg opens as a slide show unless told the format.
_JPEGS, _MOTION_JPEG = "jpeg_pipe", "mjpeg"
# Formats that FFmpeg opens though they are no recordings: text as pictures, lists of files.
_NOT_VIDEO = {"tty", "bin", "xbin", "adf", "idf", "concat", "hls", "dash", "sdp", "image2"}
_MOST_THREADS = 16  # FFmpeg's limit for its automatic choice
_HINT = "give a video file that plays, such as mp4, mov, mkv, webm or avi"


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
        self._several = len(self._container.streams.video) > 1
        self._is_avi = self._container.format.name == "avi"
        spec = dataclasses.replace(spec, threads=_threads(spec))
        self._decoder = StreamDecoder(self._container, stream, spec, stamp)
        self._packets = self._container.demux(stream)
        self._missing_bytes = missing_bytes(self._path)
        self._broken_off = ""
        # The container must not be closed while another thread reads from it.
        self._lock = Lock()
        self._taken = Step([], self._loss(), self._warnings())
        self._first = self._first_items()
        self.info = self._decoder.info

    def _first_items(self) -> list[Item]:
        first: list[Item] = []
        while not self._decoder.started and not self._stop.is_set():
            step = self._step()
            if step is None:
                self.close()
                raise InputError(f"{self._path}: no frame can be decoded{self._because()}", _HINT)
            first += self._take(step)
        return first

    def _because(self) -> str:
        return f" ({self.loss})" if self.loss else ""

    def _take(self, step: Step) -> list[Item]:
        self._taken = step
        return step.items

    def _step(self) -> Step | None:
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
            return Step(items, self._loss(), self._warnings())

    def _steps(self) -> Iterator[Step]:
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
        if self._is_avi and self._decoder.info.rate_basis is RateBasis.DECLARED:
            found.append("AVI holds no frame times, only a rate: a varying rate would not show")
        elif self._decoder.guesses:
            found.append(self._decoder.guesses)
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


def open_container(path: Path) -> InputContainer:
    """Open a video file.

    Raises
    ------
    UsageError
        When it can't be read.
    InputError
        When it is no video.
    """
    try:
        with path.open("rb") as file:
            empty = not file.read(1)
    except OSError as exc:
        reason = (exc.strerror or "no access").lower()
        raise UsageError(f"{path} can't be read: {reason}", "check the path of the video") from exc
    if empty:
        raise InputError(f"{path} is empty", _HINT)
    try:
        container = _opened(path)
        if container.format.name == _JPEGS and _has_several(container):
            container.close()
            container = _opened(path, _MOTION_JPEG)
    except av.FFmpegError as exc:
        if lacks_index(path):
            raise InputError(
                f"{path} was never finished: its index (moov) is missing",
                "the camera stopped before closing it; a repair tool may rebuild the index",
            ) from exc
        raise InputError(f"{path} is not a video that can be read", _HINT) from exc
    names = set(container.format.name.split(","))
    if names & _NOT_VIDEO or container.format.name.endswith("_pipe"):
        raise InputError(f"{path} is not a video: it reads as {container.format.long_name}", _HINT)
    return container


def _opened(path: Path, form: str | None = None) -> InputContainer:
    # An absolute path, so that no file name is taken for a protocol.
    return av.open(str(path.absolute()), "r", form, metadata_errors="replace")


def _has_several(pictures: InputContainer) -> bool:
    """Whether there is more than one picture: a video, not a photograph."""
    return sum(1 for packet in itertools.islice(pictures.demux(), 2) if packet.size) > 1


def video_stream(container: InputContainer, path: Path) -> av.VideoStream:
    """Return the main video stream; the cover picture of an audio file is none.

    Parameters
    ----------
    container : av.container.InputContainer
    path : Path
        For messages.

    Raises
    ------
    InputError
        When there is none, or no decoder for it.
    """
    streams = [s for s in container.streams.video if not s.disposition & Disposition.attached_pic]
    if not streams:
        only = ", only sound" if container.streams.audio else ""
        raise InputError(f"{path} has no video{only}", _HINT)
    best = container.streams.best("video")
    stream = best if best in streams else streams[0]
    assert isinstance(stream, av.VideoStream)
    if stream.codec_context is None:
        raise InputError(f"{path}: no decoder for its video stream", _HINT)
    return stream

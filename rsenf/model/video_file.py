"""Encodes frames into a video file, by FFmpeg's encoders and containers, and their settings."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from rsenf.errors import UsageError
from rsenf.model.parameters import ParameterError, parameter
from rsenf.whole_file import whole_file

if TYPE_CHECKING:
    import av
    from av.video.stream import VideoStream

ENCODERS = {"h264": "libx264", "h265": "libx265", "vp9": "libvpx-vp9", "mjpeg": "mjpeg"}
_PRESETS = ("ultrafast", "superfast", "veryfast", "faster", "fast", "medium", "slow", "slower")
# AVI has no presentation times, so it needs a codec without frame reordering.
CONTAINERS = {
    ".mp4": tuple(ENCODERS),
    ".mov": tuple(ENCODERS),
    ".mkv": tuple(ENCODERS),
    ".avi": ("mjpeg",),
    ".webm": ("vp9",),
}
# Fixed, since the encoder's result depends on the number of threads.
THREADS = 3
_GREY = 128


@dataclass(frozen=True, kw_only=True)
class Codec:
    """An encoder and its settings."""

    name: str = parameter("h264", "codec", choices=tuple(ENCODERS))
    bitrate_bps: int | None = parameter(
        None, "mean bit rate; None is constant quality", low=1000, high=1_000_000_000
    )
    crf: int = parameter(18, "constant quality, when no bit rate is given", low=0, high=51)
    lossless: bool = parameter(False, "what is decoded is what was rendered, bit for bit")
    preset: str | None = parameter(
        None,
        "x264's and x265's effort; None is 'superfast' at a bit rate, else 'ultrafast'",
        choices=_PRESETS,
    )
    weighted_prediction: bool | None = parameter(
        None, "whether h264 and h265 follow changes of brightness by a factor; None is the preset's"
    )
    gop_frames: int = parameter(250, "most frames from one key frame to the next", low=1, high=3000)

    def validate(self) -> None:
        """Check combinations of parameters.

        Raises
        ------
        ParameterError
            For a bit rate together with lossless, lossless MJPEG, and weighted prediction where the
            codec has none.
        """
        if self.lossless and self.bitrate_bps is not None:
            raise ParameterError(("codec", "lossless"), "excludes codec.bitrate_bps")
        if self.lossless and self.name == "mjpeg":
            raise ParameterError(
                ("codec", "lossless"), "can't be had from mjpeg", "use h264, h265 or vp9"
            )
        if self.weighted_prediction is not None and self.name not in ("h264", "h265"):
            raise ParameterError(("codec", "weighted_prediction"), f"isn't known to {self.name}")

    def options(self) -> dict[str, str]:
        """Private options of the encoder, as FFmpeg names them."""
        preset = self.preset or ("superfast" if self.bitrate_bps else "ultrafast")
        asked = {None: -1, False: 0, True: 1}[self.weighted_prediction]
        if self.name == "h264":
            weights = ({"weightp": "none"}, {"weightp": "smart"}, {})[asked]
            return {"preset": preset, **weights, **self._quality({"qp": "0"})}
        if self.name == "h265":
            # x265 would write its log to stderr.
            params = "log-level=none" + (":weightp=0", ":weightp=1", "")[asked]
            params += ":lossless=1" if self.lossless else ""
            return {"preset": preset, "x265-params": params, **self._quality({})}
        if self.name == "vp9":
            return {"deadline": "realtime", "cpu-used": "8", **self._quality({"lossless": "1"})}
        return {} if self.bitrate_bps else {"qmin": "3", "qmax": "3"}

    def _quality(self, lossless: dict[str, str]) -> dict[str, str]:
        if self.lossless:
            return lossless
        return {} if self.bitrate_bps else {"crf": str(self.crf)}


class Frames(Protocol):
    """Frames to encode, such as :class:`rsenf.model.full_video.FrameStream`.

    Iterating yields ``(pts, luma)``: the time in units of ``time_base``, and a uint8 array.
    """

    @property
    def frame_rate(self) -> Fraction:
        """Nominal frame rate."""

    @property
    def time_base(self) -> Fraction:
        """Seconds per unit of ``pts``."""

    @property
    def height_px(self) -> int:
        """Height of a frame, even."""

    @property
    def width_px(self) -> int:
        """Width of a frame, even."""

    def __iter__(self) -> Iterator[tuple[int, NDArray[np.uint8]]]: ...


def write_video(
    path: Path, frames: Frames, codec: Codec, progress: Callable[[int], None] | None = None
) -> int:
    """Encode a clip into a file, which appears only when it is complete.

    Presentation times are exact in mp4 and mov, and in avi if they are whole frame periods;
    otherwise avi, as Matroska and WebM always, is accurate to a millisecond.

    Parameters
    ----------
    path : Path
        ``.mp4``, ``.mov``, ``.mkv``, ``.avi`` or ``.webm``.
    frames : Frames
        The clip.
    codec : Codec
        Encoder and its settings.
    progress : callable, optional
        Called with the number of frames encoded, after each.

    Returns
    -------
    int
        Frames written.

    Raises
    ------
    UsageError
        For an unknown kind of file, a codec that it can't hold, or an odd frame size.
    RecordingError
        When the file can't be written.
    """
    return write_videos({path: codec}, frames, progress)


def write_videos(
    codecs: Mapping[Path, Codec], frames: Frames, progress: Callable[[int], None] | None = None
) -> int:
    """Encode a clip into several files in one pass.

    The files appear when all are complete; otherwise as :func:`write_video`.

    Parameters
    ----------
    codecs : mapping of Path to Codec
        Encoder settings of each file.
    frames : Frames
        The clip, rendered once.
    progress : callable, optional
        Called with the number of frames encoded, after each.
    """
    for path, codec in codecs.items():
        _check(path, frames, codec)
    written = 0
    with ExitStack() as open_files:
        encoders = [
            open_files.enter_context(_encoder(path, frames, codec))
            for path, codec in codecs.items()
        ]
        for pts, luma in frames:
            for encode in encoders:
                encode(pts, luma)
            written += 1
            if progress is not None:
                progress(written)
    return written


@contextmanager
def _encoder(
    path: Path, frames: Frames, codec: Codec
) -> Iterator[Callable[[int, NDArray[np.uint8]], None]]:
    """Yield a function that encodes a frame; the file is complete on exit."""
    import av

    with whole_file(path) as part, av.open(str(part), "w") as container:
        stream = _open_stream(container, frames, codec)

        def encode(pts: int, luma: NDArray[np.uint8]) -> None:
            picture = _picture(luma, stream.pix_fmt or "yuv420p")
            picture.pts, picture.time_base = pts, frames.time_base
            container.mux(stream.encode(picture))

        yield encode
        container.mux(stream.encode(None))


def _check(path: Path, frames: Frames, codec: Codec) -> None:
    codec.validate()
    if path.suffix not in CONTAINERS:
        raise UsageError(f"{path}: not a video file's name", f"end it in {', '.join(CONTAINERS)}")
    if codec.name not in CONTAINERS[path.suffix]:
        raise UsageError(
            f"{path}: {path.suffix} doesn't hold {codec.name} here",
            f"it holds {' or '.join(CONTAINERS[path.suffix])}",
        )
    if frames.width_px % 2 or frames.height_px % 2:
        raise UsageError(
            f"a video of {frames.width_px}x{frames.height_px} can't be encoded",
            "its colour planes are half as large: use even numbers",
        )


def _open_stream(
    container: av.container.OutputContainer, frames: Frames, codec: Codec
) -> VideoStream:
    stream: Any = container.add_stream(
        ENCODERS[codec.name], rate=frames.frame_rate, options=codec.options()
    )
    stream.width, stream.height = frames.width_px, frames.height_px
    stream.pix_fmt = "yuvj420p" if codec.name == "mjpeg" else "yuv420p"
    stream.codec_context.time_base = frames.time_base
    stream.codec_context.gop_size = codec.gop_frames
    stream.codec_context.thread_count = THREADS
    # 0 leaves the rate to the quality; FFmpeg's default would be 200 kbit/s.
    stream.bit_rate = codec.bitrate_bps or 0
    return stream  # type: ignore[no-any-return] # PyAV types it by the encoder's name


def _picture(luma: NDArray[np.uint8], pix_fmt: str) -> Any:
    """Return a grey picture; a new one for each frame, as the encoder may keep it."""
    import av

    height, width = luma.shape
    picture = av.VideoFrame(width, height, pix_fmt)
    for number, plane in enumerate(picture.planes):
        pixels = np.frombuffer(memoryview(plane), np.uint8).reshape(-1, plane.line_size)
        if number:
            pixels[:] = _GREY
        else:
            pixels[:height, :width] = luma
    return picture

"""The simulator as a video source, and as a codec's effect on given row means.

As a source it makes frames of the capture model, without a codec. For discovery it tells what a
recording's own codec does: the mean picture of the recording is modulated by the given row means,
gets sensor noise, passes an encoder of the same codec, bit rate and GOP length, and is sampled as
the recording was. The encoder's other settings are unknown, so the loss is alike in size, not
sample by sample.
"""

from __future__ import annotations

import itertools
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from rsenf.config.schemas import SimulatedInput, load_model
from rsenf.decode.source import StreamInfo, from_frames
from rsenf.messages.schema import Float32Array
from rsenf.model import FrameStream, GridPath, render_frames, synthetic_grid
from rsenf.model.noise import WHITE, NoiseBank, Sensor
from rsenf.model.scene import strip_edges
from rsenf.model.video_file import Codec
from rsenf.reference import read_reference
from rsenf.rows.settings import ReadOut, RowsSettings
from rsenf.rows.steady import picture_part
from rsenf.timebase import pts_to_ns

if TYPE_CHECKING:
    from rsenf.decode.source import VideoSource


def open_simulated(
    config: SimulatedInput, source: str, run_id: str, *, pace: bool, stop: Event
) -> VideoSource:
    """Open the simulator as a source.

    Parameters
    ----------
    config : SimulatedInput
        Capture model, grid (a reference or a synthetic one), duration and seed.
    source, run_id : str
        For the headers of the frames.
    pace : bool
        Yield frames in real time, as if live.
    stop : Event
        Ends the source.
    """
    model = load_model(config.model)
    if config.reference:
        measured = read_reference(config.reference, timezone=config.timezone, step_s=config.step_s)
        grid = GridPath(measured.freq_hz, measured.step_s, config.start_s, measured.nominal_hz)
    else:
        grid = synthetic_grid(config.seed, config.duration_s + 1.0, start_s=config.start_s)
    stream = render_frames(model, grid, config.duration_s, config.seed)
    info = StreamInfo(
        codec="rawvideo",
        width_px=model.shutter.columns,
        height_px=model.shutter.rows,
        declared_rate_hz=float(model.shutter.frame_rate),
        duration_s=config.duration_s,
        packets_reason="simulated frames were never compressed",
    )
    return from_frames(
        _timed(stream),
        info,
        source=source,
        run_id=run_id,
        clock_ns=time.time_ns,
        pace=pace,
        stop=stop,
    )


def _timed(stream: FrameStream) -> Iterator[tuple[int, NDArray[np.uint8]]]:
    for ticks, luma in stream:
        yield pts_to_ns(ticks, stream.time_base), luma


CODECS = {"h264": "h264", "hevc": "h265", "vp9": "vp9", "mjpeg": "mjpeg"}  # h264 for any other
LOSSLESS_H264 = "High 4:4:4 Predictive"  # used with 4:2:0 for lossless coding only
SEED = 0
PICTURES = 300  # of which the mean picture is taken


@dataclass(frozen=True, eq=False)
class LitFrames:
    """Frames of a recording's mean picture under given light; iterated by the encoder.

    Attributes
    ----------
    picture : ndarray of float32 (height, width)
    light : ndarray of float32 (frames, lines, strips)
        Brightness relative to its mean over the frames.
    axis : str
        Direction of the lines: ``rows`` or ``columns``.
    frame_rate : Fraction
    sensor : Sensor
        Model of the noise.
    """

    picture: Float32Array
    light: Float32Array
    axis: str
    frame_rate: Fraction
    sensor: Sensor

    @property
    def time_base(self) -> Fraction:
        """One frame period: constant, since time stamps don't affect a codec."""
        return 1 / self.frame_rate

    @property
    def height_px(self) -> int:
        """Height, an even number."""
        return int(self.picture.shape[0])

    @property
    def width_px(self) -> int:
        """Width, an even number."""
        return int(self.picture.shape[1])

    def __iter__(self) -> Iterator[tuple[int, NDArray[np.uint8]]]:
        rng = np.random.default_rng(SEED)
        bank = NoiseBank(self.width_px, SEED)
        sigma = np.sqrt(self.sensor.variance(self.picture))
        turned = self.axis == "columns"
        across = self.height_px if turned else self.width_px
        pixels = np.diff(strip_edges(across, self.light.shape[2]))
        for n, light in enumerate(self.light):
            lit = np.repeat(light, pixels, axis=1)
            level = bank.rows(bank.places(rng, (self.height_px,)))
            level *= sigma
            level += self.picture * (lit.T if turned else lit)
            np.rint(level, out=level)
            yield n, np.clip(level, 0, WHITE, out=level).astype(np.uint8)


def is_lossy(path: Path) -> bool:
    """Whether a video's codec is lossy, as far as its file tells; False for what is no video.

    Lossless H.264 is recognised by its profile; lossless H.265 and VP9 count as lossy.
    """
    import av

    try:
        with av.open(str(path)) as container:
            if not container.streams.video:
                return False
            codec = container.streams.video[0].codec_context
            exact = codec.profile == LOSSLESS_H264 and (codec.pix_fmt or "").startswith("yuv420")
            return codec.codec.lossy and not exact
    except (av.FFmpegError, OSError):
        return False


def recoded(path: Path, level: Float32Array, axis: str, settings: RowsSettings) -> Float32Array:
    """Return row means after coding them with a recording's own codec.

    Parameters
    ----------
    path : Path
        The recording, a video.
    level : ndarray of float32 (frames, lines, strips)
        Row means before coding, in levels.
    axis : str
        Direction of the lines: ``rows`` or ``columns``.
    settings : RowsSettings
        Settings with which the recording was sampled.

    Returns
    -------
    ndarray of float32 (frames, lines, strips)
    """
    import dataclasses

    from rsenf.model.video_file import write_video
    from rsenf.run.inline import analyse
    from rsenf.run.inputs import open_input_file

    picture, rate, codec = _seen(path, path.stat().st_mtime_ns)
    picture = picture[picture_part(picture)]
    # Encoders need even sizes: odd ones are padded by a line, which is cut off again.
    picture = np.pad(picture, [(0, n % 2) for n in picture.shape], mode="edge")
    light = level / np.maximum(level.mean(axis=0), 1e-6)
    light = np.pad(light, ((0, 0), (0, level.shape[1] % 2), (0, 0)), mode="edge")
    blocks: list[Float32Array] = []

    def tap(topic: str, message: Any) -> None:
        if topic == "rows":
            blocks.append(message.level)

    with tempfile.TemporaryDirectory() as folder:
        again = Path(folder) / f"again{'.avi' if codec.name == 'mjpeg' else '.mkv'}"
        write_video(again, LitFrames(picture, light, axis, rate, Sensor()), codec)
        settings = dataclasses.replace(settings, read_out_axis=cast(ReadOut, axis))
        analyse(open_input_file(again), rows=settings, tap=tap)
    return np.concatenate(blocks)[:, : level.shape[1]]


@lru_cache(maxsize=1)
def _seen(path: Path, written_ns: int) -> tuple[Float32Array, Fraction, Codec]:
    """Return mean picture, frame rate and codec of a video, as far as the file tells.

    Each recording is decoded once for all of its codings; ``written_ns`` tells another file apart.
    """
    import av

    from rsenf.decode.stream import luma_plane

    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        stream.thread_type = "AUTO"
        total, pictures = np.zeros((stream.height, stream.width), np.float32), 0
        for frame in itertools.islice(container.decode(stream), PICTURES):
            total += luma_plane(frame)
            pictures += 1
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        is_key = [packet.is_keyframe for packet in container.demux(stream) if packet.size]
        keys, frames = np.flatnonzero(is_key).tolist(), len(is_key)
        rate = Fraction(stream.average_rate or 30)
        name = CODECS.get(stream.codec_context.name, "h264")
        bits = stream.bit_rate or 8 * path.stat().st_size * float(rate) / max(frames, 1)
    group = int(max(np.diff([*keys, frames]), default=1))
    codec = Codec(name=name, bitrate_bps=int(max(bits, 1000)), gop_frames=min(max(group, 1), 3000))
    return total / np.float32(max(pictures, 1)), rate, codec

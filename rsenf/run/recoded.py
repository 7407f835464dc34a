"""What its codec alone makes of a recording: rows as they ought to be, filmed and coded again.

The mean picture of the recording is lit as some model says its lines are, given a sensor's noise,
put through an encoder of the same kind, rate and groups of pictures, and sampled as the recording
was. The encoder's other settings aren't known; so it is alike in size, not error by error.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from rsenf.messages.schema import Float32Array
from rsenf.model.codec import Codec
from rsenf.model.noise import NoiseBank
from rsenf.model.sensor import WHITE, Sensor
from rsenf.model.strips import strip_edges
from rsenf.rows.settings import ReadOut, RowsSettings

CODECS = {"h264": "h264", "hevc": "h265", "vp9": "vp9", "mjpeg": "mjpeg"}  # h264 for any other
LOSSLESS_H264 = "High 4:4:4 Predictive"  # with 4:2:0 nobody uses it for anything else
SEED = 0


@dataclass(frozen=True, eq=False)
class Filmed:
    """The mean picture of a recording under the light that its lines should have.

    Iterating yields what an encoder takes.

    Attributes
    ----------
    picture : ndarray of float32 (height, width)
    light : ndarray of float32 (frames, lines, strips)
        Relative to its mean.
    axis : str
        Along which the lines lie.
    frame_rate : Fraction
    sensor : Sensor
        Whose noise is added.
    """

    picture: Float32Array
    light: Float32Array
    axis: str
    frame_rate: Fraction
    sensor: Sensor

    @property
    def time_base(self) -> Fraction:
        """Frames come regularly: to a codec times mean nothing."""
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
            level = self.picture * (lit.T if turned else lit)
            level += sigma * bank.rows(bank.places(rng, (self.height_px,)))
            yield n, np.clip(np.rint(level), 0, WHITE).astype(np.uint8)


def is_lossy(path: Path) -> bool:
    """Whether a video's codec takes something away, as far as its file tells.

    H.264 does; lossless H.265 and VP9 can't be told from lossy. What is no video isn't coded.
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
    """Return the row means that are left of others after a recording's own codec.

    Parameters
    ----------
    path : Path
        The recording, a video.
    level : ndarray of float32 (frames, lines, strips)
        What they are before it.
    axis : str
        ``rows`` or ``columns``: along which the lines lie.
    settings : RowsSettings
        With which the recording was sampled.
    """
    import dataclasses

    from rsenf.model.video_file import write_video
    from rsenf.run.inline import analyse
    from rsenf.run.inputs import open_input_file

    picture, rate, codec = _seen(path)
    # Encoders take even sizes: a line is added where one lacks, and taken off again.
    picture = np.pad(picture, [(0, n % 2) for n in picture.shape], mode="edge")
    light = level / np.maximum(level.mean(axis=0), 1e-6)
    light = np.pad(light, ((0, 0), (0, level.shape[1] % 2), (0, 0)), mode="edge")
    blocks: list[Float32Array] = []

    def tap(topic: str, message: Any) -> None:
        if topic == "rows":
            blocks.append(message.level)

    with tempfile.TemporaryDirectory() as folder:
        again = Path(folder) / f"again{'.avi' if codec.name == 'mjpeg' else '.mkv'}"
        write_video(again, Filmed(picture, light, axis, rate, Sensor()), codec)
        settings = dataclasses.replace(settings, read_out_axis=cast(ReadOut, axis))
        analyse(open_input_file(again), rows=settings, tap=tap)
    return np.concatenate(blocks)[:, : level.shape[1]]


def _seen(path: Path) -> tuple[Float32Array, Fraction, Codec]:
    """Mean picture of a video, its frame rate, and its codec as far as the file tells."""
    import av

    from rsenf.decode.luma import luma_plane

    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        stream.thread_type = "AUTO"
        total, frames, keys = np.zeros((stream.height, stream.width)), 0, []
        for frame in container.decode(stream):
            total += luma_plane(frame)
            if frame.key_frame:
                keys.append(frames)
            frames += 1
        rate = Fraction(stream.average_rate or 30)
        name = CODECS.get(stream.codec_context.name, "h264")
        bits = stream.bit_rate or 8 * path.stat().st_size * float(rate) / max(frames, 1)
    group = int(max(np.diff([*keys, frames]), default=1))
    codec = Codec(
        name=name,
        bitrate_bps=int(max(bits, 1000)),
        gop_frames=min(max(group, 1), 3000),
    )
    return np.asarray(total / max(frames, 1), np.float32), rate, codec

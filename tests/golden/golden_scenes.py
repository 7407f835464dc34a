"""What the golden recordings show: each scene with its seed, and why it is there."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsenf.model import CaptureModel, FrameStream, Light, Shutter
from rsenf.model.video_file import Codec

ROWS, COLUMNS = 72, 64
SECONDS = 34.0  # a little more than the matcher wants at least


@dataclass(frozen=True)
class Scene:
    """One of them.

    Attributes
    ----------
    seed : int
        Of the grid, the place on it, and the capture.
    loops_s : float
        How long the feed runs before it begins again; 0 for never.
    stages : dict
        Nodes of its graph beyond decode, track, idle and match.
    """

    name: str
    seed: int
    model: CaptureModel
    nominal_hz: float = 50.0
    loops_s: float = 0.0
    stages: dict[str, Any] = field(default_factory=dict)


def _camera(
    rate: Fraction,
    *,
    lamp: str = "led",
    flicker_ratio: float | None = None,
    daylight_ratio: float = 0.0,
    kbit_s: int = 90,
) -> CaptureModel:
    return CaptureModel(
        light=Light(lamp=lamp, flicker_ratio=flicker_ratio, daylight_ratio=daylight_ratio),
        shutter=Shutter(frame_rate=rate, rows=ROWS, columns=COLUMNS, idle_ratio=0.2),
        codec=Codec(bitrate_bps=1000 * kbit_s, gop_frames=60),
    ).with_effect("exposure", exposure_s=0.002)


NTSC, PAL, THIRTY = Fraction(30000, 1001), Fraction(25), Fraction(30)
BOX = {"width_ratio": 0.25, "height_ratio": 0.4, "top_ratio": 0.3, "period_s": 5.0}

SCENES = (
    Scene("still_2997", 1, _camera(NTSC)),
    # The flicker stands nearly still from frame to frame. Here it still moves enough to be told
    # from texture; below it doesn't, in 34 s, and that is said.
    Scene("still_25_at_50", 2, _camera(PAL)),
    Scene("still_30_at_60", 3, _camera(THIRTY), nominal_hz=60.0),
    Scene("weak_cfl", 4, _camera(NTSC, lamp="cfl", daylight_ratio=0.3, kbit_s=30)),
    Scene("moving", 5, _camera(NTSC).with_effect("moving_object", **BOX)),
    # The watch has its verdict at once here; elsewhere a look takes it half a minute.
    Scene(
        "no_mains_light",
        6,
        _camera(NTSC, flicker_ratio=0.0, daylight_ratio=1.0),
        stages={
            "discover": {
                "kind": "discover",
                "cameras": ["cam"],
                "discover": {"window_s": 26.0, "every_s": 4.0},
            }
        },
    ),
    Scene(
        "dropped_frames",
        7,
        _camera(NTSC).with_effect("frame_drop", drops_per_min=12.0, retimed=False),
    ),
    Scene("looped", 8, _camera(NTSC), loops_s=17.0),
)


class Looped:
    """The first frames of a clip, over and over, as a player gives them that shows a file."""

    def __init__(self, clip: FrameStream, loop_s: float) -> None:
        self.frame_rate, self.time_base = clip.frame_rate, clip.time_base
        self.height_px, self.width_px = clip.height_px, clip.width_px
        self._clip, self._frames = clip, round(loop_s * clip.frame_rate)

    def __iter__(self) -> Iterator[tuple[int, NDArray[np.uint8]]]:
        shown: list[NDArray[np.uint8]] = []
        for n, (pts, luma) in enumerate(self._clip):
            if n < self._frames:
                shown.append(luma.copy())
            yield pts, shown[n % self._frames]

"""FFmpeg's own filters, through which a film goes before it is coded, and what they do to its time.

A filter's pictures are FFmpeg's. Here stands what is still true of them: how fast they are shown,
and at which rate.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction

Rate = Callable[[float], float]  # of the sensor to that of the file, hertz


@dataclass(frozen=True, kw_only=True)
class Filter:
    """Chains of FFmpeg's filters, one for each pass.

    Attributes
    ----------
    passes : tuple of str
        All but the last measure only. ``{folder}`` stands for a folder of their own, ``{rate}``
        for the file's rate.
    rate : callable
        Rate of the file by that of the sensor.
    speed : float
        How many seconds of the scene a second of the file shows.
    """

    passes: tuple[str, ...]
    rate: Rate = float
    speed: float = 1.0


def _at(rate: str) -> Rate:
    return lambda _: float(Fraction(rate))


def _times(ratio: float) -> Rate:
    return lambda sensor: sensor * ratio


FILTERS = {
    **{f"fps {r}": Filter(passes=(f"fps={r}",), rate=_at(r)) for r in ("24", "25", "30", "60")},
    "fps 30000/1001": Filter(passes=("fps=30000/1001",), rate=_at("30000/1001")),
    **{
        f"minterpolate {mode} {rate}": Filter(
            passes=(f"minterpolate=fps={rate}:mi_mode={mode}:scd=none",), rate=_at(rate)
        )
        for mode, rate in (("blend", "25"), ("blend", "30"), ("dup", "30"), ("mci", "25"))
    },
    **{f"framerate {r}": Filter(passes=(f"framerate={r}",), rate=_at(r)) for r in ("25", "30")},
    "interleave": Filter(passes=("tinterlace=interleave_top",), rate=_times(0.5)),
    "merge": Filter(passes=("tinterlace=merge",), rate=_times(0.5)),
    "telecine": Filter(passes=("telecine",), rate=_times(1.25)),
    **{
        f"{speed} times faster": Filter(
            passes=(f"setpts=PTS/{speed},fps={{rate}}",), rate=_times(speed), speed=speed
        )
        for speed in (1.01, 25 / 24)
    },
    "dejudder": Filter(passes=("dejudder",), rate=_times(8)),  # each frame is shown eight times
    "deflicker": Filter(passes=("deflicker",)),
    "mean of 3": Filter(passes=("tmix=frames=3",)),
    "deshake": Filter(passes=("deshake",)),
    "vidstab": Filter(
        passes=(
            "vidstabdetect=result={folder}/shifts",
            "vidstabtransform=input={folder}/shifts:crop=black:optzoom=0",
        )
    ),
    "mpdecimate": Filter(passes=("mpdecimate",)),
}

"""Cases for estimators: a kind of light, scene or file each, at the frame rates of real cameras."""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import numpy as np

from .cases import Case
from .filters import FILTERS
from .light import COMMON

RATES = ("24000/1001", "24", "25", "30000/1001", "30", "30.01", "60000/1001", "60", "60.02")
# Second difference of a grid's means over seconds, rms, hertz: Europe's as measured, and more.
GRIDS = {"continental": 1.1e-3, "rough": 1.7e-3}


@dataclass(frozen=True, kw_only=True)
class Kind:
    """What is hidden in a case for estimators.

    Attributes
    ----------
    hidden : tuple of str
    times : float
        Its strength, as `Case` takes it.
    lamp : str
        Kind of the first lamp; empty draws one.
    filtered : str
        What its file goes through, as `Case` takes it.
    """

    hidden: tuple[str, ...] = ()
    times: float = 3.0
    lamp: str = ""
    filtered: str = ""

    @property
    def mains(self) -> bool:
        """Whether there is an ENF to find."""
        return "no_lamp" not in self.hidden

    @property
    def filmable(self) -> bool:
        """Whether it can be a file, whose frames have regular stamps."""
        return not {"stamp_jitter", "true_variable_rate"} & set(self.hidden)


KINDS: dict[str, Kind] = {
    **{lamp: Kind(lamp=lamp) for lamp in COMMON},
    "second harmonic": Kind(hidden=("second_harmonic",)),
    "second harmonic, gamma": Kind(hidden=("second_harmonic", "gamma")),
    "second harmonic, moving object": Kind(hidden=("second_harmonic", "moving_object"), times=10.0),
    "half-wave part": Kind(hidden=("half_wave_part",)),
    "several sources": Kind(hidden=("several_sources",)),
    "pwm beside": Kind(hidden=("pwm",)),
    "monitor beside": Kind(hidden=("monitor",)),
    "gamma": Kind(hidden=("gamma",), times=6.0),
    "gain steps": Kind(hidden=("gain_steps",)),
    "key dimming": Kind(hidden=("key_dimming",)),
    "moving object": Kind(hidden=("moving_object",), times=30.0),
    "stripes beside": Kind(hidden=("stripes",)),
    "vibration beside": Kind(hidden=("vibration",)),
    "frames lost": Kind(hidden=("frame_drop",), times=1.0),
    "frames inserted": Kind(hidden=("frame_duplicate",), times=1.0),
    "converted": Kind(hidden=("converted",)),
    "blended": Kind(hidden=("blended",)),
    "stamp jitter": Kind(hidden=("stamp_jitter",)),
    "variable rate": Kind(hidden=("true_variable_rate",)),
    "interlaced": Kind(hidden=("interlace",)),
    "stripes": Kind(hidden=("stripes", "no_lamp")),
    "vibration": Kind(hidden=("vibration", "no_lamp")),
    "hand tilt": Kind(hidden=("hand_tilt", "no_lamp")),
    "daylight": Kind(hidden=("clouds", "no_lamp")),
    "pwm alone": Kind(hidden=("pwm", "no_lamp")),
    "monitor alone": Kind(hidden=("monitor", "no_lamp")),
    "moving object alone": Kind(hidden=("moving_object", "no_lamp"), times=30.0),
    "gain steps alone": Kind(hidden=("gain_steps", "no_lamp")),
    "key dimming alone": Kind(hidden=("key_dimming", "no_lamp")),
    **{name: Kind(filtered=name) for name in FILTERS},
}


def trial(
    kind: str,
    seed: int,
    *,
    rate: str = "",
    nominal_hz: float = 0.0,
    grid: str = "",
    duration_s: float = 60.0,
) -> Case:
    """Draw a case of a kind, and what of its rate and grid is left open.

    A seventh of the cameras read from the bottom to the top; a quarter of the grids are rough.
    """
    rng = np.random.default_rng([seed, zlib.crc32(f"trial {kind}".encode())])
    rates, nominals = str(rng.choice(RATES)), float(rng.choice([50.0, 60.0]))
    rows, strips = int(rng.choice([240, 360, 480, 720])), int(rng.choice([1, 2, 2, 3, 4]))
    reverse, is_rough = rng.uniform(size=2) < (1 / 7, 1 / 4)
    given = KINDS[kind]
    hidden = given.hidden
    if reverse and "interlace" not in hidden:
        hidden += ("reverse_readout",)
    return Case(
        hidden=hidden,
        seed=seed,
        times=given.times,
        duration_s=duration_s,
        rows=rows,
        strips=strips,
        lamp=given.lamp,
        rate=rate or rates,
        nominal_hz=nominal_hz or nominals,
        rough_hz=GRIDS[grid or ("rough" if is_rough else "continental")],
        filtered=given.filtered,
    )

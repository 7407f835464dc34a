"""Camera, lamp, grid and effects of a case, drawn from its seed.

An exposure of length ``T`` attenuates a component at ``f`` by ``sinc(f·T)``. A model without the
exposure can only estimate the attenuated size of an effect, so that one is compared.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from rsenf.bench.discover.plan import Case
from rsenf.bench.grids import grid_for
from rsenf.model import CATALOGUE, CaptureModel, GridPath, Light, Scene, Shutter
from rsenf.model.effects import Hiding
from rsenf.model.noise import generator


def as_shown(
    name: str, values: dict[str, Any], exposure_s: float, nominal_hz: float
) -> dict[str, Any]:
    """Return an effect's parameters with its size after the exposure.

    Parameters
    ----------
    name : str
        Of the effect.
    values : dict
        Its true parameters.
    exposure_s : float
        Exposure time that the model lacks; 0 if it has it.
    nominal_hz : float
        Of the grid.

    Returns
    -------
    dict
    """
    attenuation = np.sinc(exposure_s * np.array([2.0, 4.0]) * nominal_hz)  # at f0 and 2·f0
    match name:
        case "harmonics":
            return values | {
                "second_ratio": values["second_ratio"] * abs(attenuation[1] / attenuation[0])
            }
        case "pwm_tone" | "interharmonic":
            tone_hz = values["tone_hz" if name == "pwm_tone" else "flicker_hz"]
            return values | {
                "depth_ratio": values["depth_ratio"] * abs(np.sinc(tone_hz * exposure_s))
            }
    return values


NTSC, FILM = Fraction(30000, 1001), Fraction(24)
# Frame rates and grids at which the flicker's phase changes from frame to frame.
CAMERAS = ((NTSC, 50.0), (Fraction(30), 50.0), (FILM, 50.0), (Fraction(25), 60.0))
# At 25 fps and 50 Hz the flicker hardly moves in the picture: lost or repeated frames don't show,
# nor does an attenuation by key frames.
STILL = (Fraction(25), 50.0)
BLIND_THERE = ("frame_drop", "frame_duplicate", "gop_attenuation")
LINES = (240, 360, 480)
COLUMNS = {240: 426, 360: 640, 480: 854}
KNOWN_LAMPS = ("tone", "led", "incandescent", "cfl")
LONG_S, BRIEF_S = 4e-3, 1e-3  # longest exposures; a long one removes fast components
FAST = ("pwm_tone", "harmonics")
CROPPED = (
    0.2  # share of the cases without an effect that have cropped rows, which isn't a discrepancy
)


@dataclass(frozen=True, eq=False)
class Drawn:
    """A capture, and the model that the workflow starts with.

    Attributes
    ----------
    truth : CaptureModel
    given : CaptureModel
    grid : GridPath
    grid_name : str
    hidden : dict
        Parameters of the hidden effects, by name.
    shown : dict
        The same after the exposure, if ``given`` has none.
    strips : int
    """

    truth: CaptureModel
    given: CaptureModel
    grid: GridPath
    grid_name: str
    hidden: dict[str, dict[str, Any]]
    shown: dict[str, dict[str, Any]]
    strips: int


def drawn(case: Case, grids: Path | None) -> Drawn:
    """Draw a case; half of them have a lamp that the model knows, half one without harmonics.

    Parameters
    ----------
    case : Case
    grids : Path or None
        Folder of measured grids.
    """
    rng = generator(case.seed, "discover case")
    cameras = CAMERAS if set(case.hidden) & set(BLIND_THERE) else (*CAMERAS, STILL)
    rate, nominal_hz = cameras[int(rng.integers(len(cameras)))]
    grid, grid_name = grid_for(grids, nominal_hz, case.duration_s + 4.0, rng)
    lines = int(rng.choice(LINES))
    longest_s = BRIEF_S if set(case.hidden) & set(FAST) else LONG_S
    exposure_s = float(rng.uniform(2e-4, longest_s))
    lamp = str(rng.choice(KNOWN_LAMPS)) if rng.integers(2) else "tone"
    given = CaptureModel(name="given", light=Light(lamp=lamp))
    if lamp != "tone":  # the exposure attenuates its harmonics, so the model has it as well
        given = given.with_effect("exposure", exposure_s=exposure_s)
    truth = CaptureModel(
        light=Light(lamp=lamp, flicker_ratio=float(rng.uniform(0.05, 0.2))),
        shutter=Shutter(
            frame_rate=rate,
            rows=lines,
            columns=COLUMNS[lines],
            idle_ratio=float(rng.uniform(0.1, 0.6)),
        ),
        scene=Scene(
            mean_level=float(rng.uniform(80.0, 150.0)), texture_ratio=float(rng.uniform(0.02, 0.1))
        ),
    ).with_effect("exposure", exposure_s=exposure_s)
    frames, idle_ratio = round(case.duration_s * rate), truth.shutter.idle_ratio
    hiding = Hiding(rng, case.times, frames, rate, exposure_s, idle_ratio)
    hidden = {}
    for name in case.hidden:
        if name in CATALOGUE:
            hidden[name] = CATALOGUE[name].hidden(hiding)
    if case.kind == "none" and rng.random() < CROPPED:
        truth = truth.with_effect("rows_cropped", crop_ratio=float(rng.uniform(0.05, 0.2)))
    for name, values in hidden.items():
        truth = truth.with_effect(name, **values)
    if "harmonics" in hidden and lamp != "tone":
        # The effect replaces the lamp's harmonics.
        given = dataclasses.replace(given, light=Light(lamp="tone"))
    strips = 2 if "second_lamp" in case.hidden else int(rng.choice([1, 2]))
    untold_s = exposure_s if lamp == "tone" else 0.0
    shown = {name: as_shown(name, hidden[name], untold_s, nominal_hz) for name in hidden}
    return Drawn(truth, given, grid, grid_name, hidden, shown, strips)

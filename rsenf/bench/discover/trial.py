"""A case drawn from its seed, simulated as rows or video, and compared with its truth.

Drawn are camera, lamp, grid and effects. An exposure of length ``T`` attenuates a component at
``f`` by ``sinc(f·T)``; a model without the exposure can only estimate the attenuated size of an
effect, so that one is compared. Of some cases the model that was found is simulated again; the
result must be without a discrepancy. Cases of a clock error have a reference of the grid.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from rsenf.api.recordings import read_recording
from rsenf.bench.discover import Hidden
from rsenf.bench.discover.judge import WRONG, answered, recorded
from rsenf.bench.scenes import grid_for
from rsenf.discrepancy.clock_offset import beside_json, beside_of, clip_of, discover_beside, joined
from rsenf.discrepancy.measured import Float32Array, Measured, measured_of
from rsenf.discrepancy.result import discovery_json, model_of
from rsenf.discrepancy.verdict import Discovery, discover
from rsenf.errors import InputError
from rsenf.match.series import Grid
from rsenf.messages import Header, RowBlock
from rsenf.messages.schema import FloatArray
from rsenf.model import CATALOGUE, CaptureModel, GridPath, Light, Scene, Shutter, simulate_rows
from rsenf.model.effects import Hiding
from rsenf.model.full_video import render_frames
from rsenf.model.noise import generator
from rsenf.model.video_file import Codec, write_video
from rsenf.rows.settings import RowsSettings
from rsenf.rows.stage import blocks_from_luminance
from rsenf.run.simulated import is_lossy, recoded

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
CROPPED = 0.2  # share of cases without an effect that have cropped rows, which is no discrepancy
CODECS = {"lossless": Codec(lossless=True), "x264 4 Mb/s": Codec(bitrate_bps=4_000_000)}
ROWS = RowsSettings(strips=4)  # as ``rsenf discover`` samples a video
OTHER = 10**6  # between the seeds of a case and of the simulation of its model
GIVEN_BACK = 4  # one model in so many
# A clock error shows only against an independent record of the grid: the true frequency, minutes
# longer than the clip on either side, with the noise of such records.
CLOCK, SKEW = "clock", "clock_skew"
WEAKEST_PPM = 20.0  # least error that must be named in a clip of 60 s
TIMES = (3.0, 1.0)  # multiples of it
REFERENCE_S = 300.0
NOISE_HZ = (3e-4, 1e-3)  # of a sample of the reference; log-uniform


def _as_shown(
    name: str, values: dict[str, Any], exposure_s: float, nominal_hz: float
) -> dict[str, Any]:
    """Return an effect's true parameters, its size after an exposure that the model lacks."""
    first, second = np.sinc(exposure_s * np.array([2.0, 4.0]) * nominal_hz)  # at f0 and 2·f0
    if name == "harmonics":
        return values | {"second_ratio": values["second_ratio"] * abs(second / first)}
    if name in ("pwm_tone", "interharmonic"):
        tone_hz = values["tone_hz" if name == "pwm_tone" else "flicker_hz"]
        return values | {"depth_ratio": values["depth_ratio"] * abs(np.sinc(tone_hz * exposure_s))}
    return values


@dataclass(frozen=True, eq=False)
class Drawn:
    """A capture, and the model that the workflow starts with."""

    truth: CaptureModel
    given: CaptureModel
    grid: GridPath
    grid_name: str
    hidden: dict[str, dict[str, Any]]  # parameters of the hidden effects, by name
    shown: dict[str, dict[str, Any]]  # the same after the exposure, if `given` has none
    strips: int


def _drawn(case: Hidden, grids: Path | None) -> Drawn:
    """Draw a case; half of them have a lamp that the model knows, half one without harmonics."""
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
    ranges = ((0.05, 0.2), (0.1, 0.6), (80.0, 150.0), (0.02, 0.1))
    flicker_ratio, idle_ratio, level, texture_ratio = (float(rng.uniform(*r)) for r in ranges)
    truth = CaptureModel(
        light=Light(lamp=lamp, flicker_ratio=flicker_ratio),
        shutter=Shutter(frame_rate=rate, rows=lines, columns=COLUMNS[lines], idle_ratio=idle_ratio),
        scene=Scene(mean_level=level, texture_ratio=texture_ratio),
    ).with_effect("exposure", exposure_s=exposure_s)
    frames = round(case.duration_s * rate)
    hiding = Hiding(rng, case.times, frames, rate, exposure_s, idle_ratio)
    hidden = {n: CATALOGUE[n].hidden(hiding) for n in case.hidden if n in CATALOGUE}
    if case.kind == "none" and rng.random() < CROPPED:
        truth = truth.with_effect("rows_cropped", crop_ratio=float(rng.uniform(0.05, 0.2)))
    for name, values in hidden.items():
        truth = truth.with_effect(name, **values)
    if "harmonics" in hidden and lamp != "tone":
        # The effect replaces the lamp's harmonics.
        given = dataclasses.replace(given, light=Light(lamp="tone"))
    strips = 2 if "second_lamp" in case.hidden else int(rng.choice([1, 2]))
    untold_s = exposure_s if lamp == "tone" else 0.0
    shown = {name: _as_shown(name, hidden[name], untold_s, nominal_hz) for name in hidden}
    return Drawn(truth, given, grid, grid_name, hidden, shown, strips)


def sampled(path: Path) -> tuple[Measured, Callable[[Float32Array], Float32Array] | None]:
    """Return the rows of a video, and the coding of simulated rows if the file is lossy."""
    data = measured_of(read_recording(path, rows=ROWS).blocks)
    again = (lambda level: recoded(path, level, data.axis, ROWS)) if is_lossy(path) else None
    return data, again


def given_back(found: Discovery, grid: GridPath, duration_s: float, seed: int) -> str:
    """Simulate with the model that was found, on a grid; return the verdict, or why none."""
    model = model_of(found, "a case")
    rows = simulate_rows(model, grid, duration_s, seed, strips=found.last.data.strips)
    try:
        return discover(model, measured_of(_blocks(rows.level, rows.frame_time_s))).verdict
    except InputError as refused:  # such as a grid that hardly moves in so short a time
        return f"refused: {refused.message}"


def tried(case: Hidden, grids: Path | None) -> dict[str, Any]:
    """Simulate a case, run the workflow on it, and judge the result."""
    if case.kind == CLOCK:
        return _tried_beside(case, grids)
    made, back = _drawn(case, grids), ""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "clip.mp4"
        codec = tuple(CODECS)[case.seed % len(CODECS)] if case.video else ""
        if codec:
            frames = render_frames(made.truth, made.grid, case.duration_s, case.seed)
            write_video(path, frames, CODECS[codec])
        rows = None if case.video else _rows(case, made)

        def work() -> tuple[dict[str, Any], Discovery]:
            data, again = (measured_of(rows), None) if rows else sampled(path)
            found = discover(made.given, data, recoded=again)
            return discovery_json(found, ""), found

        answer, found = answered(work)
    if found and answer["verdict"] == "explained" and case.seed % GIVEN_BACK == 0:
        back = given_back(found, made.grid, case.duration_s, case.seed + OTHER)
    sizes: dict[str, dict[str, Any]] = {}  # the parameter of each effect that is its size
    for name, values in made.shown.items():
        least = CATALOGUE[name].weakest
        sizes[name] = {least.size: values[least.size]} if least and least.size else {}
    return {
        **recorded(case, dict.fromkeys(case.hidden, ()), sizes, answer),
        **_drawn_facts(made),
        "codec": codec,
        "truth": made.hidden,
        "shown": made.shown,
        "given_back": back,
        "idle_ratio": made.truth.shutter.idle_ratio,
        "flicker_ratio": made.truth.light.flicker_ratio,
    }


def _drawn_facts(made: Drawn) -> dict[str, Any]:
    """Return camera, lamp and grid of a case for its record."""
    shutter, lamp = made.truth.shutter, made.truth.light.lamp
    return {
        "frame_rate": str(shutter.frame_rate), "nominal_hz": made.grid.nominal_hz,
        "lines": shutter.rows, "strips": made.strips, "lamp": lamp, "grid": made.grid_name,
    }  # fmt: skip


def _rows(case: Hidden, made: Drawn) -> list[RowBlock]:
    """Return the row means of a case, not encoded."""
    rows = simulate_rows(made.truth, made.grid, case.duration_s, case.seed, strips=made.strips)
    return _blocks(rows.level, rows.frame_time_s)


def _blocks(level: Any, time_s: FloatArray) -> list[RowBlock]:
    return list(blocks_from_luminance(np.asarray(level), time_s, Header()))


def clock_cases(each: int, first_seed: int, duration_s: float) -> list[Hidden]:
    """Return ``each`` cases of each strength, and as many in all without a clock error."""
    strengths = [t for t in (*TIMES, *(0.0 for _ in TIMES)) for _ in range(each)]
    return [
        Hidden(CLOCK, (SKEW,) if times else (), first_seed + n, times, duration_s)
        for n, times in enumerate(strengths)
    ]


def _tried_beside(case: Hidden, grids: Path | None) -> dict[str, Any]:
    """Run the workflow on a clock error, as ``rsenf discover --reference`` does."""
    made, grid, lag_s, true_ppm = _drawn_beside(case, grids)
    data = measured_of(_rows(case, made))

    def work() -> tuple[dict[str, Any], dict[str, Any]]:
        laid = beside_of(clip_of(data), grid)
        found = discover(made.given, data)
        beside = discover_beside(model_of(found, "a case"), laid)
        answer = joined(discovery_json(found, ""), beside_json(beside, ""))
        return answer, answer["reference"]

    answer, reference = answered(work)
    clock = next((e for e in answer["effects"] if e["name"] == SKEW), None)
    ppm = clock["parameters"]["clock_ppm"] if clock else None
    gap = reference["gap"] if reference else {}
    sizes = {name: {"clock_ppm": true_ppm} for name in case.hidden}
    record = recorded(case, dict.fromkeys(case.hidden, ()), sizes, answer)
    if ppm is not None and ppm * true_ppm < 0.0:  # the wrong sign
        record["outcome"] = WRONG
    return {
        **_drawn_facts(made),
        **record,
        "true_ppm": true_ppm,
        "ppm": ppm,
        "gap": gap,
        "closed": gap.get("shrinkage"),
        "rows_gap": answer["gap"],
        "lag_off_s": reference["lag_s"] - lag_s if reference else None,
        "reference_std_hz": reference["std_hz"] if reference else None,
    }


def _drawn_beside(case: Hidden, grids: Path | None) -> tuple[Drawn, Grid, float, float]:
    """Draw a case, its reference, the lag of the clip in it (s), and the clock error (ppm)."""
    made, rng = _drawn(case, grids), generator(case.seed, "discover clock")
    nominal_hz = made.grid.nominal_hz
    path, name = grid_for(grids, nominal_hz, REFERENCE_S, rng)
    first = int(path.start_s / path.step_s)
    freq_hz = path.freq_hz[first : first + int(REFERENCE_S / path.step_s)]
    noise_hz = 10.0 ** rng.uniform(*np.log10(NOISE_HZ))
    heard_hz = freq_hz + noise_hz * rng.standard_normal(freq_hz.size)
    lag_s = float(rng.uniform(20.0, REFERENCE_S - case.duration_s - 20.0))
    path, truth = GridPath(freq_hz, path.step_s, lag_s, nominal_hz), made.truth
    ppm = float(rng.choice([-1.0, 1.0])) * case.times * WEAKEST_PPM
    if case.hidden:
        truth = truth.with_effect(SKEW, clock_ppm=ppm)
    made = dataclasses.replace(made, truth=truth, grid=path, grid_name=name)
    return made, Grid(name, nominal_hz, 0, path.step_s, heard_hz), lag_s, ppm

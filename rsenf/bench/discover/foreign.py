"""Blind discovery on a camera that shares no code with rsenf's own model.

Such a camera is a Python package or file, loaded by its path. It has a simulation of its own,
doesn't import rsenf, and has

``Case(hidden=, seed=, times=, duration_s=, rows=)``
    A case. Grid, frame rate, lamp, scene and noise are drawn from its seed.
``film(case)``
    Simulates it: ``level`` (frames, rows, strips), ``stamp_s`` (frames,), ``truth``, a dict with
    ``frame_rate``, ``nominal_hz``, ``idle_ratio``, ``lamp`` (its kind, ``"tone"`` for a pure one)
    and ``flicker_ratio``, and ``hidden``, the parameters of each effect by name, as they
    show in the rows. :data:`SIZES` has those that are compared.
``EFFECTS``, ``UNKNOWN``
    Effects that can be hidden, by name: of rsenf's catalogue, and others. Each has ``needs``
    (``"reference"`` if it doesn't show in rows alone, ``"stamps"`` if it doesn't show in films of a
    constant frame rate) and ``like`` (names of nearly equal effects, which are also right).
``PHYSICAL`` (it may have none)
    What physical programs do that are in no catalogue, by name; their truth has what
    :func:`rsenf.bench.discover.judge.judged_description` compares.
``NEUTRAL``
    Names in ``EFFECTS`` that the fit of the plain model absorbs, without a discrepancy.
``go_together(one, other)``
    Whether both can be hidden at once.
``video_case(case)``, ``as_video(case, path)``
    For ``--video``: the case with what a file can hold, and its file.

The workflow is given levels and time stamps, and starts from a lamp without harmonics. So it may
name ``harmonics`` in any case whose lamp has them. It searches the catalogue and the grammar of
effects, as ``rsenf discover`` does.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path
from statistics import fmean
from types import ModuleType
from typing import Any

from rsenf.bench.discover import Hidden, Hideable, left_out
from rsenf.bench.discover.judge import answered, judged_description, recorded
from rsenf.bench.discover.trial import given_back, sampled
from rsenf.bench.foreign import camera_at
from rsenf.discrepancy.measured import measured_of
from rsenf.discrepancy.result import discovery_json, model_of
from rsenf.discrepancy.start import PLAIN
from rsenf.discrepancy.verdict import Discovery, discover
from rsenf.messages import Header
from rsenf.rows.stage import blocks_from_luminance

NEEDED = ("Case", "film", "EFFECTS", "UNKNOWN", "NEUTRAL", "go_together")
OF_LAMPS = "harmonics"
OTHER = 1_000_003  # seed of what a found model films
# Parameters that are compared, by the camera's names; rsenf's have no "rms".
SIZES = {
    "harmonics": ("second_ratio",), "gamma": ("exponent",), "second_lamp": ("weight",),
    "pwm_tone": ("depth_ratio", "tone_hz"), "interharmonic": ("depth_ratio", "flicker_hz"),
    "auto_exposure": ("gain_rms_ratio",), "row_banding": ("banding_rms_ratio",),
    "readout_drift": ("drift_rms_ratio",),
    **dict.fromkeys(("capture_jitter", "timestamp_jitter"), ("jitter_s",)),
    **dict.fromkeys(("frame_drop", "frame_duplicate"), ("at_frames",)),
}  # fmt: skip


def hideable(camera: ModuleType, *, video: bool = False) -> Hideable:
    """Return what a camera can hide, in rows or in films.

    Parameters
    ----------
    video : bool
        Whether it is filmed.
    """
    why = {"reference": "only a reference of the grid shows it"}
    if video:
        why["stamps"] = "a film's frames come at a constant rate"
    never = {name: reason for name, reason in left_out().items() if name in camera.EFFECTS}
    never |= dict.fromkeys(camera.NEUTRAL, "a model of the rows takes it in: nothing lacks then")
    never |= {name: why[e.needs] for name, e in camera.EFFECTS.items() if e.needs in why}
    return Hideable(
        effects=tuple(name for name in camera.EFFECTS if name not in never),
        unknown=tuple(camera.UNKNOWN),
        physical=tuple(getattr(camera, "PHYSICAL", ())),
        neutral=tuple(camera.NEUTRAL),
        never=never,
        go_together=camera.go_together,
    )


def tried(case: Hidden, path: Path) -> dict[str, Any]:
    """Simulate a case of the camera at a path, run the workflow on it, and judge the result."""
    camera = camera_at(path, NEEDED)
    drawn = ("hidden", "seed", "times", "duration_s", "rows")
    asked = camera.Case(**{name: getattr(case, name) for name in drawn})
    filmed = camera.film(camera.video_case(asked) if case.video else asked)
    truth = filmed.truth

    def work() -> tuple[dict[str, Any], Discovery]:
        if case.video:
            with tempfile.TemporaryDirectory() as folder:
                film = Path(folder) / "film.mkv"
                camera.as_video(asked, film)
                data = sampled(film)[0]
        else:
            rows = blocks_from_luminance(filmed.level, filmed.stamp_s, Header())
            data = measured_of(list(rows))
        found = discover(PLAIN, data, beyond_catalogue=True)
        return discovery_json(found, ""), found

    answer, found = answered(work)
    idle = model_of(found, "a case").shutter.idle_ratio if found else None
    every = {**camera.EFFECTS, **camera.UNKNOWN, **getattr(camera, "PHYSICAL", {})}
    like = {name: tuple(every[name].like) for name in case.hidden}
    of_lamp = () if truth["lamp"] == "tone" else (OF_LAMPS,)
    record = recorded(case, like, _sizes(filmed.hidden), answer, of_lamp)
    back = ""
    if case.kind == "physical":
        record |= judged_description(filmed.hidden[case.hidden[0]], answer, of_lamp)
        if found and answer["verdict"] == "explained":
            grid, seconds = found.last.forward.course.grid(), float(found.last.data.time_s[-1])
            back = given_back(found, grid, seconds, OTHER)
    # Each of two fields has half the frame period.
    true_idle = truth["idle_ratio"] * 2 - 1 if "interlace" in case.hidden else truth["idle_ratio"]
    return {
        **record,
        "words": [e["words"] for e in answer["effects"] if "words" in e],
        "given_back": back,
        "truth": filmed.hidden,
        **{name: truth[name] for name in ("frame_rate", "nominal_hz", "lamp", "flicker_ratio")},
        "lines": case.rows,
        "strips": filmed.level.shape[2],
        "idle_ratio": true_idle,
        "idle_error": None if idle is None else idle - true_idle,
    }


def _sizes(hidden: Mapping[str, dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """Return the true parameters that are compared, by rsenf's names and definitions."""
    return {
        name: {of.replace("_rms", ""): _size(name, of, truth) for of in SIZES.get(name, ())}
        for name, truth in hidden.items()
    }


def _size(name: str, theirs: str, truth: dict[str, Any]) -> float | set[int]:
    """Return a true size, one for all strips; or the captured frames that are lost or repeated."""
    if name == "frame_duplicate":  # `at_frames` are the copies, as they arrive
        apart = 0 if truth["form"] == "in place" else 1
        return {n - 1 - apart * k for k, n in enumerate(truth["at_frames"])}
    if name == "frame_drop":  # `at_frames` are the first ones after a loss
        many = truth["frames_lost"]
        first = [n + sum(many[:k]) for k, n in enumerate(truth["at_frames"])]
        return {n + k for n, lost in zip(first, many, strict=True) for k in range(lost)}
    size = abs(float(truth[theirs]))
    if name == "second_lamp":  # added to the first lamp's light, instead of replacing some of it
        return size / (1.0 + size)
    if theirs == "depth_ratio" and "strip_ratio" in truth:
        return size * fmean(truth["strip_ratio"])
    return size

"""For each kind of residual, the further measurements that would identify its cause."""

from __future__ import annotations

_ANOTHER = "a second reference of the same time: what is the camera's is there against both"

TELLS: dict[str, tuple[str, ...]] = {
    "other_readout": (
        "a recording of one small, fast LED: in which order and when the camera reads its lines",
        "another model to begin with (--model), with this camera's read-out",
    ),
    "single_lines": (
        "an evenly lit, still wall, out of focus: what each line does is then seen by itself",
        "the same at half the light: a fault of the lines' gain halves, one of their offset stays",
    ),
    "event": (
        "the frames and their time stamps about that time",
        "a second recording: whether it comes again, and whether at the same time after the start",
    ),
    "tone": (
        "a recording at another frame rate: its alias moves, and only one frequency fits both",
        "daylight in place of the lamp: what stays is the camera's, not the light's",
        "the camera on something heavy: what goes was shaking",
    ),
    "fast_tone": (
        "a recording at another frame rate: its alias moves, and only one frequency fits both",
        "the lamp before a photodiode: its driver's frequency is there to read",
        "each lamp and screen by itself: which of them it is",
    ),
    "level": (
        "a bright and a dark wall side by side: a tone curve follows the level everywhere alike",
        "a stop less of exposure: clipping goes, a tone curve stays",
    ),
    "waveform": (
        "a bright and a dark wall side by side: the lamp's waveform is the same on both",
        "the lamp before a photodiode: its waveform without a camera's tone curve",
    ),
    "flicker": (
        "each lamp by itself, and strips of the picture apart: a second lamp on another phase "
        "differs from place to place",
        "another exposure time: what the shutter does changes, what the lamps do stays",
    ),
    "gain": (
        "fixed exposure and white balance: what goes was the camera's",
        "a second light that doesn't flicker, on part of the wall: a gain scales both, light "
        "only its own",
    ),
    "timing": (
        "the sensor's own time stamp of each frame, or a running clock in the picture",
        "a reference of the grid: what the light did and what the camera's clock did",
    ),
    "flicker_size": (
        "the camera's own file at a higher bit rate, or uncompressed: what goes was the codec's",
        "a fixed exposure time: the flicker's size follows it",
    ),
    "frame_by_frame": (
        "the sensor's own time stamp of each frame",
        "fixed exposure, and a second light that doesn't flicker on part of the wall",
    ),
    "rows": (
        "the camera upside down: what moves with the picture is the scene's, the rest the camera's",
    ),
    "strips": (
        "each lamp by itself, and the picture in more strips: which side has what",
        "the camera turned by a quarter: what depends on the side then depends on the row",
    ),
    "clock_drift": (
        _ANOTHER,
        "a recording begun once the camera is warm: a crystal drifts with its temperature",
    ),
    "lag_step": ("the frames and their time stamps about that time", _ANOTHER),
    "wander": ("the sensor's own time stamp of each frame", _ANOTHER),
    "other_course": (
        _ANOTHER,
        "a still, evenly lit wall: what moves in the picture pulls at the light's phase",
    ),
    "unknown": ("a longer recording of a still, evenly lit wall", "another frame rate"),
}

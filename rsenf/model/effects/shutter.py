"""Effects on the shutter: when each frame begins, and when and where its lines are exposed.

Frames: error and drift of the camera's clock, jitter. Lines: exposure, crop, read-out time and
order, interlaced fields, displacement of the picture.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from rsenf.model.effects.base import FrameEffect, ReadOutEffect, Run
from rsenf.model.effects.search import GROSS, Hiding, ResidualFeatures, Weakest
from rsenf.model.grid import FloatArray
from rsenf.model.noise import wander
from rsenf.model.parameters import Fitting, ParameterError, parameter
from rsenf.model.shutter import Clip, ReadOut, Shutter

EVERY_S = 2.0  # distance of a course's nodes
COMB = 1e-5  # excess of the gap of rows two apart over that of neighbours: alternating error


@dataclass(frozen=True, kw_only=True)
class ClockSkew(FrameEffect):
    """The camera's clock is fast (> 0) or slow by a constant relative error.

    A camera second is ``1 / (1 + clock_ppm·1e-6)`` true seconds: the true periods of frames, lines
    and exposures are shorter than their nominal ones by that factor, and the ENF reads low by it.
    """

    name = "clock_skew"
    of_camera = True
    source = "crystals, 10 to 100 ppm (Kohno et al., IEEE TDSC 2, 2005); 62 to 76 ppm on a GoPro"
    confused_with = ("variable_frame_rate", "grid frequency")
    told_apart_by = "a reference of the grid's frequency, or a second clock in the recording"
    not_hidden = "it needs a reference of the grid, and has cases of its own beside one"

    clock_ppm: float = parameter(30.0, "error of the clock, fast > 0", low=-1e4, high=1e4)

    def apply(self, clip: Clip, run: Run) -> None:
        """Change the rate of the clock."""
        clip.clock_factor *= 1 + self.clock_ppm * 1e-6


@dataclass(frozen=True, kw_only=True)
class VariableFrameRate(FrameEffect):
    """The frame period wanders slowly and at random; the time per line doesn't change.

    Period ``n`` is ``(1 + r_n)/F_r`` with an Ornstein-Uhlenbeck process ``r``, and the alias moves
    by ``f_0`` times the relative change. Correct time stamps show all of it; if they are regular
    instead, the ENF seems to move as the frame rate did.
    """

    name = "variable_frame_rate"
    source = "ISO/IEC 14496-12 (a time per frame): dim light, oscillators that warm up; to 1e-4"
    confused_with = ("clock_skew", "grid frequency")
    told_apart_by = "the stamps, or a reference of the grid's frequency"
    weakest = Weakest(1e-5)  # no size: its realised strength varies in a short clip

    rate_ratio: float = parameter(1e-5, "rms of the relative change", low=0, high=0.2)
    time_constant_s: float = parameter(10.0, "over which it forgets", low=0, high=3600)
    late_s: tuple[float, ...] = parameter(
        (), "frames begin exactly so late instead, one value each", low=-60, high=60
    )
    stamped: bool = parameter(True, "the stamps say so; else they run on evenly")

    def apply(self, clip: Clip, run: Run) -> None:
        """Sum the frame periods."""
        late_s = run.given(self.late_s) if self.late_s else self._late_s(run)
        clip.start_s = clip.start_s + late_s
        if self.stamped:
            clip.stamp_offset_s += late_s

    def _late_s(self, run: Run) -> FloatArray:
        change = wander(run.rng(), run.frames, run.step_s, self.time_constant_s)
        periods = np.maximum(self.rate_ratio * change, -0.9) * run.step_s
        return np.concatenate(([0.0], np.cumsum(periods)[:-1]))

    @classmethod
    def hidden(cls, hiding: Hiding) -> dict[str, Any]:
        """Set the relative change."""
        return {"rate_ratio": hiding.times * cls.weakest.change}


@dataclass(frozen=True, kw_only=True)
class CaptureJitter(FrameEffect):
    """Each frame begins early or late at random, unknown to its time stamp.

    All rows of a frame shift together, by ``ε_n``: the phase of harmonic ``k`` has white jitter
    from frame to frame, ``2π·k·f_0·ε_n``.
    """

    name = "capture_jitter"
    source = "software triggers, 1 to 500 µs (Balakrishnan, jitter in sampling, IRE IT 8, 1962)"
    confused_with = ("timestamp_jitter", "image_wobble")
    told_apart_by = (
        "stamps that jitter along, and the texture of the scene: it stands still here, and moves "
        "with an image that wobbles"
    )
    weakest = Weakest(20e-6, "jitter_s")

    jitter_s: float = parameter(1e-4, "rms", low=0, high=5e-3)
    late_s: tuple[float, ...] = parameter(
        (), "exactly so late instead, one value a frame", low=-0.1, high=0.1,
        fitting=Fitting(0.0, 2e-5, each="frame", rms="jitter_s"),
    )  # fmt: skip

    def apply(self, clip: Clip, run: Run) -> None:
        """Shift the starts, by white noise or as given."""
        late_s = self.jitter_s * run.rng().standard_normal(run.frames)
        clip.start_s = clip.start_s + (run.given(self.late_s) if self.late_s else late_s)


@dataclass(frozen=True, kw_only=True)
class Exposure(ReadOutEffect):
    """Each line integrates light over a time, not in an instant.

    Harmonic ``k`` is multiplied by ``sinc(k·f_0·T_e)`` and delayed by half an exposure. An exposure
    of 1/200 s removes the second harmonic of 100 Hz light, 1/100 s removes everything.
    """

    name = "exposure"
    source = "the mean of a tone over an interval (Bracewell, The Fourier Transform, 1965)"
    confused_with = ("flicker_ratio", "harmonics")
    told_apart_by = (
        "alone it only lowers the signal, which is a parameter of the light; the ratio of two "
        "harmonics of a known lamp tells it"
    )
    not_hidden = "alone it only lowers the signal, which is fitted anyway"

    exposure_s: float = parameter(0.002, "exposure of a line, camera's clock", low=0, high=1)

    def check(self, shutter: Shutter) -> None:
        """Refuse an exposure longer than the frame period."""
        if self.exposure_s > 1 / shutter.frame_rate:
            raise ParameterError(
                ("exposure_s",),
                f"is {self.exposure_s:g}, longer than a frame",
                f"at most {float(1 / shutter.frame_rate):.4g} at {shutter.frame_rate} fps",
            )

    def apply(self, read_out: ReadOut, run: Run) -> None:
        """Set the exposure."""
        read_out.exposure_s = self.exposure_s


@dataclass(frozen=True, kw_only=True)
class RowsCropped(ReadOutEffect):
    """Lines at the top and bottom are read and discarded; the picture is the rest.

    The read-out time of the picture is ``(1 − crop_ratio)·T_ro``, and the light's phase at its
    first line is later by half of the rest: exactly as in a capture with a longer idle period.
    """

    name = "rows_cropped"
    of_camera = True
    source = "paper, Eq. 7 with fewer rows L: image stabilisation, zoom, 16:9 from a 4:3 sensor"
    confused_with = ("idle_ratio",)
    told_apart_by = "nothing in the data: it is a change of the idle ratio"
    not_hidden = "it is a change of the idle ratio, which is fitted anyway"

    crop_ratio: float = parameter(0.1, "share of the lines thrown away", low=0, high=0.9)

    def apply(self, read_out: ReadOut, run: Run) -> None:
        """Shorten the read-out, and begin it later."""
        skipped_s = self.crop_ratio / 2 * read_out.read_out_s
        read_out.line_s = skipped_s + (1 - self.crop_ratio) * read_out.line_s
        read_out.read_out_s *= 1 - self.crop_ratio


@dataclass(frozen=True, kw_only=True)
class ReadoutDrift(ReadOutEffect):
    """The read-out time changes during the clip, the frame rate doesn't.

    It drifts linearly, or takes any slow course. The flicker's ramp down the frame becomes steeper
    or flatter: the phase from the first line to the last changes by ``2π·f_0·T_ro`` times the
    relative change.
    """

    name = "readout_drift"
    source = "paper, Eq. 23: line clocks that follow the temperature, modes; to 1 % a minute"
    confused_with = ("image_wobble", "rows_cropped")
    told_apart_by = "it is nought at the middle line and grows towards both ends of the frame"
    weakest = Weakest(0.002, "drift_per_min")

    drift_per_min: float = parameter(
        0.002, "relative change of the read-out time in a minute", low=-0.2, high=0.2,
        fitting=Fitting(0.0, 0.002),
    )  # fmt: skip
    drift_ratio: float = parameter(
        0.0, "rms of the relative changes, where they aren't even", low=0, high=0.2
    )
    stretch_ratios: tuple[float, ...] = parameter(
        (), "exactly these relative changes instead, one a frame", low=-0.2, high=0.2,
        fitting=Fitting(0.0, 0.002, each="frame", free=True, every_s=EVERY_S, rms="drift_ratio"),
    )  # fmt: skip
    course: str = parameter("even", "over time: even, or any", choices=("even", "any"))

    @property
    def not_fitted(self) -> tuple[str, ...]:
        """Parameter that the kind of course doesn't use."""
        return ("stretch_ratios",) if self.course == "even" else ("drift_per_min",)

    def apply(self, read_out: ReadOut, run: Run) -> None:
        """Stretch the lines' times, about the first line (drift) or the middle one (course)."""
        if self.stretch_ratios or self.course == "any":
            change = run.wandering(self.stretch_ratios, self.drift_ratio, EVERY_S)
            change = change[read_out.number][:, None]
            middle_s = read_out.line_s.mean(axis=1, keepdims=True)
            read_out.line_s = read_out.line_s + change * (read_out.line_s - middle_s)
            return
        stretch = 1 + self.drift_per_min / 60 * run.step_s * read_out.number
        read_out.line_s = read_out.line_s * stretch[:, None]

    @classmethod
    def guesses(cls, features: ResidualFeatures) -> list[dict[str, Any]]:
        """A linear drift, and any course."""
        return [{}, {"course": "any", "drift_per_min": 0.0}]

    @classmethod
    def hidden(cls, hiding: Hiding) -> dict[str, Any]:
        """Draw the sign, too."""
        return {name: hiding.sign() * value for name, value in super().hidden(hiding).items()}


@dataclass(frozen=True, kw_only=True)
class ReverseReadout(ReadOutEffect):
    """The shutter rolls from bottom to top, as in a camera mounted upside down.

    Line ``l`` is exposed when line ``L − 1 − l`` was: the phase ramp of every harmonic down the
    frame changes its sign.
    """

    name = "reverse_readout"
    of_camera = True
    source = "paper, Eq. 23 with ω_b < 0: cameras upside down, some front cameras; vflip"
    confused_with = ("grid frequency",)
    told_apart_by = (
        "where the alias is at 0 Hz (25 fps at 50 Hz) direction and the sign of the ENF's "
        "deviation can't be told apart without a reference"
    )
    weakest = Weakest()

    def apply(self, read_out: ReadOut, run: Run) -> None:
        """Reverse the order of the lines."""
        read_out.line_s = read_out.line_s[:, ::-1]

    @classmethod
    def guesses(cls, features: ResidualFeatures) -> list[dict[str, Any]]:
        """The effect itself, if hardly anything fits."""
        return [{}] if abs(features.gap) > GROSS else []


@dataclass(frozen=True, kw_only=True)
class Interlace(ReadOutEffect):
    """Even and odd lines come from two fields, half a frame period apart.

    Each field is read like a frame of half the lines, with the same time per line; the second one
    may begin slightly later or earlier than half a period after the first. Neighbouring lines then
    differ in phase by about ``π·f_0/F_r``, with alternating sign: a comb at the finest pattern that
    lines can show.
    """

    name = "interlace"
    of_camera = True
    source = "ITU-R BT.601 (PAL, NTSC) and BT.709 (1080i) cameras; FFmpeg's interlace filter"
    confused_with = ("row_banding", "readout_drift")
    told_apart_by = "lines taken apart by parity; the comb turns with the flicker"
    masks = ("readout_drift",)  # resembles a small error of the fields' times
    weakest = Weakest()
    never_with = ("reverse_readout",)

    bottom_first: bool = parameter(False, "odd lines come first")
    second_late_s: float = parameter(
        0.0, "how much later than half a frame period the second field is", low=-1e-3, high=1e-3,
        fitting=Fitting(None, 1e-5),
    )  # fmt: skip

    def apply(self, read_out: ReadOut, run: Run) -> None:
        """Read the lines of one field, then those of the other."""
        line = np.arange(run.shutter.lines)
        second_field = line % 2 == (0 if self.bottom_first else 1)
        later_s = run.step_s / 2 + self.second_late_s
        read_out.line_s = read_out.line_s[:, line // 2] + second_field * later_s

    @classmethod
    def guesses(cls, features: ResidualFeatures) -> list[dict[str, Any]]:
        """Either field first, if hardly anything fits or rows have an alternating error."""
        seen = features.gap > GROSS or features.comb - features.gap > COMB
        return [{"bottom_first": b} for b in (False, True)] if seen else []

    @classmethod
    def hidden(cls, hiding: Hiding) -> dict[str, Any]:
        """Draw which field comes first."""
        return {"bottom_first": bool(hiding.rng.integers(2))}


@dataclass(frozen=True, kw_only=True)
class ImageWobble(ReadOutEffect):
    """The window that is cropped from the sensor moves up and down.

    A line of the picture then comes from a line of the sensor that was read earlier or later, so
    the flicker's phase shifts by ``2π·f_0·rows·T_ro/L``. Movement that the stabilisation doesn't
    compensate moves the texture, too.
    """

    name = "image_wobble"
    source = "image stabilisation, 0.1 to 20 rows (Ringaby and Forssén, IJCV 96, 2012)"
    confused_with = ("capture_jitter", "timestamp_jitter")
    told_apart_by = "the texture moves along; with perfect stabilisation nothing tells"
    not_hidden = "in the means of rows it is capture jitter, but for the texture"

    wobble_rows: float = parameter(1.0, "rms of the shift", low=0, high=30)
    time_constant_s: float = parameter(0.02, "of the movement; 0 is white", low=0, high=60)
    rows_down: tuple[float, ...] = parameter(
        (), "exactly these shifts instead, one a frame", low=-100, high=100,
        fitting=Fitting(
            0.0, 0.05, each="frame", wanders=True, rms="wobble_rows", memory="time_constant_s"
        ),
    )  # fmt: skip
    residual_ratio: float = parameter(
        1.0, "share of the shift that the picture shows", low=0, high=1
    )

    def apply(self, read_out: ReadOut, run: Run) -> None:
        """Shift the time of each line, and displace the scene."""
        rows = run.wandering(self.rows_down, self.wobble_rows, self.time_constant_s)
        rows = rows[read_out.number]
        read_out.line_s = read_out.line_s + rows[:, None] * (
            read_out.read_out_s / run.shutter.lines
        )
        read_out.shift_px = read_out.shift_px - self.residual_ratio * rows[:, None]

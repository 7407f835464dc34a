"""Grammar of effects: where in the chain, how over time, on which rows; and each term in words.

A term that no catalogue has becomes the text of an effect file
(:mod:`rsenf.discrepancy.effect_file`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from rsenf.model import Effect

WHOLE_FRAMES = 0.02  # tolerance of a period in frames that is called a whole number


@dataclass(frozen=True)
class Action:
    """Where a term acts, and how."""

    base: str  # class of :mod:`rsenf.model.effects`
    words: str
    does: str  # statement with ``change``
    t_s: str = "light.start_s[:, :1]"  # expression for the time of each frame, or of each line
    argument: tuple[str, str, str] = ("light", "rsenf.model.line_light", "LineLight")
    size: str = "depth_ratio"
    step: float = 1e-3
    most: float = 2.0
    by_line: bool = False  # whether that time is each line's


LINE = "light.start_s + light.aperture.middle_s"
_SWING = "light.scale_flicker(1 + change)"
PLACES: dict[str, Action] = {
    "gain": Action("SensorEffect", "gain of the sensor", "light.scale(1 + change)"),
    "light": Action(
        "LightEffect", "all light, multiplied", "light.scale(1 + change)", LINE, by_line=True
    ),
    "added_light": Action(
        "LightEffect", "light that is added", "light.level = light.level + change", LINE,
        by_line=True,
    ),
    "flicker": Action("LightEffect", "the lamp's flicker, multiplied", _SWING, LINE, by_line=True),
    "coding": Action("CodecEffect", "flicker of whole frames, multiplied as by coding", _SWING),
    "frame_time": Action(
        "FrameEffect", "start of the frames, shifted in time",
        "clip.start_s = clip.start_s + change", "clip.start_s",
        ("clip", "rsenf.model.shutter", "Clip"), "delay_s", 1e-6, 0.02,
    ),
    "picture": Action(
        "ReadOutEffect", "the picture's place, over its height",
        "read_out.shift_px = read_out.shift_px + change * read_out.line_s.shape[1]",
        "read_out.start_s[:, None] + read_out.line_s",
        ("read_out", "rsenf.model.shutter", "ReadOut"), "shift_ratio", 1e-4, 0.1,
        by_line=True,
    ),
    "read_out": Action(
        "ReadOutEffect", "duration of the read-out, multiplied",
        "read_out.line_s = read_out.line_s * (1 + change)", "read_out.start_s[:, None]",
        ("read_out", "rsenf.model.shutter", "ReadOut"),
    ),
}  # fmt: skip


@dataclass(frozen=True)
class Term:
    """One term: a place, a course over time, and the rows it is on."""

    place: str  # of :data:`PLACES`
    course: str  # ``tone``, ``step``, ``drift``, ``settling``, ``events`` or ``passing``
    rows: str = "all"  # ``all``, ``ramp``, ``band`` or ``own``
    number: int = 1  # among the terms of this kind in a model

    @property
    def name(self) -> str:
        """Name of its effect."""
        parts = [self.place, self.course, *([self.rows] if self.rows != "all" else [])]
        return "_".join([*parts, *([str(self.number)] if self.number > 1 else [])])

    @property
    def class_name(self) -> str:
        """Name of its effect's class."""
        return self.name.title().replace("_", "")

    def widens(self, other: Term) -> bool:
        """Whether it is another with more freedom over the rows."""
        same = (self.place, self.course) == (other.place, other.course)
        return same and other.rows == "all" and self.rows != "all"


def term_of(effect: Effect) -> Term | None:
    """Return the term that an effect was made from; None for an effect of the catalogue."""
    return getattr(effect, "term", None)


def words_of(effect: Effect, frame_rate_hz: float) -> str:
    """Describe a fitted term: place, rows, course and size.

    Examples
    --------
    >>> from rsenf.discrepancy.effect_file import effect_of
    >>> drawn = {"tone_hz": 3.7, "depth_ratios": (0.0042,), "phases_rad": (0.0,)}
    >>> words_of(effect_of(Term("gain", "tone"), **drawn), 29.97)
    'gain of the sensor, the same for all rows, periodic at 3.7000 Hz, depth 0.42 %'
    """
    term = term_of(effect)
    assert term is not None
    held: Any = effect
    rows, course = "the same for all rows", ""
    if term.rows == "ramp":
        rows = f"from {1 - held.tilt:.2g} times at the top to {1 + held.tilt:.2g} times"
    elif term.rows == "band":
        rows = f"in the part {held.top_ratio:.2f} to {held.bottom_ratio:.2f} of the height"
    elif term.rows == "own":
        rows = "each row by its own share"
    if term.course == "tone":
        course = _periodic_words(held, term, frame_rate_hz)
    elif term.course == "step":
        course = f"a step at {held.at_s:.2f} s"
    elif term.course == "drift":
        course = "a steady drift, per minute"
    elif term.course == "settling":
        course = f"settling over {held.time_constant_s:.3g} s"
    elif term.course == "events":
        times = ", ".join(f"{at_s:.2f}" for at_s in held.at_s)
        change = "brighter" if held.depth_ratio * sum(held.shares) > 0 else "darker"
        course = f"{change} for {1e3 * (held.lasts_s + held.time_constant_s):.0f} ms at {times} s"
    else:
        rows = f"a band {held.width_ratio:.2g} of the height wide"
        course = f"drifting by {held.speed_per_s:.3g} heights a second"
    size, place = size_of(effect), PLACES[term.place]
    percent = f"{100.0 * size:.2g} %" if size < 1.0 else f"{100.0 * size:.0f} %"
    of = f"{1e6 * size:.3g} µs" if place.size == "delay_s" else percent
    return f"{place.words}, {rows}, {course}, depth {of}"


def _periodic_words(held: Any, term: Term, frame_rate_hz: float) -> str:
    every = frame_rate_hz / held.tone_hz
    whole = not PLACES[term.place].by_line and abs(every - max(round(every), 2)) < WHOLE_FRAMES
    over = len(getattr(held, sizes_name(term), ())) - 1
    text = f"every {round(every)} frames" if whole else f"periodic at {held.tone_hz:.4f} Hz"
    text += f" with {over} overtone{'s' * (over > 1)}" if over > 0 else ""
    if term.place == "added_light" and term.rows in ("band", "own"):
        text += " (or whole frame rates from it, if this is a screen whose lines are lit in turn)"
    return text


def size_of(effect: Effect) -> float:
    """Size of a term: amplitude of its first line, size of its step, rms of the rows' shares."""
    term = term_of(effect)
    assert term is not None
    if term.rows == "own":
        shares = getattr(effect, "row_ratios")  # noqa: B009
        return math.sqrt(sum(v * v for v in shares) / max(len(shares), 1))
    value = getattr(effect, sizes_name(term) if term.course == "tone" else PLACES[term.place].size)
    return abs(float(value if not isinstance(value, tuple) else (value or (0.0,))[0]))


def sizes_name(term: Term) -> str:
    """Return the name of the parameter that has the amplitudes of a tone's harmonics."""
    names = {"depth_ratio": "depth_ratios", "delay_s": "delays_s", "shift_ratio": "shift_ratios"}
    return names[PLACES[term.place].size]

"""Effect files of the grammar's terms, and the effects that they define.

The class that is fitted is the one which a term's file defines, so that what was judged is what is
written.
"""

from __future__ import annotations

import dataclasses
import re
import sys
from collections.abc import Mapping, Sequence
from functools import lru_cache
from types import ModuleType
from typing import Any

from rsenf.discrepancy.fit_parameters import any_course
from rsenf.discrepancy.grammar import LINE, PLACES, Term, sizes_name, term_of, words_of
from rsenf.model import CATALOGUE, Effect

MOST_OVERTONES = 12
SOFT = 0.02  # width of a band's edges, over the picture's height


def effect_of(term: Term, **values: Any) -> Effect:
    """Return a term's effect with given parameters."""
    return _class_of(term)(**values)


@lru_cache(maxsize=256)
def _class_of(term: Term) -> type[Effect]:
    module = ModuleType(f"rsenf_term_{term.name}")
    sys.modules[module.__name__] = module  # dataclasses look up their module
    text = _source(term, {}, {}, "a term", "this recording", _look_alikes(term))
    exec(compile(text, term.name, "exec"), vars(module))
    made: type[Effect] = vars(module)[term.class_name]
    made.term = term  # type: ignore[attr-defined] # not part of the file
    return made


def file_of(effect: Effect) -> str:
    """Return the file name of a term's effect."""
    return f"effect_{effect.name}.py"


def source_of(
    effect: Effect,
    errors: Mapping[str, Any],
    made_from: str,
    equivalents: Sequence[str],
    frame_rate_hz: float,
) -> str:
    """Return the effect file of a fitted term, to be reviewed, renamed and used.

    Parameters
    ----------
    effect : Effect
        Fitted.
    errors : mapping
        Standard errors by parameter.
    made_from : str
        Name of the recording.
    equivalents : sequence of str
        Names of the effects that do as well.
    frame_rate_hz : float
    """
    term = term_of(effect)
    assert term is not None
    values = {f.name: getattr(effect, f.name) for f in dataclasses.fields(effect)}
    plain = re.sub(r"[^\w.\- ]", "_", made_from)  # it becomes part of a program
    return _source(
        term, values, errors, words_of(effect, frame_rate_hz), f"recording {plain}", equivalents
    )


def _source(
    term: Term,
    values: Mapping[str, Any],
    errors: Mapping[str, Any],
    words: str,
    made_from: str,
    equivalents: Sequence[str],
) -> str:
    """Write an effect file; without values, its parameters have neutral defaults."""
    place = PLACES[term.place]
    argument, module, kind_of = place.argument
    lines = [
        f"    {name}: {kind} = parameter(\n        {values.get(name, default)!r}, "
        f"{doc + _error(errors.get(name))!r}, {how}\n    )"
        for name, kind, default, doc, how in _parameters(term)
    ]
    others = tuple(name for name in equivalents if name != term.name)
    body = "\n".join(f"        {line}" for line in _body(term))
    return f'''"""{words[:1].upper() + words[1:]}.

Written by 'rsenf discover' from {made_from}; nobody has reviewed it. Check it, give it a name of
its own, and use it: rsenf simulate --effects FILE.py --effect {term.name} --out clip.npz
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from {module} import {kind_of}
from rsenf.model.effects import {place.base}, Run
from rsenf.model.parameters import Fitting, parameter


@dataclass(frozen=True, kw_only=True)
class {term.class_name}({place.base}):
    """{words[:1].upper() + words[1:]}."""

    name = "{term.name}"
    source = "{made_from}"
    confused_with = {others!r}
    told_apart_by = "{_TOLD_APART[term.course]}"
    not_hidden = "found in one recording; nobody has said how weak it may be"

{chr(10).join(lines)}

    def apply(self, {argument}: {kind_of}, run: Run) -> None:
        """Act on it."""
{body}
'''


def _error(error: Any) -> str:
    if error is None:
        return ""
    return " ± " + ", ".join(f"{e:.2g}" for e in (error if isinstance(error, list) else [error]))


_TOLD_APART = {
    "tone": "a recording at another frame rate and exposure: what stays is the camera's",
    "step": "a second recording: whether it comes again, and when",
    "drift": "a longer recording: whether it goes on",
    "settling": "a second recording, begun once the camera is warm",
    "events": "a second camera: what it sees too, is the light's",
    "passing": "the camera upside down: what moves with the picture is the scene's",
}


def _look_alikes(term: Term) -> tuple[str, ...]:
    """Names of terms of the same course, and of effects of any course, at whatever place."""
    rows = ("all", "ramp", "band", "own")
    every = (Term(place, term.course, over, term.number) for place in PLACES for over in rows)
    known = (name for name, kind in CATALOGUE.usable().items() if any_course(kind))
    return (*(other.name for other in every), *known)


def _parameters(term: Term) -> list[tuple[str, str, Any, str, str]]:
    """Name, type, default, description and further arguments of each parameter."""
    place = PLACES[term.place]
    out: list[tuple[str, str, Any, str, str]] = []
    unit = "seconds" if place.size == "delay_s" else "relative"
    many = "tuple[float, ...]"
    step = 0.05 if term.course == "events" else place.step  # a short event may be large
    size = f"low={-place.most}, high={place.most}, fitting=Fitting(0.0, {step})"
    if term.course == "tone":
        fitted = "" if term.rows == "own" else ", fitting=Fitting(None, 1e-4)"
        out.append(("tone_hz", "float", 1.0, "frequency, Hz", f"low=1e-3, high=50_000{fitted}"))
    if term.course == "tone" and term.rows != "own":
        turned = (
            f"low=0, high={place.most}, fitting=Fitting("
            f'0.0, {place.step}, turn="phases_rad", most={MOST_OVERTONES})'
        )
        out += [
            (sizes_name(term), many, (0.0,), f"amplitude of each harmonic, {unit}", turned),
            ("phases_rad", many, (0.0,), "its phase at time zero", "low=-7, high=7"),
        ]
    if term.course == "tone" and term.rows == "own":
        out.append(("phase_rad", "float", 0.0, "phase at time zero", "low=-7, high=7"))
        out.append((
            "row_ratios", many, (), "gain of each row where the tone is 1",
            'low=-2, high=2, fitting=Fitting(0.0, 1e-3, each="line", free=True)',
        ))  # fmt: skip
    if term.course == "events":
        out += [
            ("at_s", many, (0.0,), "when each begins, s", "low=-10, high=1e5"),
            ("shares", many, (1.0,), "size of each over the largest", "low=-1, high=1"),
            ("lasts_s", "float", 0.02, "how long each lasts, s",
             "low=1e-3, high=1e3, fitting=Fitting(None, 5e-4)"),
            ("time_constant_s", "float", 0.02, "of their rise and fall, s",
             "low=1e-3, high=1e3, fitting=Fitting(None, 5e-4)"),
        ]  # fmt: skip
    if term.course != "tone":
        out.append((place.size, "float", 0.0, f"size, {unit}", size))
    if term.course == "step":
        out.append(("at_s", "float", 0.0, "time of the step, s", "low=0, high=1e5"))
    if term.course == "settling":
        out.append((
            "time_constant_s", "float", 10.0, "over which it settles, s",
            "low=0.05, high=1e4, fitting=Fitting(None, 0.05)",
        ))  # fmt: skip
    if term.course == "passing":
        out += [
            ("centre_ratio", "float", 0.5, "middle of the band at time zero, over the height",
             "low=-10, high=10, fitting=Fitting(None, 0.005)"),
            ("speed_per_s", "float", 0.0, "heights that it drifts a second",
             "low=-5, high=5, fitting=Fitting(None, 2e-4)"),
            ("width_ratio", "float", 0.1, "standard deviation of its profile, over the height",
             "low=0.01, high=0.6, fitting=Fitting(None, 0.005)"),
        ]  # fmt: skip
    if term.rows == "ramp":
        out.append((
            "tilt", "float", 1.0, "share by which it grows from the middle to the bottom",
            "low=-20, high=20, fitting=Fitting(None, 0.02)",
        ))  # fmt: skip
    if term.rows == "band":
        for name, default, words in (("top_ratio", 0.0, "first"), ("bottom_ratio", 1.0, "last")):
            how = "low=-0.1, high=1.1, fitting=Fitting(None, 0.005)"
            out.append((name, "float", default, f"{words} row, over the height", how))
    return out


def _body(term: Term) -> list[str]:
    """Statements of ``apply``."""
    place = PLACES[term.place]
    out = [f"t_s = {place.t_s}"]
    if term.rows != "all" or term.course == "passing":
        out.append("y = (np.arange(light.level.shape[1]) + 0.5) / light.level.shape[1]")
    if term.course == "tone" and term.rows == "own":
        out += [
            "rows = np.arange(max(len(self.row_ratios), 1)) + 0.5",
            "shares = np.interp(y, rows / rows.size, self.row_ratios or (0.0,))",
            "change = shares * np.cos(2 * np.pi * self.tone_hz * t_s + self.phase_rad)",
        ]
    elif term.course == "tone":
        wave = (
            "light.tone(k * self.tone_hz, phase)"
            if place.t_s == LINE
            else "np.cos(2 * np.pi * k * self.tone_hz * t_s + phase)"
        )
        out += [
            "change = 0.0 * t_s",
            f"for k, (size, phase) in enumerate(zip(self.{sizes_name(term)}, self.phases_rad), 1):",
            *(
                []
                if place.by_line
                else [
                    "    if 2 * k * self.tone_hz * run.step_s > 1.01:  # frames don't show it",
                    "        break",
                ]
            ),
            f"    change = change + size * {wave}",
        ]
    elif term.course == "events":
        out += [
            "change, lasts = 0.0 * t_s, self.lasts_s / self.time_constant_s",
            "for share, at_s in zip(self.shares, self.at_s):",
            "    since = (t_s - at_s) / self.time_constant_s",
            "    rise = 1 - np.exp(-np.clip(since, 0, lasts))",
            "    change = change + share * rise * np.exp(-np.clip(since - lasts, 0, 700))",
            f"change = self.{place.size} * change / (1 - np.exp(-lasts))  # at its peak",
        ]
    else:
        shape = {
            "step": "(t_s >= self.at_s)",
            "drift": "t_s / 60",
            "settling": "np.exp(-t_s / self.time_constant_s)",
            "passing": (
                "np.exp(-(((y - self.centre_ratio - self.speed_per_s * t_s) / self.width_ratio)"
                " ** 2) / 2)"
            ),
        }[term.course]
        out.append(f"change = self.{place.size} * {shape}")
    if term.rows == "ramp":
        out.append("change = change * (1 + self.tilt * (2 * y - 1))")
    if term.rows == "band":
        out += [
            f"inside = np.clip((y - self.top_ratio) / {SOFT} + 0.5, 0, 1)",
            f"change = change * inside * np.clip((self.bottom_ratio - y) / {SOFT} + 0.5, 0, 1)",
        ]
    return [*out, place.does]

"""Declared parameters with ranges, their validation, and conversion to and from dictionaries.

A part of the model is a frozen dataclass whose fields are made by :func:`parameter`. Frame rates
are exact fractions: 29.97 is 30000/1001.
"""

from __future__ import annotations

import dataclasses
import math
import types
import typing
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, TypeVar

from rsenf.errors import UsageError, did_you_mean

P = TypeVar("P")
KeyPath = tuple[str | int, ...]
# Broadcast rates as they are rounded.
_NTSC = {
    "23.976": Fraction(24000, 1001),
    "23.98": Fraction(24000, 1001),
    "29.97": Fraction(30000, 1001),
    "59.94": Fraction(60000, 1001),
    "119.88": Fraction(120000, 1001),
}


class ParameterError(UsageError):
    """An invalid parameter; ``path`` is its place in the model."""

    def __init__(self, path: KeyPath, problem: str, hint: str = "") -> None:
        super().__init__(f"model: {'.'.join(map(str, path)) or 'the top level'} {problem}", hint)
        self.path, self.problem = path, problem

    def below(self, path: KeyPath) -> ParameterError:
        """Return the error with the path of the enclosing part prepended."""
        return ParameterError((*path, *self.path), self.problem, self.hint)


@dataclass(frozen=True)
class Fitting:
    """How a parameter is estimated from data."""

    # value at which the effect does nothing, where a search begins. None for a parameter that has
    # no influence while the others are neutral, such as the frequency of a tone
    neutral: float | None
    step: float  # change within which the response is linear
    # parameter of the same part that is this one's phase: both are fitted as one complex amplitude,
    # which has no singularity at zero. Empty for none
    turn: str = ""
    # ``frame`` or ``line`` for a tuple with one value for each, which is random while empty; empty
    # for a single value
    each: str = ""
    wanders: bool = False  # for a series: whether it is autoregressive; else it is white
    # for a series: whether it may take any course, and is identified by its effect on lines and
    # strips
    free: bool = False
    # for a series of frames: distance of the nodes between which it is linear; 0 for independent
    # values
    every_s: float = 0.0
    most: int = 0  # for a list of amplitudes: largest number of members
    # for a series: parameters of the same part that are its rms and its correlation time; empty for
    # none
    rms: str = ""
    memory: str = ""


def parameter(
    default: Any,
    doc: str,
    *,
    low: float = -math.inf,
    high: float = math.inf,
    choices: tuple[str, ...] = (),
    fitting: Fitting | None = None,
) -> Any:
    """Declare a parameter of a part of the model; its name includes the unit.

    Parameters
    ----------
    default : object
        Default value.
    doc : str
        Description.
    low, high : float, optional
        Valid range, inclusive; for a tuple, of each element.
    choices : tuple of str, optional
        Valid strings.
    fitting : Fitting, optional
        How it is estimated from data; without, it is never fitted.
    """
    return dataclasses.field(
        default=default,
        metadata={"doc": doc, "low": low, "high": high, "choices": choices, "fitting": fitting},
    )


def fittings(part: Any) -> dict[str, Fitting]:
    """Return the parameters of a part that can be fitted, and how.

    Parameters that the part lists in ``not_fitted`` are left out.
    """
    excluded = () if isinstance(part, type) else getattr(part, "not_fitted", ())
    declared = {f.name: f.metadata.get("fitting") for f in dataclasses.fields(part)}
    return {name: f for name, f in declared.items() if f is not None and name not in excluded}


def validate(part: Any, path: KeyPath = ()) -> None:
    """Check every parameter of a part, and of the parts in it.

    Parameters
    ----------
    part : dataclass
    path : tuple, optional
        Place of the part in the model, for the error.

    Raises
    ------
    ParameterError
        Naming the first parameter that is out of its range.
    """
    for f in dataclasses.fields(part):
        value, at = getattr(part, f.name), (*path, f.name)
        if dataclasses.is_dataclass(value):
            validate(value, at)
        elif f.metadata and value is not None:
            for element in value if isinstance(value, tuple) else (value,):
                _check(element, f.metadata, at)


def to_dict(part: Any) -> dict[str, Any]:
    """Return a part as plain numbers, strings, lists and dictionaries."""
    return {f.name: _plain(getattr(part, f.name)) for f in dataclasses.fields(part)}


def from_dict(cls: type[P], data: Any, path: KeyPath = ()) -> P:
    """Build a part from a dictionary; missing values keep their default.

    Parameters
    ----------
    cls : type
        The part's class.
    data : dict
    path : tuple, optional
        Place of the part in the model, for the error.

    Raises
    ------
    ParameterError
        For an unknown key (with the nearest known one), a value of the wrong type, or one out of
        range.
    """
    if not isinstance(data, dict):
        raise ParameterError(path, f"is {data!r}, not a mapping")
    hints = typing.get_type_hints(cls)
    known = [f.name for f in dataclasses.fields(cls)]  # type: ignore[arg-type] # cls is a dataclass
    for key in data:
        if key not in known:
            hint = did_you_mean(key, known) or f"known: {', '.join(known)}"
            raise ParameterError((*path, str(key)), "is not a known key", hint)
    part = cls(**{key: _read(hints[key], value, (*path, key)) for key, value in data.items()})
    validate(part, path)
    return part


def _check(value: Any, meta: types.MappingProxyType[Any, Any], path: KeyPath) -> None:
    low, high, choices = meta["low"], meta["high"], meta["choices"]
    if choices and value not in choices:
        hint = did_you_mean(value, choices) or f"one of {', '.join(choices)}"
        raise ParameterError(path, f"is {value!r}, which isn't known", hint)
    if isinstance(value, int | float | Fraction) and not low <= value <= high:
        raise ParameterError(path, f"is {value}, not between {low:g} and {high:g}")


def _plain(value: Any) -> Any:
    if dataclasses.is_dataclass(value):
        return to_dict(value)
    if isinstance(value, Fraction):
        return str(value)
    return [_plain(v) for v in value] if isinstance(value, tuple) else value


def _read(hint: Any, value: Any, path: KeyPath) -> Any:
    if isinstance(hint, types.UnionType):
        if value is None:
            return None
        hint = next(a for a in typing.get_args(hint) if a is not type(None))
    if dataclasses.is_dataclass(hint):
        return from_dict(typing.cast("type[Any]", hint), value, path)
    if hint is Fraction:
        try:
            return parse_frame_rate(value)
        except UsageError as exc:
            raise ParameterError(path, f"is {value!r}, not a frame rate", exc.hint) from exc
    if typing.get_origin(hint) is tuple and isinstance(value, list | tuple):
        return tuple(_read(typing.get_args(hint)[0], v, path) for v in value)
    if hint is float and isinstance(value, int) and not isinstance(value, bool):
        try:
            return float(value)
        except OverflowError:
            raise ParameterError(path, "is larger than any number that can be meant") from None
    kind = typing.get_origin(hint) or hint
    if type(value) is not kind:
        raise ParameterError(path, f"is {value!r}, not of the kind {kind.__name__}")
    return value


def parse_frame_rate(value: object) -> Fraction:
    """Read a frame rate.

    Parameters
    ----------
    value : str, int, float or Fraction
        ``"30000/1001"``, ``25``, ``"12.5"``; the rounded values 23.976, 29.97, 59.94 and 119.88
        mean the broadcast rates over 1001.

    Raises
    ------
    UsageError
        When it isn't a positive number.

    Examples
    --------
    >>> parse_frame_rate(29.97), parse_frame_rate("25")
    (Fraction(30000, 1001), Fraction(25, 1))
    """
    text = str(value)
    if text in _NTSC:
        return _NTSC[text]
    try:
        # A number of a billion digits would be exact, too.
        sane = all(1e-12 < float(part) < 1e12 for part in text.split("/"))
        rate = Fraction(text if sane else 0)
    except ValueError:
        rate = Fraction(0)
    if isinstance(value, bool) or rate <= 0:
        raise UsageError(f"{value!r} is not a frame rate", "write 25, 29.97 or 30000/1001")
    return rate

"""Compares two messages field by field: what differs, and by how much."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from rsenf.messages.codec import canonical
from rsenf.messages.schema import FieldSpec, field_specs, message_classes
from rsenf.regress.tolerance import Tolerance, tolerance_of

_NUMBER = re.compile(r"[-+−]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
# Run and arrival time, which differ in every run.
_NOT_CONTENT = ("run_id", "arrival_time_ns")
OTHER = "(bits)"  # a difference in no field, such as the sign of a zero or of a NaN


class Moved(NamedTuple):
    """A field that differs.

    ``by`` is the largest difference, None if the two aren't both numbers; ``allowed`` is the
    tolerance there.
    """

    field: str
    by: float | None
    allowed: float


def moved(then: Any, now: Any, *, exact: bool) -> list[Moved]:
    """Return the fields of a message that differ.

    Parameters
    ----------
    then, now : messages of one class
        Recorded, and produced again.
    exact : bool
        Whether every bit counts; otherwise the tolerances apply.
    """
    if canonical(then) == canonical(now):
        return []
    found = list(_in_message(then, now, exact, ""))
    return found or ([Moved(OTHER, None, 0.0)] if exact else [])


def _in_message(then: Any, now: Any, exact: bool, prefix: str) -> Iterator[Moved]:
    for spec in field_specs(type(then)):
        if spec.name in _NOT_CONTENT and type(then).__name__ == "Header":
            continue
        a, b = getattr(then, spec.name), getattr(now, spec.name)
        name = prefix + spec.name
        if spec.kind == "message" or (spec.kind == "repeated" and spec.wire in message_classes()):
            yield from _in_parts(a, b, exact, name)
        else:
            yield from _in_value(then, spec, a, b, exact, name)


def _in_parts(then: Any, now: Any, exact: bool, name: str) -> Iterator[Moved]:
    """Compare the messages within a message."""
    a, b = (x if isinstance(x, tuple) else (x,) for x in (then, now))
    if len(a) != len(b) or any((x is None) != (y is None) for x, y in zip(a, b, strict=True)):
        yield Moved(name, None, 0.0)
        return
    for x, y in zip(a, b, strict=True):
        if x is not None:
            yield from _in_message(x, y, exact, name + ".")


def _in_value(
    then: Any, spec: FieldSpec, a: Any, b: Any, exact: bool, name: str
) -> Iterator[Moved]:
    tolerance = None if exact else tolerance_of(type(then).__name__, spec.name)
    if spec.wire in ("string", "bytes"):
        if a != b and (exact or not _says_the_same(a, b, tolerance)):
            yield Moved(name, None, 0.0)
        return
    x, y = np.asarray(a), np.asarray(b)
    if x.shape != y.shape:
        yield Moved(name, None, 0.0)
        return
    if x.tobytes() == y.tobytes():
        return
    yield from _in_numbers(then, tolerance, x, y, exact, name)


def _in_numbers(
    then: Any, tolerance: Tolerance | None, x: Any, y: Any, exact: bool, name: str
) -> Iterator[Moved]:
    x, y = x.astype(np.float64), y.astype(np.float64)
    same = (x == y) | (np.isnan(x) & np.isnan(y))
    with np.errstate(invalid="ignore"):
        by = np.where(same, 0.0, np.abs(x - y))
    allowed = tolerance.allowed(then, x, y) if tolerance else np.zeros_like(by)
    if exact or not (same | (by <= allowed)).all():
        worst = int(np.argmax(np.nan_to_num(by, nan=np.inf)))  # NaN: only one of them is a number
        largest = float(by.flat[worst])
        limit = float(np.broadcast_to(allowed, by.shape).flat[worst])
        yield Moved(name, largest if np.isfinite(largest) else None, limit)


def _says_the_same(then: Any, now: Any, tolerance: Tolerance | None) -> bool:
    """Whether texts differ only in numbers, by one in the last digit or within the tolerance."""
    if isinstance(then, tuple):
        pairs = zip(then, now, strict=False)
        return len(then) == len(now) and all(_says_the_same(a, b, tolerance) for a, b in pairs)
    if not isinstance(then, str) or _NUMBER.sub("#", then) != _NUMBER.sub("#", now):
        return False
    relative = tolerance.relative if tolerance else 0.0
    return all(
        abs(float(a) - float(b)) <= 1.001 * _last_digit(a) + relative * abs(float(a))
        for a, b in (
            (a.replace("−", "-"), b.replace("−", "-"))
            for a, b in zip(_NUMBER.findall(then), _NUMBER.findall(now), strict=True)
        )
    )


def _last_digit(number: str) -> float:
    mantissa, _, exponent = number.lower().partition("e")
    return float(10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2])))

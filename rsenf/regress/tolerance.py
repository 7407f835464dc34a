"""Compares two messages field by field, within tolerances that have reasons.

Equal versions must agree exactly. Other versions and processors sum in another order. That gives
rounding errors, which a stage may amplify, but not to a visible size: the scale is each estimate's
own standard error, of which 1 % is allowed. Fields that are not listed must be equal.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from rsenf.messages.codec import canonical
from rsenf.messages.schema import FieldSpec, FloatArray, field_specs, message_classes


@dataclass(frozen=True)
class Tolerance:
    """Allowed difference of a field.

    Attributes
    ----------
    why : str
        The reason for the number.
    absolute : float
        In the field's own unit.
    relative : float
        Share of the larger of the two values; in texts, of the numbers in them.
    scale : callable, optional
        From the recorded message to an additional tolerance, in the field's own unit.
    """

    why: str
    absolute: float = 0.0
    relative: float = 0.0
    scale: Callable[[Any], Any] | None = None

    def allowed(self, message: Any, then: FloatArray, now: FloatArray) -> FloatArray:
        """Return the tolerance of each value, given the recorded message.

        Parameters
        ----------
        message : message
            The recorded one.
        then, now : ndarray
            The field's values, of one shape.
        """
        limit = self.absolute + self.relative * np.fmax(np.abs(then), np.abs(now))
        if self.scale:
            stated = np.asarray(self.scale(message), np.float64)
            limit = limit + np.nan_to_num(stated, nan=0.0, posinf=0.0)
        return np.asarray(limit, np.float64)


SHARE = 0.01
ROUNDED = 1e-9  # rounding of 2⁻⁵³ after sums of millions of terms


def _of_std(name: str, unit: float = 1.0) -> Tolerance:
    return Tolerance(
        f"a hundredth of its own standard error, {name}",
        relative=ROUNDED,
        scale=lambda message: SHARE * unit * np.asarray(getattr(message, name)),
    )


def _of_var(name: str) -> Tolerance:
    return Tolerance(
        f"a hundredth of its own standard error, the root of {name}",
        relative=ROUNDED,
        scale=lambda message: SHARE * np.sqrt(np.abs(getattr(message, name))),
    )


_LEVEL = Tolerance(
    "a level of 255 is rounded to 1.5e-5 in each of a few single-precision steps", absolute=1e-4
)
_COUNTED = Tolerance("a count of pixels over all of them", relative=ROUNDED)
_ERROR = Tolerance("an error is known to a few per cent at best", relative=SHARE)
_DECIBEL = Tolerance("a quarter of a per cent in power", absolute=0.01)
_IDLE = Tolerance("a hundredth of the error of the best second, 0.01 %", absolute=1e-6)
_EXACT = Tolerance("computed from the frames' times alone", relative=ROUNDED)
_HYPOTHESIS = Tolerance("follows a frequency that is known to 1e-5 at best", relative=1e-6)
_BAN = Tolerance("two per cent in the ratio; its calibration is worse", absolute=0.01)
_RATIO = Tolerance("a ratio is printed to two digits at best", relative=SHARE)
_CORRELATION = Tolerance("printed to four digits", absolute=1e-4)
_LAG = Tolerance("a hundredth of the finest step of a reference, 0.1 s", absolute=1e-3)
_LAG_NS = Tolerance("a hundredth of the finest step of a reference, 0.1 s", absolute=1e6)
_CLOCK = Tolerance("a hundredth of 1 ppm, the best that any clip has told", absolute=0.01)

# By message and field.
TOLERANCES: dict[str, dict[str, Tolerance]] = {
    "RowBlock": {
        "level": _LEVEL,
        "tile_level": _LEVEL,
        "steady_ratio": _COUNTED,
        "clipped_ratio": _COUNTED,
    },
    "EnfEstimate": {
        "line_hz": _EXACT,
        "frame_rate_hz": _EXACT,
        "mirror_hz": _EXACT,
        "carrier_hz": _EXACT,
        "idle_ratio": _IDLE,
        "enf_hz": _of_var("enf_var_hz2"),
        "enf_var_hz2": _ERROR,
        "snr_db": _DECIBEL,
        "amplitude_re": _of_var("amplitude_var_re"),
        "amplitude_im": _of_var("amplitude_var_im"),
        "amplitude_var_re": _ERROR,
        "amplitude_var_im": _ERROR,
        "amplitude_cov": Tolerance(
            "a hundredth of the variances beside it",
            scale=lambda m: SHARE * np.sqrt(m.amplitude_var_re * m.amplitude_var_im),
        ),
    },
    "RateHypothesis": {
        "frame_rate_hz": _HYPOTHESIS,
        "idle_ratio": _HYPOTHESIS,
        "read_out_s": _HYPOTHESIS,
    },
    "IdleEstimate": {
        "idle_ratio": _of_var("idle_ratio_var"),
        "idle_ratio_low": _of_var("idle_ratio_var"),
        "idle_ratio_high": _of_var("idle_ratio_var"),
        "idle_ratio_var": _ERROR,
        "read_out_time_s": _of_var("read_out_time_var_s2"),
        "read_out_time_var_s2": _ERROR,
        "frame_rate_hz": _EXACT,
    },
    "MatchResult": {
        "lag_s": _of_std("lag_std_s"),
        "lag_std_s": _ERROR,
        "start_utc_ns": _of_std("lag_std_s", 1e9),
        "correlation": _CORRELATION,
        "log10_lr": _BAN,
        "log10_lr_absent": _BAN,
        "clock_ppm": _of_std("clock_std_ppm"),
        "clock_std_ppm": _ERROR,
        "residual_std_hz": _ERROR,
        "expected_std_hz": _ERROR,
        "idle_ratio": _IDLE,
        "claim_log10_lr": _BAN,
        "claim_log10_lr_other": _BAN,
    },
    "Candidate": {
        "lag_s": _LAG,
        "start_utc_ns": _LAG_NS,
        "correlation": _CORRELATION,
        "clock_ppm": _CLOCK,
        "log10_lr": _BAN,
    },
    "Segment": {
        "from_s": _LAG,
        "to_s": _LAG,
        "lag_s": _of_std("lag_std_s"),
        "lag_std_s": _ERROR,
        "start_utc_ns": _of_std("lag_std_s", 1e9),
        "log10_lr": _BAN,
    },
    "Edit": {
        "at_s": _of_std("at_std_s"),
        "at_std_s": _ERROR,
        "size_s": _of_std("size_std_s"),
        "size_std_s": _ERROR,
        "speed_ratio": _of_std("speed_ratio_std"),
        "speed_ratio_std": _ERROR,
    },
    "Liveness": {
        "lag_s": _of_std("lag_std_s"),
        "lag_std_s": _ERROR,
        "clock_ppm": _of_std("clock_std_ppm"),
        "clock_std_ppm": _ERROR,
        "log10_lr": _BAN,
    },
    "Alarm": {"value": _RATIO, "limit": _RATIO},
    "DiscoveryVerdict": {
        "gap_before": _RATIO,
        "gap_after": _RATIO,
        "gap_floor": _RATIO,
        "gap_stderr": _RATIO,
        "gap_limit": _RATIO,
        "unexplained_freq_hz": _RATIO,
        "unexplained_ratio": _RATIO,
        "unexplained_text": _RATIO,
        "model_yaml": _RATIO,
        "changed": _RATIO,
    },
    "FoundEffect": {
        "parameters": _of_std("parameter_std"),
        "parameter_std": _ERROR,
        "gap_before": _RATIO,
        "gap_after": _RATIO,
        "evidence": _RATIO,
    },
}


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
    tolerance = None if exact else TOLERANCES.get(type(then).__name__, {}).get(spec.name)
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

"""Values as they are told: JSON without NaN, numbers with their errors, lines of text."""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any

import yaml

from rsenf.timebase import utc_text

UNKNOWN = "not known"
SPACE = "\N{NARROW NO-BREAK SPACE}"
Pairs = Iterable[tuple[str, str]]


@cache
def texts(kind: str) -> dict[str, Any]:
    """Return the fixed sentences of a kind of report, of texts.yaml."""
    with Path(__file__).with_name("texts.yaml").open(encoding="utf-8") as file:
        return dict(yaml.safe_load(file)[kind])


def number(value: float) -> float | None:
    """Return a float for JSON: None if it isn't finite."""
    return float(value) if math.isfinite(value) else None


def fields_json(message: object, names: Iterable[str]) -> dict[str, Any]:
    """Return attributes of a message for JSON, in the order of the names.

    Parameters
    ----------
    message : object
        NaN becomes None.
    names : iterable of str
        ``x_utc`` is the attribute ``x_utc_ns`` as ISO 8601; None if unknown.
    """
    return {name: _field_json(message, name) for name in names}


def _field_json(message: object, name: str) -> Any:
    if name.endswith("_utc"):
        return utc_text(getattr(message, f"{name}_ns"))
    value, declared = getattr(message, name), getattr(message, "__dataclass_fields__", {}).get(name)
    is_float = isinstance(value, float) or (declared is not None and declared.type == "float")
    return number(value) if is_float else value


def ppm_text(value: float) -> str:
    """Return parts per million with sign and one decimal; zero is +0.0.

    >>> ppm_text(-0.04), ppm_text(68.25)
    ('+0.0', '+68.2')
    """
    return f"{round(value, 1) + 0.0:+.1f}"


def decimals(error: float) -> int:
    """Return the number of decimals that show two digits of an error; from 1 to 5.

    >>> decimals(0.012), decimals(3.4), decimals(float("nan"))
    (3, 1, 2)
    """
    if not (math.isfinite(error) and error > 0):
        return 2
    return min(max(1 - math.floor(math.log10(error)), 1), 5)


def with_error(value: float, error: float, scale: float = 1.0) -> str:
    """Return a value and its standard error, times ``scale``, to two digits of the error.

    >>> with_error(0.381234, 0.00021, 100.0)
    '38.123 ± 0.021'
    """
    places = decimals(scale * error)
    return f"{scale * value:.{places}f} ± {scale * error:.{places}f}"


def error_text(error: float, how: str) -> str:
    """Return a standard error to be put after its value; empty if there is none."""
    return f" ± {error:{how}}" if math.isfinite(error) else ""


def setting(value: Any) -> str:
    """Return a parameter's value as text.

    >>> setting((0.5, None, True))
    '0.5, not set, yes'
    """
    if value is None or value == "":
        return "not set"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list | tuple):
        return ", ".join(map(setting, value)) or "not set"
    return f"{value:g}" if isinstance(value, float) else str(value)


def lines_text(head: str, pairs: Pairs) -> str:
    """Return a headline, and below it a line for each name and text.

    >>> print(lines_text("match: at noon", [("method", "phase")]))
    match: at noon
      method          phase
    """
    return "\n".join([head, *(f"  {name:15} {text}" for name, text in pairs)])


def known(value: float | None, how: str, scale: float = 1.0, unit: str = "") -> str:
    """Return a number, times ``scale``, with its unit; or that it isn't known."""
    return UNKNOWN if value is None else f"{scale * value:{how}}{unit}"


def fixed(value: float | None, places: int = 2) -> str:
    """Return a number with fixed decimals."""
    return known(value, f".{places}f")


def percent(ratio: float | None, places: int) -> str:
    """Return a ratio in per cent."""
    return known(ratio, f".{places}f", 100.0, " %")


def mhz(value: float | None) -> str:
    """Return hertz as millihertz."""
    return known(value, ".3g", 1e3, " mHz")


def ppm(value: float | None) -> str:
    """Return parts per million, as :func:`ppm_text`."""
    return UNKNOWN if value is None else ppm_text(value)


def count(value: int | None) -> str:
    """Return a whole number with its thousands apart."""
    return UNKNOWN if value is None else f"{value:,}".replace(",", SPACE)


def utc(text: str | None) -> str:
    """Return ISO 8601 in a readable form; seconds keep their decimals."""
    return f"{text[:10]} {text[11:].rstrip('Z')} UTC" if text else UNKNOWN


def power(log10: float | None) -> str:
    """Return a ratio as a power of ten."""
    return UNKNOWN if log10 is None else f"10^{log10:.1f}".replace("-", "\N{MINUS SIGN}")


def duration(value: float | None) -> str:
    """Return seconds as days, hours, minutes and seconds, without those that are zero."""
    if value is None:
        return UNKNOWN
    days, rest = divmod(round(value, 3 if value < 60 else 1), 86400)
    hours, rest = divmod(rest, 3600)
    minutes, rest = divmod(rest, 60)
    parts = [(f"{days:.0f} d", days), (f"{hours:.0f} h", hours), (f"{minutes:.0f} min", minutes)]
    units = [text for text, size in parts if size]
    return " ".join([*units, *([f"{rest:.4g} s"] if rest or not units else [])])

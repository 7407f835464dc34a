"""Generates command-line options from the fields of settings classes, and reads them back.

The option's name comes from the field's name, type and choices from its annotation, the default
from its default, and the help from the ``Parameters`` section of the docstring.

::

    add_settings(parser, "ENF", TrackSettings)      # --enf-method, --window-s S, …
    settings = settings_of(args, TrackSettings)
"""

from __future__ import annotations

import argparse
import dataclasses
import inspect
import math
import pkgutil
import re
import types
import typing
from collections.abc import Callable, Collection, Iterator, Mapping
from pathlib import Path
from typing import Any, Literal, NamedTuple, TypeVar

from rsenf.errors import RsenfError, UsageError

# argparse: a verb is parsed in 0.03 s of processor time; with cyclopts in 0.07, with typer,
# jsonargparse and tyro in 0.13 to 0.18. None of them reads `window_s, hop_s : float`.

T = TypeVar("T")

# Names of options that differ from the field's name; all names of a field are accepted.
SPELT = {
    "first_seed": ("seed",),
    "nominals_hz": ("nominal-hz",),
    "RecordingPlan.size": ("size", "sizes"),
    "CasePlan.each": ("clips",),
    "Codec.name": ("codec",),
    "CasePlan.effects": ("hide",),
    "TrackSettings.method": ("enf-method",),
    "TrackSettings.line_m": ("line-m", "line"),
    "IdleSettings.method": ("idle-method",),
    "IdleSettings.every_s": ("idle-every-s",),
    "RowsSettings.read_out_axis": ("read-out-axis", "read-out"),
    "Rotation.every_s": ("rotate-s",),
    "Rotation.size_mb": ("rotate-mb",),
    "Retention.days": ("keep-days",),
    "Retention.disk_share": ("keep-share",),
    "AlarmSettings.trigger": ("alarm",),
    "AlarmSettings.only": ("alarms-only",),
    "AlarmSettings.before_s": ("before-s",),
    "AlarmSettings.after_s": ("after-s",),
    "AlarmSettings.memory_mb": ("memory-mb",),
    "DiskLimits.warn_mb": ("warn-free-mb",),
    "DiskLimits.stop_mb": ("stop-free-mb",),
}
# Registries of the names that a field allows; other packages may add to them.
NAMES = {
    "TrackSettings.method": "rsenf.track:METHODS",
    "TrackSettings.interpolation": "rsenf.track.paper_templates:INTERPOLATIONS",
    "IdleSettings.method": "rsenf.idle:METHODS",
}
UNITS = ("s", "hz", "ppm", "mb", "hours", "days", "share", "rad", "percent")


class Option(NamedTuple):
    """A field as an option; ``spelt`` are its names without dashes, ``dest`` is argparse's."""

    name: str
    dest: str
    spelt: tuple[str, ...]
    kind: Any
    default: Any
    help: str
    choices: tuple[Any, ...]


def add_settings(
    parser: argparse.ArgumentParser,
    heading: str,
    settings: type,
    *,
    also: Mapping[str, str] | None = None,
    leave_out: Collection[str] = (),
    **defaults: Any,
) -> None:
    """Add the fields of settings as options.

    Parameters
    ----------
    parser : ArgumentParser
    heading : str
        Heading in the help.
    settings : type
        A dataclass or Pydantic model. An option already added by another one is shared with it.
    also : mapping, optional
        One more name of the option, by field.
    leave_out : collection of str
        Fields that become no options.
    **defaults
        The verb's defaults for the help, by field; the verb passes them to :func:`settings_of` too.
    """
    group = next((g for g in parser._action_groups if g.title == heading), None)
    group = group or parser.add_argument_group(heading)
    taken = parser._option_string_actions
    for option in options_of(settings):
        if f"--{option.spelt[0]}" in taken or option.name in leave_out:
            continue
        spelt = [f"--{s}" for s in (*option.spelt, *filter(None, [(also or {}).get(option.name)]))]
        default = defaults.get(option.name, option.default)
        given = {"dest": option.dest, **_kind(option)}
        group.add_argument(*spelt, help=_help(option, default), **given)


def settings_of(args: argparse.Namespace, settings: type[T], **others: Any) -> T:
    """Return settings from arguments.

    Parameters
    ----------
    args : Namespace
        Parsed arguments.
    settings : type
        The settings class.
    **others
        Values of fields that no argument sets.

    Raises
    ------
    UsageError
        When a value is not allowed.
    """
    given = others | given_by(args, settings)
    if not _is_model(settings):  # Pydantic models build their parts themselves
        for name, part in given.items():
            if isinstance(part, dict):
                given[name] = dataclasses.replace(getattr(settings(), name), **part)
    try:
        return settings(**given)
    except RsenfError:
        raise
    except ValueError as exc:  # Pydantic's ValidationError
        error = exc.errors()[0]  # type: ignore[attr-defined]
        name = "-".join(map(str, error["loc"])).replace("_", "-")
        raise UsageError(f"{name}: {error['msg'].removeprefix('Value error, ')}") from exc


def given_by(args: argparse.Namespace, settings: type) -> dict[str, Any]:
    """Return the fields of settings that the arguments set; parts of settings as nested dicts."""
    given: dict[str, Any] = {}
    for option in options_of(settings):
        if (value := getattr(args, option.dest, None)) is not None:
            part, (*within, name) = given, option.name.split(".")
            for step in within:
                part = part.setdefault(step, {})
            part[name] = tuple(value) if isinstance(value, list) else value
    return given


def options_of(settings: Any, within: str = "") -> Iterator[Option]:
    """Yield the fields of settings, and of nested settings, as options."""
    hints = typing.get_type_hints(settings)
    for field, default, text, choices in _fields(settings):
        kind, name = _without_none(hints[field]), f"{within}{field}"
        if isinstance(kind, type) and (dataclasses.is_dataclass(kind) or _is_model(kind)):
            yield from options_of(kind, f"{name}.")
            continue
        known = f"{settings.__name__}.{field}"
        spelt = SPELT.get(known) or SPELT.get(field, (re.sub(r"[._]", "-", name),))
        if known in NAMES:
            choices = tuple(pkgutil.resolve_name(NAMES[known]))
        if typing.get_origin(kind) is Literal:
            choices = typing.get_args(kind)
            kind = type(choices[0])
        yield Option(name, spelt[0].replace("-", "_"), spelt, kind, default, text, choices)


def _fields(settings: Any) -> Iterator[tuple[str, Any, str, tuple[str, ...]]]:
    if _is_model(settings):
        for name, field in settings.model_fields.items():
            default = None if field.is_required() else field.default
            yield name, default, field.description or "", ()
        return
    docs = field_docs(settings)
    for field in dataclasses.fields(settings):
        default = None if field.default is dataclasses.MISSING else field.default
        if field.default_factory is not dataclasses.MISSING:
            default = field.default_factory()
        text = field.metadata.get("doc") or docs.get(field.name, "")
        yield field.name, default, text, field.metadata.get("choices", ())


def _is_model(kind: Any) -> bool:
    return hasattr(kind, "model_fields")


def _without_none(hint: Any) -> Any:
    if typing.get_origin(hint) in (typing.Union, types.UnionType):
        (hint,) = (part for part in typing.get_args(hint) if part is not type(None))
    return hint


def _kind(option: Option) -> dict[str, Any]:
    """Return argparse's keyword arguments for an option's type."""
    if option.kind is bool:
        return {"action": argparse.BooleanOptionalAction}
    read: dict[Any, Callable[[str], Any]] = {float: number, int: int, Path: Path, str: str}
    if option.kind not in read:  # a tuple
        several = many(read[typing.get_args(option.kind)[0]])
        return {"type": several, "metavar": "LIST", "action": "extend"}
    unit = re.split("[._]", option.name)[-1]
    usual = {float: "X", int: "N", Path: "FILE", str: "NAME"}[option.kind]
    metavar = unit.upper() if unit in UNITS else usual
    return {"type": read[option.kind], "metavar": metavar, "choices": option.choices or None}


def _help(option: Option, default: Any) -> str:
    """Return the help text with choices and default, in the style of all options."""
    text = option.help
    if option.choices:
        text += f": {', '.join(map(str, option.choices))}"
    if default is not None and default != "" and default != ():
        text += f" ({shown(default)})"
    return text.replace("%", "%%")


def shown(value: Any) -> str:
    """Return a value as one would type it.

    >>> shown((0.5, 20)), shown(True)
    ('0.5, 20', 'on')
    """
    if isinstance(value, bool):
        return "on" if value else "off"
    if isinstance(value, tuple):
        return ", ".join(map(shown, value))
    return f"{value:g}" if isinstance(value, float) else str(value)


def field_docs(settings: type, heading: str = "Parameters") -> dict[str, str]:
    """Return the first sentence of each field's description in a numpydoc docstring.

    Parameters
    ----------
    settings : type
        A class with such a docstring.
    heading : str
        Section with the fields.
    """
    over = f"\n{heading}\n{'-' * len(heading)}\n"
    _, _, section = (inspect.getdoc(settings) or "").partition(over)
    docs: dict[str, str] = {}
    for names, text in re.findall(
        r"^(\w+(?:, \w+)*) : .*\n((?:[ ].*\n|\n)*)", section + "\n", re.M
    ):
        plain = re.sub(r":\w+:`[\w.]*?(\w+)`", r"\1", " ".join(text.split())).replace("``", "")
        sentence = re.split(r"\.(?: (?=[A-Z])|$)", plain)[0]
        if re.match(r"[A-Z][a-z ]", sentence):
            sentence = sentence[0].lower() + sentence[1:]
        docs |= dict.fromkeys(names.split(", "), sentence)
    return docs


def _finite(text: str, above: float, which: str) -> float:
    value = float(text)
    if not above < value < math.inf:
        raise argparse.ArgumentTypeError(f"{text} is not a finite number{which}")
    return value


def number(text: str) -> float:
    """Argument type: a finite number."""
    return _finite(text, -math.inf, "")


def positive(text: str) -> float:
    """Argument type: a finite number above zero."""
    return _finite(text, 0.0, " above 0")


def at_least_0(text: str) -> float:
    """Argument type: a finite number, zero or above."""
    return _finite(text, -math.ulp(0.0), ", 0 or above")


def count(text: str) -> int:
    """Argument type: 0, 1, 2 …"""
    value = int(text)
    if value < 0:
        raise argparse.ArgumentTypeError(f"{text} is below 0")
    return value


def named(text: str) -> tuple[str, str]:
    """Argument type: ``NAME=VALUE``."""
    name, equals, value = text.partition("=")
    if not (name and equals and value):
        raise argparse.ArgumentTypeError(f"{text!r} is not NAME=VALUE")
    return name, value


def many(kind: Callable[[str], Any]) -> Callable[[str], tuple[Any, ...]]:
    """Argument type: several values of a kind, separated by commas.

    >>> many(int)("1, 2,3")
    (1, 2, 3)
    """

    def read(text: str) -> tuple[Any, ...]:
        return tuple(kind(word.strip()) for word in text.split(","))

    return read

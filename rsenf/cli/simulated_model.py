"""The model that the options of ``rsenf simulate`` describe."""

from __future__ import annotations

import argparse
import dataclasses
import json
import re
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rsenf.model import CaptureModel, Codec

# Commas part parameters, but not within a list such as at_frames=[10,20].
_COMMA = re.compile(r",(?![^\[]*\])")


def model_of(args: argparse.Namespace) -> CaptureModel:
    """Return the model file's capture, or the default one, with the options over it.

    Raises
    ------
    UsageError
        For an option or model file that can't be meant so.
    """
    from rsenf.config.model_file import load_model
    from rsenf.model import CaptureModel, parse_frame_rate

    model = load_model(args.model) if args.model else CaptureModel()
    columns, rows = args.size or (None, None)
    rate = parse_frame_rate(args.frame_rate) if args.frame_rate else None
    shutter = {
        "frame_rate": rate, "rows": rows, "columns": columns, "idle_ratio": args.idle_ratio,
    }  # fmt: skip
    codec = {
        "name": args.codec, "bitrate_bps": args.bitrate,
        "lossless": args.lossless, "preset": args.preset,
    }  # fmt: skip
    encoding = model.codec
    if args.bitrate or args.lossless:  # either replaces what the model file says of both
        encoding = dataclasses.replace(encoding, bitrate_bps=None, lossless=False)
    model = dataclasses.replace(
        model,
        light=_over(model.light, {"lamp": args.lamp}),
        shutter=_over(model.shutter, shutter),
        codec=_over(encoding, codec),
    )
    if args.clock_ppm is not None:
        model = model.with_effect("clock_skew", clock_ppm=args.clock_ppm)
    return _with_effects(model, args.effect)


def _over(part: Any, given: dict[str, object]) -> Any:
    """Return a part of the model with what was given on the command line."""
    return dataclasses.replace(part, **{k: v for k, v in given.items() if v is not None})


def _with_effects(model: CaptureModel, told: list[str]) -> CaptureModel:
    """Add effects; the first of each name takes the place of the model file's."""
    from rsenf.model import make_effect

    first_of: set[str] = set()
    for text in told:
        name, _, given = text.partition(":")
        values = dict(_value(pair, text) for pair in _COMMA.split(given) if pair)
        effect = make_effect(name, values)
        model = (model if name in first_of else model.without(name)).plus(effect)
        first_of.add(name)
    return model


def _value(pair: str, text: str) -> tuple[str, object]:
    """Read ``parameter=value``; values are written as in JSON, plain words without quotes."""
    from rsenf.errors import UsageError

    name, equals, value = pair.partition("=")
    if not (name and equals and value):
        raise UsageError(f"--effect {text}: {pair!r} is not PARAMETER=VALUE")
    try:
        return name, json.loads(value)
    except json.JSONDecodeError:
        return name, value


def codecs_of(model: CaptureModel, labels: list[str] | None) -> dict[str, Codec]:
    """Encodings by the label in their files' names; the model's own has none."""
    if not labels:
        return {"": model.codec}
    plain = dataclasses.replace(model.codec, bitrate_bps=None, lossless=False)
    return {
        label: dataclasses.replace(plain, lossless=True)
        if label == "lossless"
        else dataclasses.replace(plain, bitrate_bps=bits(label))
        for label in labels
    }


def size(text: str) -> tuple[int, int]:
    """Argument type: columns x rows."""
    columns, _, rows = text.lower().partition("x")
    try:
        return int(columns), int(rows)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a size like 1280x720") from None


def bits(text: str) -> int:
    """Argument type: a bit rate."""
    number, factor = text, 1
    if text[-1:].lower() in ("k", "m"):
        number, factor = text[:-1], {"k": 1_000, "m": 1_000_000}[text[-1].lower()]
    try:
        return round(float(number) * factor)
    except (ValueError, OverflowError):
        raise argparse.ArgumentTypeError(f"{text!r} is not a bit rate like 150k or 2M") from None


def labels(text: str) -> list[str]:
    """Argument type: encodings by name."""
    found = [label.strip() for label in text.split(",")]
    for label in found:
        if label != "lossless":
            bits(label)
    return found

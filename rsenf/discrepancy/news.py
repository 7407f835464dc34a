"""What a window shows that the one before didn't: what came, what went, and what moved."""

from __future__ import annotations

import math
from collections.abc import Iterator

from rsenf.discrepancy.seen import Seen, names_of
from rsenf.messages import FoundEffect

# A parameter has moved that is off by so many standard errors, and by so much of itself.
MOVED_STDS, MOVED_RATIO = 6.0, 0.01


def changes(before: Seen, now: Seen) -> tuple[str, ...]:
    """Say what isn't as it was, one line each."""
    return (*_new_and_gone(before, now), *_moved(before, now), *_unexplained(before, now))


def _new_and_gone(before: Seen, now: Seen) -> Iterator[str]:
    were = {name for effect in before.effects for name in names_of(effect)}
    are = {name for effect in now.effects for name in names_of(effect)}
    for effect in now.effects:
        if not were.intersection(names_of(effect)):
            yield f"{_called(effect)} is new{_measures(effect)}"
    for effect in before.effects:
        if not are.intersection(names_of(effect)):
            yield f"{_called(effect)} is gone"


def _moved(before: Seen, now: Seen) -> Iterator[str]:
    for (part, name), (value, error) in now.values.items():
        was, was_error = before.values.get((part, name), (value, error))
        sure = MOVED_STDS * math.hypot(error, was_error)
        if abs(value - was) > max(sure, MOVED_RATIO * abs(was)):
            yield f"{part}.{name} went from {was:.4g} to {value:.4g}"


def _unexplained(before: Seen, now: Seen) -> Iterator[str]:
    if now.verdict == "unexplained" != before.verdict:
        yield "something is new that no effect explains"
    if before.verdict == "unexplained" != now.verdict:
        yield "nothing is left unexplained"


def _called(effect: FoundEffect) -> str:
    return " or ".join(names_of(effect))


def _measures(effect: FoundEffect) -> str:
    """Say what was found of an effect's parameters: those that were fitted, and frames it names."""
    told = zip(effect.parameter_names, effect.parameters, effect.parameter_std, strict=True)
    said = [f"{name} {value:.6g} ± {std:.2g}" for name, value, std in told if math.isfinite(std)]
    at = sum(name.startswith("at_frames") for name in effect.parameter_names)
    said += [f"{at} times in this window"] if at else []
    return f" ({', '.join(said)})" if said else ""

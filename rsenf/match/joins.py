"""How the parts of a clip go together, in words: cut, looped, joined, or as one recording does."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise

from rsenf.match.matcher import moment
from rsenf.match.parts import Part, Parts, Span

# Nats by which one lag must say less of some stretches than each of them says by its own, before
# they are said not to go together. Of unedited clips with errors of all kinds and sizes it was 6 at
# most; a reference that is itself at fault brings up to 60.
MISFIT = 15.0
SAME_S, SAME_STDS = 0.1, 4.0  # lags that differ by less may be one
OVERLAP_S = 5.0  # of what two parts show, from which on it is shown again


@dataclass(frozen=True)
class Assembly:
    """How a clip's parts go together.

    ``one_time`` says that they lie as those of one recording do; ``warnings`` what is wrong with
    it, and nothing where nothing is.
    """

    one_time: bool
    warnings: tuple[str, ...]


def assembled(found: Parts, parts: Sequence[Part], tolerance_s: float) -> Assembly:
    """Say how the parts of a clip, one at least, go together.

    Parameters
    ----------
    found : Parts
        What found them.
    parts : sequence of Part
        In the clip's order.
    tolerance_s : float
        By which the lags of one recording's parts may differ.
    """
    wrong = [*_joins(found, parts), *_ends(found, parts)]
    if wrong and len(parts) > 1:
        wrong.insert(0, "; ".join(_where(found, part) for part in parts))
    one_time = all(_one_time(a, b, tolerance_s) for a, b in combinations(parts, 2))
    return Assembly(one_time, tuple(wrong))


def _joins(found: Parts, parts: Sequence[Part]) -> list[str]:
    """Say what happened between each part and the next, where they don't simply go on."""
    out = []
    for a, b in pairwise(parts):
        apart = found.score(a.place, a.span) + found.score(b.place, b.span)
        if _one_time(a, b, SAME_S):
            if apart - found.score(a.place, (a.span[0], b.span[1])) >= MISFIT:
                out.append(_jump(found, a, b))
        elif apart - _best_as_one(found, a, b) >= MISFIT:
            out.append(_edit(found, a, b))
    return out


def _one_time(a: Part, b: Part, within_s: float) -> bool:
    """Whether the lags of two parts differ by no more than so much, or than by their errors."""
    apart_s = abs(a.place.lag_s - b.place.lag_s)
    error_s = math.hypot(a.place.lag_std_s, b.place.lag_std_s)
    return a.place.grid == b.place.grid and apart_s <= max(within_s, SAME_STDS * error_s)


def _best_as_one(found: Parts, a: Part, b: Part) -> float:
    """Score of two parts at one lag, that of either."""
    return max(found.score(part.place, a.span, b.span) for part in (a, b))


def _jump(found: Parts, a: Part, b: Part) -> str:
    (_, from_s), (to_s, _) = _ends_s(found, a.span), _ends_s(found, b.span)
    return (
        f"at about {(from_s + to_s) / 2:.0f} s of the clip the light's phase jumps: frames dropped "
        "there, a moment cut out, or is the reference at fault?"
    )


def _edit(found: Parts, a: Part, b: Part) -> str:
    """Say how one part comes to lie after another."""
    if a.place.grid != b.place.grid:
        return "the clip was put together from recordings in different grids?"
    _, at_s = _ends_s(found, a.span)
    next_s, end_s = _ends_s(found, b.span)
    later_s = b.place.lag_s - a.place.lag_s
    if later_s > 0:
        return f"at {at_s:.0f} s of the clip {later_s:.1f} s are missing: cut and rejoined?"
    shown_again_s = at_s - (next_s + later_s)
    begin_s, _ = _ends_s(found, a.span)
    if end_s + later_s <= begin_s + OVERLAP_S:
        return f"from {next_s:.0f} s on the clip shows what was recorded before: rearranged?"
    if shown_again_s >= OVERLAP_S:
        return (
            f"from {next_s:.0f} s on the clip goes back by {-later_s:.1f} s and shows "
            f"{shown_again_s:.0f} s again: looped?"
        )
    return (
        f"between {at_s:.0f} and {next_s:.0f} s of the clip are {-later_s:.1f} s that the "
        "reference lacks: something put in, or samples missing from a reference without times?"
    )


def _ends(found: Parts, parts: Sequence[Part]) -> list[str]:
    """Say of the clip's ends whether they fit what is beside them."""
    first, last, out = parts[0], parts[-1], []
    head, tail = (0, first.span[0]), (last.span[1], found.clip.size)
    for part, end, name in ((first, head, "first"), (last, tail, "last")):
        if end[0] == end[1]:
            continue
        longer = min(part.span[0], end[0]), max(part.span[1], end[1])
        if found.score(part.place, part.span) - found.score(part.place, longer) >= MISFIT:
            from_s, to_s = _ends_s(found, end)
            own = "" if len(parts) > 1 else f", while {_where(found, part)}"
            out.append(
                f"the clip's {name} {to_s - from_s:.0f} s don't fit what is beside them{own}: "
                "edited, another recording joined on, or is the reference at fault there?"
            )
    return out


def _where(found: Parts, part: Part) -> str:
    from_s, to_s = _ends_s(found, part.span)
    grid = found.grids[part.place.grid]
    began = moment(grid, part.place.lag_s + from_s)
    name = f" in {grid.name}" if len(found.grids) > 1 else ""
    return f"{from_s:.0f} to {to_s:.0f} s of the clip fit from {began} on{name}"


def _ends_s(found: Parts, span: Span) -> tuple[float, float]:
    """Begin and end of a span of phases, in seconds of the clip."""
    clip, half = found.clip, found.clip.hop_s / 2
    return float(clip.t_s[span[0]] - half), float(clip.t_s[span[1] - 1] + half)

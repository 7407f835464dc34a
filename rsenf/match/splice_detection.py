"""Describes how the parts of a clip fit together: cut, looped, joined, or as one recording."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise

from rsenf.match.matcher import moment, start_ns
from rsenf.match.parts import Part, Parts, Span
from rsenf.messages import Edit, Segment

# Log-likelihood (nats) that two stretches must lose at a common lag, compared with a lag for each,
# to be reported as an edit. In unedited clips with all kinds and sizes of errors it was at most 6;
# a faulty reference causes up to 60.
MISFIT = 15.0
SAME_S, SAME_STDS = 0.1, 4.0  # lags that differ by less may be equal
REPLACED_S = 12.0  # shortest gap between parts of one recording that is a passage, not a jump
OVERLAP_S = 5.0  # least repeated time that is reported as such


@dataclass(frozen=True)
class Assembly:
    """How a clip's parts fit together.

    ``one_time`` says whether their lags are those of one recording. ``edits`` are the problems
    found, ``warnings`` the same in words, and ``segments`` the parts; all are empty if there is no
    problem.
    """

    one_time: bool
    segments: tuple[Segment, ...]
    edits: tuple[Edit, ...]
    warnings: tuple[str, ...]


def assembled(found: Parts, parts: Sequence[Part], tolerance_s: float) -> Assembly:
    """Describe how the parts of a clip fit together.

    Parameters
    ----------
    found : Parts
        The object that found them.
    parts : sequence of Part
        In the clip's order; at least one.
    tolerance_s : float
        Largest difference between the lags of one recording's parts.
    """
    wrong = [*_joins(found, parts), *_ends(found, parts)]
    warnings = [edit.text for edit in wrong]
    if wrong and len(parts) > 1:
        warnings.insert(0, "; ".join(_where(found, part) for part in parts))
    segments = [_segment(found, part) for part in parts if wrong]
    one_time = all(_one_time(a, b, tolerance_s) for a, b in combinations(parts, 2))
    wrong.sort(key=lambda edit: edit.at_s)
    return Assembly(one_time, tuple(segments), tuple(wrong), tuple(warnings))


def _segment(found: Parts, part: Part) -> Segment:
    from_s, to_s = _ends_s(found, part.span)
    grid, lag_s = found.grids[part.place.grid], part.place.lag_s + from_s
    return Segment(
        from_s=from_s,
        to_s=to_s,
        grid=grid.name,
        lag_s=lag_s,
        lag_std_s=part.place.lag_std_s,
        start_utc_ns=start_ns(grid, lag_s),
        log10_lr=part.log10_lr,
    )


def _joins(found: Parts, parts: Sequence[Part]) -> list[Edit]:
    """Describe the edit between each part and the next, unless they are continuous."""
    out = []
    for a, b in pairwise(parts):
        apart = found.score(a.place, a.span) + found.score(b.place, b.span)
        if _one_time(a, b, SAME_S):
            if apart - found.score(a.place, (a.span[0], b.span[1])) >= MISFIT:
                out.append(_jump(found, a, b))
        elif apart - max(found.score(part.place, a.span, b.span) for part in (a, b)) >= MISFIT:
            out.append(_edit(found, a, b))
    return out


def _one_time(a: Part, b: Part, within_s: float) -> bool:
    """Whether the lags of two parts differ by at most ``within_s``, within their errors."""
    apart_s = abs(a.place.lag_s - b.place.lag_s)
    error_s = math.hypot(a.place.lag_std_s, b.place.lag_std_s)
    return a.place.grid == b.place.grid and apart_s - SAME_STDS * error_s <= within_s


def _jump(found: Parts, a: Part, b: Part) -> Edit:
    """Describe a passage or a phase jump between two parts with the same lag."""
    (_, from_s), (to_s, _) = _ends_s(found, a.span), _ends_s(found, b.span)
    at_s, at_std_s = found.meeting(a, b)
    if to_s - from_s >= REPLACED_S:
        return Edit(
            kind="replaced",
            at_s=from_s,
            at_std_s=at_std_s,
            size_s=to_s - from_s,
            text=f"from {from_s:.0f} to {to_s:.0f} s the clip doesn't fit what is before and after "
            "it: another passage in its place, or is the reference at fault there?",
        )
    return Edit(
        kind="jump",
        at_s=at_s,
        at_std_s=at_std_s,
        text=f"at about {at_s:.0f} s of the clip the light's phase jumps: frames dropped "
        "there, a moment cut out, or is the reference at fault?",
    )


def _edit(found: Parts, a: Part, b: Part) -> Edit:
    """Describe the edit between two parts with different lags."""
    at_s, at_std_s = found.meeting(a, b)
    if a.place.grid != b.place.grid:
        text = "the clip was put together from recordings in different grids?"
        return Edit(kind="joined", at_s=at_s, at_std_s=at_std_s, text=text)
    later_s = b.place.lag_s - a.place.lag_s
    size_std_s = math.hypot(a.place.lag_std_s, b.place.lag_std_s)
    at, size = f"{at_s:.0f} s", f"{abs(later_s):.1f} s"
    sure = f"(where: ± {max(at_std_s, 1.0):.0f} s, by how much: ± {max(size_std_s, 0.1):.1f} s)"
    begin_s, before_s = _ends_s(found, a.span)
    next_s, end_s = _ends_s(found, b.span)
    if later_s > 0:
        kind, text = "cut", f"at {at} of the clip {size} are missing: cut and rejoined? {sure}"
    elif end_s + later_s <= begin_s + OVERLAP_S:
        kind = "rearranged"
        text = f"from {at} on the clip shows what was recorded before: rearranged?"
        text += f" Back by {size} {sure}"
    elif before_s - (next_s + later_s) >= OVERLAP_S:
        kind = "repeated"
        text = f"from {at} on the clip goes back by {size} and shows as much again: looped? {sure}"
    else:
        kind, at_s = "inserted", before_s
        text = (
            f"between {before_s:.0f} and {next_s:.0f} s of the clip are {size} that the reference "
            "lacks: something put in or shown twice, or samples missing from a reference without "
            f"times? {sure}"
        )
    return Edit(
        kind=kind, at_s=at_s, at_std_s=at_std_s, size_s=abs(later_s), size_std_s=size_std_s,
        text=text,
    )  # fmt: skip


def _ends(found: Parts, parts: Sequence[Part]) -> list[Edit]:
    """Describe ends of the clip that don't fit the part next to them."""
    first, last, out = parts[0], parts[-1], []
    head, tail = (0, first.span[0]), (last.span[1], found.clip.size)
    for part, end, name in ((first, head, "first"), (last, tail, "last")):
        if end[0] == end[1]:
            continue
        longer = min(part.span[0], end[0]), max(part.span[1], end[1])
        if found.score(part.place, part.span) - found.score(part.place, longer) >= MISFIT:
            from_s, to_s = _ends_s(found, end)
            context = "" if len(parts) > 1 else f", while {_where(found, part)}"
            text = (
                f"the clip's {name} {to_s - from_s:.0f} s don't fit what is beside them{context}: "
                "edited, another recording joined on, or is the reference at fault there?"
            )
            out.append(Edit(kind="end", at_s=from_s, size_s=to_s - from_s, text=text))
    return out


def _where(found: Parts, part: Part) -> str:
    from_s, to_s = _ends_s(found, part.span)
    grid = found.grids[part.place.grid]
    began = moment(grid, part.place.lag_s + from_s)
    name = f" in {grid.name}" if len(found.grids) > 1 else ""
    return f"{from_s:.0f} to {to_s:.0f} s of the clip fit from {began} on{name}"


def _ends_s(found: Parts, span: Span) -> tuple[float, float]:
    """Return the begin and end of a span of phases, in seconds of the clip."""
    clip, half = found.clip, found.clip.hop_s / 2
    return float(clip.t_s[span[0]] - half), float(clip.t_s[span[1] - 1] + half)

"""Re-examines a finding for usual mistakes: an edited clip, wrong speed, wrong reference step.

Each mistake found is named with its remedy; it never turns a finding into a match.

Model: an edited clip is several parts with a lag each (:mod:`rsenf.match.parts`), or with one lag
and a jump of the phase. At a wrong speed the ENF is off by a constant, far beyond clock errors.
Statistic: the log-likelihood that two neighbouring parts lose at a common lag, an edit from 15 nats
on. Speed and step: the phase matcher's ratios, of up to 120 s from the middle of the clip.
Approximate: the 15 nats are empirical, from unedited clips, which lose 6 at most; a reference's
faults lose up to 60, and look like edits.

References
----------
Rodríguez, D. P. N., Apolinário, J. A. and Biscainho, L. W. P. (2010), Audio authenticity: detecting
ENF discontinuity with high precision phase analysis, IEEE TIFS 5.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise

from rsenf.errors import UsageError
from rsenf.match.calibration import calibration
from rsenf.match.clip_phase import ClipPhase, clip_phase
from rsenf.match.matcher import Finding, claimed_lag_s, moment, start_ns
from rsenf.match.parts import MIN_PHASES, ClipPart, Parts, Span
from rsenf.match.phase import weigh
from rsenf.match.phase_scorer import PhaseScorer
from rsenf.match.phase_search import PhaseSearch, Place, refined, search_phase
from rsenf.match.series import Grid, Track
from rsenf.match.settings import MatchSettings
from rsenf.messages import Edit, Segment

STRETCH_S = 120.0  # of the clip, searched for again
STEPS_S = (0.1, 0.5, 1.0, 2.0)  # usual steps of references
# Scale of apparent clock errors from wrong frame rates: 30 for 29.97 gives 1000 ppm.
SPEED_SCALE_PPM = 1000.0
LEAST_PPM = 200.0  # more than any camera's clock error
MOST_OF_CLIP = 0.75  # that must fit for a clip with a bad part to stay a match
SHIFTS = (0.0, -1.0, -0.5, 0.5, 1.0)  # of a claimed lag, in units of the tolerance


@dataclass(frozen=True, eq=False)
class SpeedHypothesis:
    """The place where a clip would fit under an assumed mistake."""

    grid: Grid
    lag_s: float
    mistake: Edit


def what_fits(
    track: Track, grids: Sequence[Grid], settings: MatchSettings
) -> SpeedHypothesis | None:
    """Return a mistake in speed or reference step under which the clip fits, if there is one."""
    count = min(round(STRETCH_S / track.hop_s), track.enf_hz.size)
    first = (track.enf_hz.size - count) // 2
    part = track.between(first, first + count)
    clip = clip_phase(part)
    if clip is None or part.usable * part.hop_s < settings.min_seconds:
        return None
    found = _other_speed(part, clip, grids, settings)
    return next(iter([found] if found else _other_steps(part, clip, grids, settings)), None)


def _other_speed(
    part: Track, clip: ClipPhase, grids: Sequence[Grid], settings: MatchSettings
) -> SpeedHypothesis | None:
    found = search_phase(part, clip, grids, replace(settings, clock_scale_ppm=SPEED_SCALE_PPM))
    if not _sure(found, settings):
        return None
    best = found.places[0]
    grid, clock = grids[best.grid], found.clocks([best])[best]
    away_hz = clock.offset_hz
    if abs(away_hz) < LEAST_PPM * 1e-6 * part.nominal_hz:
        return None
    side = "faster" if away_hz > 0 else "slower"
    text = (
        f"played {abs(away_hz) / part.nominal_hz:.3%} {side} than it was filmed, the clip would "
        f"begin {moment(grid, best.lag_s)}: wrong frame times? 30 and 29.97 frames/s differ by "
        "0.1 %"
    )
    mistake = Edit(
        kind="speed",
        text=text,
        speed_ratio=1.0 + away_hz / part.nominal_hz,
        speed_ratio_std=clock.offset_std_hz / part.nominal_hz,
    )
    return SpeedHypothesis(grid, best.lag_s, mistake)


def _other_steps(
    part: Track, clip: ClipPhase, grids: Sequence[Grid], settings: MatchSettings
) -> Iterator[SpeedHypothesis]:
    """Try other steps for references without times; where there are times, the step is known."""
    for step_s in STEPS_S:
        stated = [grid for grid in grids if not grid.t0_ns and grid.step_s != step_s]
        stated = [grid for grid in stated if step_s * grid.freq_hz.size > STRETCH_S]
        others = [replace(grid, step_s=step_s) for grid in stated]
        try:
            found = search_phase(part, clip, others, settings)
        except UsageError:  # neither this step nor the clip's is a multiple of the other
            continue
        if _sure(found, settings):
            best, was_s = found.places[0], stated[found.places[0].grid].step_s
            text = (
                f"with a step of {step_s:g} s instead of {was_s:g} s the reference would fit, "
                f"{best.lag_s:.1f} s into it: is the step wrong?"
            )
            yield SpeedHypothesis(others[best.grid], best.lag_s, Edit(kind="step", text=text))


def _sure(found: PhaseSearch, settings: MatchSettings) -> bool:
    if not found.places:
        return False
    # The search tolerates bad blocks, so a wrong time may fit part of an edited clip. Here the clip
    # must fit as a whole too.
    best, scorer = found.places[0], found.scorers[found.places[0].grid]
    whole = PhaseScorer(scorer.clip, scorer.grid, scorer.settings, robust=False)
    if refined(whole, best).weight < math.log(max(found.span_s, 1.0)):
        return False
    raw, lines = weigh(found), calibration()
    return min(lines.other(raw.other), lines.absent(raw.absent)) >= settings.min_log10_lr


def examined(
    finding: Finding,
    track: Track,
    grids: Sequence[Grid],
    settings: MatchSettings,
    claimed_utc_ns: int = 0,
) -> Finding:
    """Look for edits and mistakes, and withdraw what they make uncertain (Rodríguez et al. 2010).

    An edited clip is no match as a whole, and a clip that would fit with another step or speed may
    be in the reference. Both become ``no_decision``, with a warning that names the mistake. A
    claimed start that may then be right is no longer refuted.

    Parameters
    ----------
    finding : Finding
        Result of the phase matcher.
    track, grids, settings, claimed_utc_ns
        As given to the matcher.
    """
    clip = clip_phase(track)
    if clip is None or finding.grid is None:
        return finding
    found = Parts(track, clip, grids, settings)
    number = next(i for i, grid in enumerate(grids) if grid is finding.grid)
    best = Place(number, finding.lag_s, finding.lag_std_s, 0.0)
    parts = found.found(best, _claimed(grids, claimed_utc_ns, settings.tolerance_s))
    assembly = assembled(found, parts, settings.tolerance_s) if parts else None
    if assembly and assembly.edits:
        warned = replace(
            finding,
            warnings=(*finding.warnings, *assembly.warnings),
            segments=assembly.segments,
            edits=assembly.edits,
        )
        fitting = sum(last - first for first, last in (part.span for part in parts))
        is_most = assembly.one_time and fitting >= MOST_OF_CLIP * clip.size
        if is_most and finding.decision == "match":
            return warned
        reason, first = "parts of the clip fit, but not as one recording", parts[0]
        warned = _placed_by(warned, parts, grids, settings.tolerance_s)
        begins_at = first.place.lag_s if first.span[0] < MIN_PHASES else math.nan
        grid = grids[first.place.grid]
    else:
        supposed = None if finding.decision == "match" else what_fits(track, grids, settings)
        if supposed is None:
            return finding
        warnings = (*finding.warnings, supposed.mistake.text)
        warned = replace(finding, warnings=warnings, edits=(supposed.mistake,))
        reason = "the clip would fit, but for a mistake"
        begins_at, grid = supposed.lag_s, supposed.grid
    undecided = replace(warned, decision="no_decision", reason=reason)
    # A claim stays refuted only if the clip is known to begin at another time.
    away_s = abs(claimed_lag_s(grid, claimed_utc_ns) - begins_at)
    if away_s > settings.tolerance_s and finding.claim_log10_lr <= -settings.min_log10_lr:
        return undecided
    return replace(undecided, claim_log10_lr=math.nan, claim_log10_lr_other=math.nan)


def _placed_by(
    finding: Finding, parts: Sequence[ClipPart], grids: Sequence[Grid], tolerance_s: float
) -> Finding:
    """Move a finding to its longest part, if its own time is that of no part."""
    near = (
        abs(part.place.lag_s - finding.lag_s) <= tolerance_s
        and grids[part.place.grid] is finding.grid
        for part in parts
    )
    if any(near):
        return finding
    place = max(parts, key=lambda part: part.span[1] - part.span[0]).place
    return replace(
        finding, grid=grids[place.grid], lag_s=place.lag_s, lag_std_s=place.lag_std_s, verbal="",
        correlation=math.nan, log10_lr=math.nan, log10_lr_absent=math.nan, clock_ppm=math.nan,
        clock_std_ppm=math.nan, residual_std_hz=math.nan, expected_std_hz=math.nan,
    )  # fmt: skip


def _claimed(grids: Sequence[Grid], claimed_utc_ns: int, tolerance_s: float) -> list[Place]:
    """Places near a claimed start in each reference; none without a claim."""
    lags = [(number, claimed_lag_s(grid, claimed_utc_ns)) for number, grid in enumerate(grids)]
    return [
        Place(number, lag_s + shift * tolerance_s, tolerance_s / 2, 0.0)
        for number, lag_s in lags
        for shift in SHIFTS
        if math.isfinite(lag_s)
    ]


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


def assembled(found: Parts, parts: Sequence[ClipPart], tolerance_s: float) -> Assembly:
    """Describe how the parts of a clip fit together.

    Parameters
    ----------
    found : Parts
        The object that found them.
    parts : sequence of ClipPart
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


def _segment(found: Parts, part: ClipPart) -> Segment:
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


def _joins(found: Parts, parts: Sequence[ClipPart]) -> list[Edit]:
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


def _one_time(a: ClipPart, b: ClipPart, within_s: float) -> bool:
    """Whether the lags of two parts differ by at most ``within_s``, within their errors."""
    apart_s = abs(a.place.lag_s - b.place.lag_s)
    error_s = math.hypot(a.place.lag_std_s, b.place.lag_std_s)
    return a.place.grid == b.place.grid and apart_s - SAME_STDS * error_s <= within_s


def _jump(found: Parts, a: ClipPart, b: ClipPart) -> Edit:
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


def _edit(found: Parts, a: ClipPart, b: ClipPart) -> Edit:
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


def _ends(found: Parts, parts: Sequence[ClipPart]) -> list[Edit]:
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


def _where(found: Parts, part: ClipPart) -> str:
    from_s, to_s = _ends_s(found, part.span)
    grid = found.grids[part.place.grid]
    began = moment(grid, part.place.lag_s + from_s)
    name = f" in {grid.name}" if len(found.grids) > 1 else ""
    return f"{from_s:.0f} to {to_s:.0f} s of the clip fit from {began} on{name}"


def _ends_s(found: Parts, span: Span) -> tuple[float, float]:
    """Return the begin and end of a span of phases, in seconds of the clip."""
    clip, half = found.clip, found.clip.hop_s / 2
    return float(clip.t_s[span[0]] - half), float(clip.t_s[span[1] - 1] + half)

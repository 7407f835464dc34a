"""Re-examines a finding for usual mistakes: an edited clip, wrong speed, wrong reference step.

Each mistake found is named with its remedy; it never turns a finding into a match. For speed and
step, up to 120 s from the middle of the clip are searched for again under the assumed mistake.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from rsenf.match.calibration import calibration
from rsenf.match.clip_phase import ClipPhase, clip_phase
from rsenf.match.matcher import Finding, claimed_lag_s, moment
from rsenf.match.parts import LEAST, Part, Parts
from rsenf.match.phase import weigh
from rsenf.match.phase_scorer import PhaseScorer
from rsenf.match.phase_search import PhaseSearch, Place, refined, search_phase
from rsenf.match.series import Grid, Track
from rsenf.match.settings import MatchSettings
from rsenf.match.splice_detection import assembled
from rsenf.messages import Edit

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
    grid = grids[best.grid]
    clock = found.scorers[best.grid].clock(best.lag_s)
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
        others = [
            replace(grid, step_s=step_s)
            for grid in grids
            if not grid.t0_ns and grid.step_s != step_s and step_s * grid.freq_hz.size > STRETCH_S
        ]
        found = search_phase(part, clip, others, settings)
        if _sure(found, settings):
            best = found.places[0]
            text = (
                f"with a step of {step_s:g} s instead of {grids[0].step_s:g} s the reference would "
                f"fit, {best.lag_s:.1f} s into it: is the step wrong?"
            )
            yield SpeedHypothesis(others[best.grid], best.lag_s, Edit(kind="step", text=text))


def _sure(found: PhaseSearch, settings: MatchSettings) -> bool:
    if not found.places:
        return False
    # The search tolerates bad blocks, so a wrong time may fit part of an edited clip. Here the clip
    # must fit as a whole too.
    best = found.places[0]
    scorer = found.scorers[best.grid]
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
    """Look for edits and mistakes in a clip or a reference, and withdraw what they make uncertain.

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
        begins_at = first.place.lag_s if first.span[0] < LEAST else math.nan
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
    finding: Finding, parts: Sequence[Part], grids: Sequence[Grid], tolerance_s: float
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

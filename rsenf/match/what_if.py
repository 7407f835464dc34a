"""What if the clip were played at another speed, or the reference's step were another?

A clip that fits nowhere is searched for again under the usual mistakes: a stretch of it that is
long enough to tell. What fits then is named, with its cure; it decides nothing.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from rsenf.match.calibration import calibration
from rsenf.match.clip_phase import ClipPhase, clip_phase
from rsenf.match.matcher import moment
from rsenf.match.phase import weigh
from rsenf.match.phase_search import PhaseScorer, PhaseSearch, refined, search_phase
from rsenf.match.series import Grid, Track
from rsenf.match.settings import MatchSettings
from rsenf.messages import Edit

STRETCH_S = 120.0  # of the clip
STEPS_S = (0.1, 0.5, 1.0, 2.0)  # of references, mostly
# Of clock errors that are no camera's: frame rates of 30 and 29.97 that are taken for each other
# make one of 1000 ppm.
SPEED_SCALE_PPM = 1000.0
LEAST_PPM = 200.0  # that aren't a camera's


@dataclass(frozen=True, eq=False)
class Supposition:
    """Where a clip would fit, were a mistake made, and that mistake."""

    grid: Grid
    lag_s: float
    mistake: Edit


def what_fits(track: Track, grids: Sequence[Grid], settings: MatchSettings) -> Supposition | None:
    """Find a mistake under which a clip fits after all."""
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
) -> Supposition | None:
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
    return Supposition(grid, best.lag_s, mistake)


def _other_steps(
    part: Track, clip: ClipPhase, grids: Sequence[Grid], settings: MatchSettings
) -> Iterator[Supposition]:
    """Try other steps of references without times: where there are times, they tell the step."""
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
            yield Supposition(others[best.grid], best.lag_s, Edit(kind="step", text=text))


def _sure(found: PhaseSearch, settings: MatchSettings) -> bool:
    if not found.places:
        return False
    # Much of it may be bad; but of an edited clip a wrong time fits some, so all must fit a little.
    best = found.places[0]
    scorer = found.scorers[best.grid]
    whole = PhaseScorer(scorer.clip, scorer.grid, scorer.settings, robust=False)
    if refined(whole, best).weight < math.log(max(found.span_s, 1.0)):
        return False
    raw, lines = weigh(found), calibration()
    return min(lines.other(raw.other), lines.absent(raw.absent)) >= settings.min_log10_lr

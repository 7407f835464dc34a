"""One picture of a comparison: spectrogram, ENF over the reference, score against lag."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from pathlib import Path

from rsenf.match.jumps import without_jumps
from rsenf.match.lag_scores import lag_scores
from rsenf.match.series import Grid, Track, grid_of, track_of
from rsenf.match.settings import MatchSettings
from rsenf.messages import EnfEstimate, MatchResult, ReferenceBlock
from rsenf.report.panels import INK, fixed_style, new_figure
from rsenf.report.panels.enf import draw_enf
from rsenf.report.panels.score import draw_score
from rsenf.report.panels.spectrogram import draw_spectrogram
from rsenf.report.score_curve import ScoreCurve, no_curve, score_curve
from rsenf.report.spectrum import ThinRows
from rsenf.report.verdict import headline
from rsenf.whole_file import whole_file


def draw(
    path: Path,
    rows: ThinRows,
    estimates: Sequence[EnfEstimate],
    reference: Sequence[ReferenceBlock],
    result: MatchResult,
) -> None:
    """Draw the picture into a PNG file, which appears only when it is complete.

    Parameters
    ----------
    path : Path
        File to write; replaced when it is there.
    rows : ThinRows
        What the spectrogram is made of.
    estimates : sequence of EnfEstimate
        The recording's ENF.
    reference : sequence of ReferenceBlock
        What it was compared with.
    result : MatchResult
        What came of it.

    Raises
    ------
    RecordingError
        When the file can't be written.
    """
    track = without_jumps(track_of(estimates))[0] if estimates else None
    grid = grid_of(reference) if reference else None
    curve = curve_of(track, grid, MatchSettings(), result)
    with fixed_style(), whole_file(path) as temporary:
        figure = new_figure(10, 10)
        top, middle, bottom = figure.subplots(3, 1)
        figure.suptitle(textwrap.fill(headline(result), 100), color=INK, fontsize="medium")
        draw_spectrogram(top, rows, estimates)
        draw_enf(middle, track, grid, result)
        draw_score(bottom, curve, grid.t0_ns if grid else 0, result)
        figure.savefig(temporary, format="png", dpi=110)


def curve_of(
    track: Track | None, grid: Grid | None, settings: MatchSettings, result: MatchResult
) -> ScoreCurve:
    """Return the scores behind a result; an empty curve where nothing could be compared."""
    if track is None or grid is None or not math.isfinite(result.lag_s):
        return no_curve()
    first_s = -track.first_s - track.enf_hz.size * track.hop_s
    pieces = lag_scores(track, grid, settings, result.lag_s)
    return score_curve(pieces, first_s, grid.duration_s, result.lag_s)

"""The picture of a comparison: spectrogram, ENF over the reference, and score against lag."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from pathlib import Path

from rsenf.match.correlate import lag_scores
from rsenf.match.series import Grid, Track, grid_of, track_of, without_jumps
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
    """Draw the picture into a PNG file, which appears only once it is complete.

    Parameters
    ----------
    path : Path
        File to write; an existing one is replaced.
    rows : ThinRows
        Data of the spectrogram.
    estimates : sequence of EnfEstimate
        The recording's ENF.
    reference : sequence of ReferenceBlock
        The grid frequency that it was compared with.
    result : MatchResult
        Result of the comparison.

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
    """Return the scores behind a result; an empty curve if nothing could be compared.

    Parameters
    ----------
    track, grid : Track or None, Grid or None
        ENF of the recording and of the reference.
    settings : MatchSettings
    result : MatchResult
    """
    if track is None or grid is None or not math.isfinite(result.lag_s):
        return no_curve()
    first_s = -track.first_s - track.enf_hz.size * track.hop_s
    pieces = lag_scores(track, grid, settings, result.lag_s)
    return score_curve(pieces, first_s, grid.duration_s, result.lag_s)

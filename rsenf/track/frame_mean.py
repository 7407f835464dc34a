"""Global-shutter ENF: one mean per frame, read at the alias of the illumination frequency.

R. Garg, A. L. Varna, M. Wu, "Seeing ENF: natural time stamp for digital video via optical sensing
and signal processing", ACM Multimedia 2011; the first of the methods that the paper's Section II
names. All steady pixels of a frame are averaged. A frame rate below twice the illumination
frequency folds it to the alias ``k·f_0 − n·F_r``, where the spectrum is read, here in the same
windows as the paper's own estimator. Under a global shutter that is all there is; under a rolling
shutter the rows' phases differ and most of the flicker averages out.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from rsenf.flicker.lines import Line
from rsenf.messages import EnfEstimate, RowBlock
from rsenf.track.alias import check_line, is_folded, why_nothing
from rsenf.track.settings import TrackSettings
from rsenf.track.sliding import NO_FLICKER, Window
from rsenf.track.stft import StftTracker
from rsenf.track.window import LineFit


class FrameMeanTracker(StftTracker):
    """Frame means at the alias. Takes blocks of rows, or of one mean per frame.

    No estimate where the alias is near 0 Hz or half the frame rate.

    Raises
    ------
    UsageError
        If the settings name a line.
    """

    name = "frame_mean"
    help = "reads one mean per frame at the alias (Garg 2011)"

    def __init__(self, settings: TrackSettings | None = None) -> None:
        super().__init__(settings)
        check_line(self.settings, self.name)

    def _candidates(self, nominal_hz: float, frame_rate_hz: float, rows: int) -> tuple[Line, ...]:
        return super()._candidates(nominal_hz, frame_rate_hz, 1)

    def _prepare(self, first: RowBlock, frame_rate_hz: float) -> int:
        return super()._prepare(_frame_means(first), frame_rate_hz)

    def _reduce(self, block: RowBlock) -> NDArray[np.complex128]:
        return super()._reduce(_frame_means(block))

    def _is_faint(self, amplitude: float, line: Line, offset_hz: float) -> bool:
        """Never: the rows' phases average out, so that the residue says nothing of the light."""
        return False

    def _why_unusable(self, fit: LineFit, rate_hz: float) -> str:
        if is_folded(fit.line, rate_hz, self._finder.search_hz):
            return why_nothing((fit.line,), rate_hz, self._finder.search_hz)
        return super()._why_unusable(fit, rate_hz)

    def _judge(self, window: Window, blank: EnfEstimate) -> EnfEstimate:
        found = super()._judge(window, blank)
        if found.reason != NO_FLICKER:
            return found
        why = why_nothing(self._lines, window.frame_rate_hz, self._finder.search_hz)
        return dataclasses.replace(found, reason=why)


def _frame_means(block: RowBlock) -> RowBlock:
    """Average the rows and strips of a block; unsteady places count as their background."""
    if block.frames == 0:
        return block
    mean = block.level.mean(axis=(1, 2), dtype=np.float64)
    return dataclasses.replace(
        block,
        read_out_axis="frame",
        rows=1,
        strips=1,
        level=mean.astype(np.float32)[:, None, None],
        kept_px=np.array([[block.kept_px.sum()]], np.uint32),
    )

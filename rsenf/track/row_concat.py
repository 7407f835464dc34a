"""ENF from the rows of all frames, concatenated without an idle period, at ``f_0`` itself.

H. Su, A. Hajj-Ahmad, R. Garg, M. Wu, "Exploiting rolling shutter for ENF signal extraction from
video", ICIP 2014; the second of the methods that the paper's Section II names. The row means of one
frame follow those of the frame before without a gap, at ``F_r·L`` samples/s, and the spectrum is
read at the harmonic's own frequency. What the idle period moves to other lines ``k·f_0 + m·F_r``
(paper, Eq. 21) is lost: at 29.97 fps, 100 Hz and 30 % idle the line at ``f_0`` vanishes.
"""

from __future__ import annotations

import dataclasses

from rsenf.flicker.lines import Line
from rsenf.messages import EnfEstimate
from rsenf.track.alias import check_line
from rsenf.track.settings import TrackSettings
from rsenf.track.sliding import Window
from rsenf.track.stft import StftTracker


class RowConcatTracker(StftTracker):
    """The sliding STFT at ``f_0``, even if another line is stronger. Needs rows.

    Raises
    ------
    UsageError
        If the settings name another line.
    """

    name = "row_concat"
    help = "reads the rows of all frames, concatenated without idle period (Su 2014)"

    def __init__(self, settings: TrackSettings | None = None) -> None:
        super().__init__(settings)
        check_line(self.settings, self.name)

    def _candidates(self, nominal_hz: float, frame_rate_hz: float, rows: int) -> tuple[Line, ...]:
        return (Line(nominal_hz, self.settings.harmonic, 0),)

    def _judge(self, window: Window, blank: EnfEstimate) -> EnfEstimate:
        if self._rows == 1:
            return dataclasses.replace(blank, reason="one mean per frame: no rows to concatenate")
        return super()._judge(window, blank)

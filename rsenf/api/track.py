"""Estimates the ENF of a recording, one value a second."""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from typing_extensions import TypedDict

from rsenf.api.shared import (
    Progress,
    Recording,
    Result,
    opened,
    read_only,
    row_settings,
    silent,
    table,
    track_settings,
)
from rsenf.flicker.frame_rate import GIVE_RATE, IS_IT_WRONG, likely
from rsenf.flicker.frame_slips import FrameSlip, slip_words
from rsenf.flicker.lines import alias_hz
from rsenf.idle.estimator_state import STILL_HZ
from rsenf.messages import EnfEstimate, RateHypothesis
from rsenf.report.values import number
from rsenf.rows.settings import RowsSettings
from rsenf.run.inline import Analysis, analyse
from rsenf.track import TrackSettings

if TYPE_CHECKING:
    import pandas

    from rsenf.messages.schema import FloatArray

# Relative error of a frequency if 30 and 29.97 frames/s are mistaken for each other, on a grid that
# deviates a little.
NTSC_RATIO = 0.85e-3, 1.15e-3
HEADING = " t (s)   ENF (Hz)   ± mHz  SNR (dB)"


def track(
    recording: Recording,
    *,
    frame_time_s: ArrayLike | None = None,
    frame_rate_hz: float | None = None,
    camera: str = "",
    begin: str = "rows",
    method: str | None = None,
    nominal_hz: float | None = None,
    rows: RowsSettings | None = None,
    settings: TrackSettings | None = None,
    progress: Progress = silent,
    on_estimate: Callable[[EnfEstimate], None] = silent,
) -> TrackResult:
    """Estimate the ENF of a recording.

    Parameters
    ----------
    recording : path, Input or array_like
        Video, ``.mcap`` recording or ``.npz``; or luminance: (frames,), (frames, rows) or
        (frames, rows, strips).
    frame_time_s : array_like (frames,), optional
        For arrays: start of each frame, in seconds.
    frame_rate_hz : float, optional
        For arrays with regular frames; for a file, in place of missing or wrong times.
    camera : str
        Camera of an ``.mcap`` recording that holds several.
    begin : {'rows', 'frames', 'track'}
        What to use of an ``.mcap`` recording: its rows, its video again, or its estimates.
    method : str, optional
        A name of :data:`rsenf.track.METHODS`; ``projection`` by default.
    nominal_hz : float, optional
        50 or 60; found from the data when not given.
    rows : RowsSettings, optional
    settings : TrackSettings, optional
        In place of ``method``.
    progress : callable, optional
        Called with the seconds of the recording that are done.
    on_estimate : callable, optional
        Called with each estimate as it comes.

    Raises
    ------
    UsageError
        If there is no such file or method, or an argument is invalid.
    InputError
        If the recording holds nothing that can be analysed.

    Examples
    --------
    >>> import rsenf
    >>> clip = rsenf.simulate(duration_s=20, seed=3, size=(64, 48), frame_rate=25)
    >>> found = rsenf.track(clip.rows, frame_time_s=clip.frame_time_s)
    >>> found.enf_hz.shape, bool(found.usable.all())
    ((20,), True)
    >>> bool(abs(found.enf_hz - clip.enf_hz).max() < 0.01)
    True
    """
    given = settings or {"method": method}
    tracked = track_settings(given, nominal_hz=nominal_hz)
    source = opened(recording, frame_time_s, frame_rate_hz, camera, begin)

    def tap(topic: str, message: Any) -> None:
        if topic == "track" and message.rank == 0:
            on_estimate(message)

    sampling = row_settings(rows, tracked)
    analysis = analyse(source, rows=sampling, track=tracked, progress=progress, tap=tap)
    return track_result(source.called, analysis, tracked.nominal_hz)


class EstimateJson(TypedDict):
    """A line of ``rsenf track --json``; TrackResult explains its keys."""

    t_s: float
    enf_hz: float | None
    enf_std_hz: float | None
    snr_db: float | None
    usable: bool
    reason: str
    epoch: int
    mirror_hz: float | None
    slips: list[dict[str, int]]


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class TrackResult(Result):
    """The ENF of a recording; all arrays are of shape (seconds,).

    Attributes
    ----------
    t_s : ndarray of float
        Time from the first frame to the centre of the interval that the value covers.
    enf_hz, enf_std_hz : ndarray of float
        Grid frequency and its standard error; NaN where there is none.
    snr_db : ndarray of float
    usable : ndarray of bool
    reason : ndarray of str
        Why a value isn't usable; '' where it is.
    epoch : ndarray of int
        Number of the epoch of a source that restarted.
    mirror_hz : ndarray of float
        ENF that ``enf_hz`` is mirrored about if the read-out runs the other way than assumed: where
        the light's alias is at 0 Hz its direction is unknown. NaN where it is known.
    slips : list of FrameSlip
        Lost or repeated frames that the time stamps don't show; the ENF is corrected for them, and
        seconds are of true time.
    camera_hz : float or None
        Original frame rate, if frames were dropped or repeated to convert it.
    warnings : list of str
    rate_hypotheses : tuple of RateHypothesis
        Frame rates that fit the light, the likeliest first; empty if the rate is known.
    """

    t_s: FloatArray
    enf_hz: FloatArray
    enf_std_hz: FloatArray
    snr_db: FloatArray
    usable: NDArray[np.bool_]
    reason: NDArray[np.str_]
    epoch: NDArray[np.int64]
    mirror_hz: FloatArray
    slips: list[FrameSlip]
    camera_hz: float | None
    warnings: list[str]
    rate_hypotheses: tuple[RateHypothesis, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return ``estimates``, the lines of ``rsenf track --json``, and what concerns them all."""
        return {
            "estimates": [estimate_json(estimate) for estimate in self.analysis.estimates],
            "slips": [dataclasses.asdict(slip) for slip in self.slips],
            "camera_hz": self.camera_hz,
            "warnings": self.warnings,
            "rate_hypotheses": [dataclasses.asdict(h) for h in self.rate_hypotheses],
        }

    def to_pandas(self) -> pandas.DataFrame:
        """Return a row for each value, indexed by ``t_s``."""
        names = [name for name in EstimateJson.__annotations__ if name != "slips"]
        return table({name: getattr(self, name) for name in names}, "t_s")

    @property
    def summary(self) -> str:
        """The result in one line."""
        estimates, seconds = self.analysis.estimates, self.analysis.seconds
        usable = [e for e in estimates if e.usable]
        if not usable:
            # Faults of the rows themselves explain best why no window is usable.
            reason = _most_frequent(self.analysis.row_reasons)
            reason = reason or _most_frequent(Counter(e.reason for e in estimates))
            if not reason:
                return f"too short to tell: {seconds:.1f} s of video"
            return f"no usable signal in {seconds:.0f} s of video: {reason}"
        last = usable[-1]
        return (
            f"{len(usable)} of {len(estimates)} values usable; {last.nominal_hz:.0f} Hz grid, "
            f"harmonic {last.harmonic} on the line at {last.line_hz:.1f} Hz, "
            f"{self.analysis.frame_rate_hz:.3f} frames/s"
        )

    def __str__(self) -> str:
        lines = [HEADING] if self.t_s.size else []
        return "\n".join([*lines, *map(estimate_words, self.analysis.estimates)])

    def __repr__(self) -> str:
        return f"<TrackResult of {self.recording}: {self.summary}>"


def estimate_json(estimate: EnfEstimate) -> EstimateJson:
    """Return an estimate as a line of ``rsenf track --json``."""
    return EstimateJson(
        t_s=round(estimate.t_s, 6),
        enf_hz=number(estimate.enf_hz),
        enf_std_hz=number(estimate.enf_std_hz),
        snr_db=number(estimate.snr_db),
        usable=estimate.usable,
        reason=estimate.reason,
        epoch=estimate.header.epoch,
        mirror_hz=number(estimate.mirror_hz or math.nan),
        slips=[dataclasses.asdict(slip) for slip in _slips(estimate)],
    )


def estimate_words(estimate: EnfEstimate) -> str:
    """Return an estimate as a line of the table under :data:`HEADING`."""
    if not estimate.usable:
        return f"{estimate.t_s:6.1f}          –       –         –   {estimate.reason}"
    values = f"{estimate.enf_hz:10.5f} {1e3 * estimate.enf_std_hz:7.2f} {estimate.snr_db:9.1f}"
    return f"{estimate.t_s:6.1f} {values}"


def track_result(name: str, analysis: Analysis, given_hz: float | None = None) -> TrackResult:
    """Return the estimates of an analysis as arrays; ``given_hz`` is the nominal if not found."""
    estimates = analysis.estimates
    slips = [slip for estimate in estimates for slip in _slips(estimate)]
    camera_hz = next((e.frame_rate_hz for e in estimates if e.converted), None)

    is_read = any(e.usable for e in estimates)
    rates = () if is_read or not estimates else estimates[-1].rate_hypotheses

    def column(values: list[Any], dtype: Any = np.float64) -> NDArray[Any]:
        return read_only(np.array(values, dtype))

    return TrackResult(
        recording=name,
        analysis=analysis,
        t_s=column([e.t_s for e in estimates]),
        enf_hz=column([e.enf_hz for e in estimates]),
        enf_std_hz=column([e.enf_std_hz for e in estimates]),
        snr_db=column([e.snr_db for e in estimates]),
        usable=column([e.usable for e in estimates], np.bool_),
        reason=column([e.reason for e in estimates], np.str_),
        epoch=column([e.header.epoch for e in estimates], np.int64),
        mirror_hz=column([e.mirror_hz or math.nan for e in estimates]),
        slips=slips,
        camera_hz=camera_hz,
        warnings=[
            *analysis.warnings,
            *slip_words(slips, camera_hz),
            *_grid_words([e for e in estimates if e.usable and not e.converted], given_hz),
            *_direction_words([e.mirror_hz for e in estimates if e.usable]),
            *([f"{IS_IT_WRONG} There is light of {likely(rates)}; {GIVE_RATE}"] if rates else []),
            *_rate_words([e.enf_hz / e.nominal_hz for e in estimates if e.usable]),
        ],
        rate_hypotheses=rates,
    )


def _rate_words(ratio: list[float]) -> list[str]:
    """Warn of a wrong frame rate if the ENF deviates as the rates of 30 and 29.97 do."""
    low, high = NTSC_RATIO
    if not ratio or not low < abs(float(np.median(ratio)) - 1.0) < high:
        return []
    return [
        "the ENF is off its nominal by 0.1 %, as where 30 frames/s are taken for 29.97: check the "
        "frame rate"
    ]


def _grid_words(estimates: list[EnfEstimate], given_hz: float | None) -> list[str]:
    """Warn that the grid is assumed, by the frame rate, where the light stands still at it."""
    still = [e for e in estimates if abs(alias_hz(2.0 * e.nominal_hz, e.frame_rate_hz)) < STILL_HZ]
    if given_hz or not still:
        return []
    return [
        "light stands still at this frame rate, as that of a "
        f"{still[-1].nominal_hz:.0f} Hz grid does: if the film was converted from another rate, "
        "the grid may be another one (--nominal-hz says which)"
    ]


def _direction_words(mirror_hz: list[float]) -> list[str]:
    """Warn that the sign of the ENF's deviation is assumed, if it is."""
    either = [hz for hz in mirror_hz if hz]
    if not either:
        return []
    return [
        "the direction of read-out can't be told at this frame rate, and with it the sign of the "
        f"ENF's deviation: if it isn't as assumed, the ENF is mirrored about {either[-1]:.4f} Hz"
    ]


def _most_frequent(reasons: Counter[str]) -> str:
    """Return the most frequent reason; '' if there is none."""
    return next((reason for reason, _ in reasons.most_common(1)), "")


def _slips(estimate: EnfEstimate) -> list[FrameSlip]:
    pairs = zip(estimate.slip_frame.tolist(), estimate.slip_frames.tolist(), strict=True)
    return [FrameSlip(number, frames) for number, frames in pairs]

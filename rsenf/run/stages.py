"""The stages of the pipeline: inputs, outputs, and how each is built from its settings.

Node kinds, the one-process run and regression all build them here.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

from rsenf.stage import ALONE, Stage, StageContext, StageSpec

if TYPE_CHECKING:
    from rsenf.discrepancy.settings import WatchSettings
    from rsenf.flicker.follower import Follower
    from rsenf.idle.estimator_state import IdleSettings
    from rsenf.messages import Header
    from rsenf.model import CaptureModel
    from rsenf.rows.settings import RowsSettings
    from rsenf.track.method import TrackSettings


def rows_stage(settings: RowsSettings) -> StageSpec:
    """Stage from frames to the row means of their steady pixels."""

    def make() -> Stage:
        from rsenf.rows.stage import Rows  # imports OpenCV: 40 ms

        if settings.read_out_axis != "auto":
            return Rows(settings)
        from rsenf.flicker.acquire import find_axis
        from rsenf.rows.stage import AutoRows

        return AutoRows(settings, find_axis)

    return StageSpec(("rows",), ("frames",), make)


def flicker_stages(
    track: TrackSettings | None, idle: IdleSettings | None, context: StageContext = ALONE
) -> list[StageSpec]:
    """Stages from rows to the ENF, to the idle period, or to both.

    Parameters
    ----------
    track, idle : TrackSettings or None, IdleSettings or None
        None omits the stage. Two stages share one flicker follower if their settings allow it and
        ``context.is_shared``; the results are the same.
    context : StageContext, optional
    """
    pairs = _pairs(track, idle) if track and idle and context.is_shared else None

    def tracker(settings: TrackSettings) -> Stage:
        from rsenf.track import make_tracker

        return make_tracker(settings, next(pairs) if pairs else None)

    def estimator(settings: IdleSettings) -> Stage:
        from rsenf.idle import make_idle

        return make_idle(settings, next(pairs) if pairs else None)

    found = []
    if track is not None:
        found.append(StageSpec(("track",), ("rows",), functools.partial(tracker, track)))
    if idle is not None:
        found.append(
            StageSpec(("idle",), ("rows",), functools.partial(estimator, idle), shown="idle")
        )
    return found


def match_stage(make: Callable[[], Stage]) -> StageSpec:
    """Stage from the ENF and a grid's reference to the time of recording."""
    return StageSpec(("match",), ("track", "reference"), make)


def live_stage(make: Callable[[], Stage], silent_s: float = math.inf) -> StageSpec:
    """Stage from rows, ENF, idle period and a reference to verdicts on liveness, and alarms.

    Parameters
    ----------
    make : callable
        Builds the stage.
    silent_s : float
        Seconds without rows after which the stage is told.
    """

    def silence(header: Header) -> Any:
        from rsenf.live import Silence

        return Silence(header)

    return StageSpec(
        ("live", "alarm"),
        ("rows", "track", "idle", "reference"),
        make,
        optional=("idle",),
        shown="live",
        silent_s=silent_s,
        on_silence=silence,
    )


def discover_stage(settings: WatchSettings, model: str | None, context: StageContext) -> StageSpec:
    """Stage from rows to effects that a model of the camera lacks, and to changes.

    Parameters
    ----------
    settings : WatchSettings
    model : str or None
        Model file to start from; None for a plain lamp and camera.
    context : StageContext
        Tells the stage to skip work, and runs its long computations.
    """

    @functools.cache  # every epoch starts from the same model
    def given() -> CaptureModel:
        from rsenf.config.schemas import load_model
        from rsenf.discrepancy.start import PLAIN

        return load_model(model) if model else PLAIN

    def make() -> Stage:
        from rsenf.discrepancy.watch import WatchStage

        return WatchStage(settings, given(), is_behind=context.is_behind, run=context.run)

    return StageSpec(("discover",), ("rows",), make, shown="discover")


def _pairs(track: TrackSettings, idle: IdleSettings) -> Iterator[Follower | None]:
    """Yield flicker followers for the tracker and the idle estimator of each epoch in turn.

    The two of an epoch are fed the same rows, and share the work if they would follow the flicker
    with the same settings; else it is None for each.
    """
    from rsenf.flicker.follower import FlickerFollower, shared

    while True:
        yield from shared(FlickerFollower(idle.nominal_hz)) if _alike(track, idle) else (None, None)


def _alike(track: TrackSettings, idle: IdleSettings) -> bool:
    from rsenf.flicker.acquire import MIN_SNR
    from rsenf.track import METHODS

    same = track.nominal_hz == idle.nominal_hz and track.min_snr == MIN_SNR
    return same and METHODS.find(track.method).shares_follower

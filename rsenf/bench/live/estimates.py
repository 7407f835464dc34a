"""A feed's rows through the trackers, kept on the disk: the dear part of watching one."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from rsenf.bench.live.plan import Feed
from rsenf.idle import IdleSettings, make_idle
from rsenf.messages import EnfEstimate, IdleEstimate, RowBlock
from rsenf.record.reader import open_recording
from rsenf.record.writer import Recorder
from rsenf.stage import Stage
from rsenf.track import TrackSettings, make_tracker
from rsenf.whole_file import whole_file

IDLE_EVERY_S = 30.0  # as often as usual it would cost as much as all the rest

Estimate = EnfEstimate | IdleEstimate


def estimates_of(
    feed: Feed, blocks: Sequence[RowBlock], nominal_hz: float, folder: Path | None
) -> list[Estimate]:
    """Return the estimates of a feed's ENF and idle ratio, from the disk where they are there.

    Parameters
    ----------
    feed : Feed
    blocks : sequence of RowBlock
        Its rows.
    nominal_hz : float
        Of its grid.
    folder : Path or None
        Where estimates are kept; without one they aren't.

    Raises
    ------
    RecordingError
        When they can't be written.
    """
    if folder is None:
        return list(_tracked(blocks, nominal_hz))
    path = folder / f"{feed.key}.mcap"
    if not path.is_file():
        folder.mkdir(parents=True, exist_ok=True)
        with (
            whole_file(path) as temporary,
            Recorder(temporary, run_info={}, clock_ns=time.time_ns, fsync=False) as recorder,
        ):
            for estimate in _tracked(blocks, nominal_hz):
                recorder.write("track" if isinstance(estimate, EnfEstimate) else "idle", estimate)
    return [message for _, message, _ in open_recording(path).messages()]


def _tracked(blocks: Sequence[RowBlock], nominal_hz: float) -> Iterator[Any]:
    """Yield what the stages say, stamped with the arrival of the rows that completed it.

    What only the end of a stream brings out never reaches a monitor that watches it.
    """
    stages: tuple[Stage, ...] = (
        make_tracker(TrackSettings(nominal_hz=nominal_hz)),
        make_idle(IdleSettings(nominal_hz=nominal_hz, every_s=IDLE_EVERY_S)),
    )
    for block in blocks:
        for stage in stages:
            for estimate in stage.update(block):
                arrived_ns = block.header.arrival_time_ns
                header = dataclasses.replace(estimate.header, arrival_time_ns=arrived_ns)
                yield dataclasses.replace(estimate, header=header)

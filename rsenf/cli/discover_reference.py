"""``rsenf discover --reference``: what the grid's own frequency tells of a recording."""

from __future__ import annotations

import argparse
import dataclasses
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rsenf.discrepancy import GridDiscovery
    from rsenf.match.series import Grid
    from rsenf.messages import EnfEstimate, RowBlock
    from rsenf.messages.schema import FloatArray
    from rsenf.model import CaptureModel
    from rsenf.model.scene import Float32Array
    from rsenf.run.inline import Analysis
    from rsenf.track import TrackSettings

FRAME_MEANS = "frame_mean"  # the tracker of such data


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments that name a reference."""
    from rsenf.cli.console import add_reference_arguments

    parser.add_argument(
        "--reference", nargs=1, metavar="REF",
        help="the grid's frequency meanwhile: CSV, Parquet, WAV of the mains, or store:GRID",
    )  # fmt: skip
    parser.add_argument("--store", metavar="DIR", help="where store:GRID is looked for")
    add_reference_arguments(parser)


def reference_of(args: argparse.Namespace) -> Grid | None:
    """Open the reference, if one is named."""
    from rsenf.cli.references import grids_of, open_references

    return grids_of(open_references(args))[0] if args.reference else None


def holds_frame_means(args: argparse.Namespace) -> bool:
    """Whether the input has one mean for each frame."""
    from rsenf.run.inputs import open_input_file

    recording = open_input_file(args.input, camera=args.camera)
    if recording.begins_with != "rows":
        return False
    first = next(iter(recording.messages()), None)
    return first is not None and first.read_out_axis == "frame"


def frame_means_settings(args: argparse.Namespace, grid: Grid) -> TrackSettings:
    """Return the tracker's settings for one mean a frame."""
    from rsenf.track import TrackSettings

    return TrackSettings(method=FRAME_MEANS, nominal_hz=args.nominal_hz or grid.nominal_hz)


def by_reference(
    model: CaptureModel,
    blocks: Sequence[RowBlock],
    analysis: Analysis,
    grid: Grid,
    settings: TrackSettings,
) -> GridDiscovery:
    """Run the workflow on the estimates of a recording beside a reference.

    Raises
    ------
    InputError
        When there is nothing to compare, or the reference doesn't cover the recording.
    """
    from rsenf.cli.console import note
    from rsenf.discrepancy import Film, beside_of, discover_grid
    from rsenf.discrepancy.measured import frame_rate_of
    from rsenf.errors import InputError
    from rsenf.messages import Header
    from rsenf.rows.luminance import blocks_from_luminance
    from rsenf.timebase import NS_PER_S
    from rsenf.track import make_tracker

    if sum(block.frames for block in blocks) < 2:
        raise InputError("no frame can be read", "give a recording of mains light")
    stamps = np.concatenate([block.frame_pts_ns for block in blocks])
    stamp_s = (stamps - stamps[0]) / NS_PER_S
    axis, rate = blocks[0].read_out_axis, frame_rate_of(stamp_s)

    def track(times_s: FloatArray, level: Float32Array) -> list[EnfEstimate]:
        tracker = make_tracker(settings)
        made = blocks_from_luminance(level, times_s, Header(), read_out_axis=axis)
        estimates = [e for block in made for e in tracker.update(block)] + tracker.flush()
        return [e for e in estimates if e.rank == 0]

    film = Film(track, float(stamp_s[-1]) + 1.0 / float(rate), axis == "frame")
    model = dataclasses.replace(model, shutter=dataclasses.replace(model.shutter, frame_rate=rate))
    estimates = [e for e in analysis.estimates if e.header.epoch == blocks[0].header.epoch]
    note("looking for the recording in the reference")
    return discover_grid(model, beside_of(film, model, estimates, grid), note)


def residuals_of(found: GridDiscovery) -> dict[str, FloatArray]:
    """Return what is left of the ENF before and after, with its times."""
    return {
        "enf_time_s": found.beside.t_s,
        "enf_before_hz": found.first.left_hz,
        "enf_after_hz": found.last.left_hz,
    }

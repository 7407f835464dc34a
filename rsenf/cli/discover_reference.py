"""``rsenf discover --reference``: what the grid's own frequency tells of a recording."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from rsenf.discrepancy.beside import BesideDiscovery
    from rsenf.match.series import Grid
    from rsenf.messages import RowBlock
    from rsenf.model import CaptureModel


@dataclass(frozen=True, eq=False)
class Result:
    """What a folder gets, and what is said of it.

    Attributes
    ----------
    told : dict
        As JSON.
    model : CaptureModel
        The extended one.
    page : str
        The report.
    residuals : dict of ndarray
        What is left, before and after.
    note : str
        What else to know; or nothing.
    """

    told: dict[str, Any]
    model: CaptureModel
    page: str
    residuals: dict[str, NDArray[Any]]
    note: str = ""


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
    if not args.reference:
        return None
    from rsenf.cli.references import grids_of, open_references

    return grids_of(open_references(args))[0]


def by_frame_means(
    args: argparse.Namespace,
    model: CaptureModel,
    blocks: Sequence[RowBlock],
    grid: Grid,
    progress: Callable[[str], None],
) -> Result:
    """Discover beside a reference alone.

    Raises
    ------
    InputError
        When there is nothing to compare, or the reference doesn't cover the recording.
    """
    from rsenf.cli.discover import MODEL
    from rsenf.discrepancy.beside import (
        beside_json,
        beside_model,
        beside_of,
        clip_of_frame_means,
        discover_beside,
    )
    from rsenf.report.discovery_page import beside_page

    name, nominal_hz = Path(args.input).name, args.nominal_hz or grid.nominal_hz
    progress("looking for the recording in the reference")
    laid = beside_of(clip_of_frame_means(blocks, nominal_hz), grid)
    found = discover_beside(model, laid, progress)
    told, extended = beside_json(found, str(args.out / MODEL)), beside_model(found, name)
    page = beside_page(found, told, name, extended)
    return Result(told, extended, page, residuals_of(found))


def residuals_of(found: BesideDiscovery) -> dict[str, NDArray[Any]]:
    """Return what is left of the ENF before and after, with its times."""
    return {
        "enf_time_s": found.beside.t_s,
        "enf_before_hz": found.first.left_hz,
        "enf_after_hz": found.last.left_hz,
    }

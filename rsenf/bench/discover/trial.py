"""A case simulated, as rows or video, given to the workflow, and compared with its truth.

Of some cases the written model is simulated again; the result must be without a discrepancy.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import yaml

from rsenf.api.recordings import read_recording
from rsenf.bench.discover.judge import answered, judged, parameter_error, recorded
from rsenf.bench.discover.plan import OUTSIDE, Case, done_to
from rsenf.bench.discover.scene import Drawn, drawn
from rsenf.config.schemas import load_model
from rsenf.discrepancy.measured import Float32Array, Measured, measured_of
from rsenf.discrepancy.result import discovery_json, model_of
from rsenf.discrepancy.verdict import Discovery, discover
from rsenf.messages import Header, RowBlock
from rsenf.model import GridPath, render_frames, simulate_rows
from rsenf.model.codec import Codec
from rsenf.model.seeds import generator
from rsenf.model.video_file import write_video
from rsenf.rows.luminance import blocks_from_luminance
from rsenf.rows.settings import RowsSettings
from rsenf.run.recoded import is_lossy, recoded

CODECS = {"lossless": Codec(lossless=True), "x264 4 Mb/s": Codec(bitrate_bps=4_000_000)}
ROWS = RowsSettings(strips=4)  # as ``rsenf discover`` samples a video


def codec_of(case: Case) -> str:
    """Return the name of a case's codec, by seed in turn; empty of rows."""
    return tuple(CODECS)[case.seed % len(CODECS)] if case.video else ""


def filmed(case: Case, made: Drawn, path: Path) -> None:
    """Render a case into a video file."""
    frames = render_frames(made.truth, made.grid, case.duration_s, case.seed)
    write_video(path, frames, CODECS[codec_of(case)])


def sampled(path: Path) -> tuple[Measured, Callable[[Float32Array], Float32Array] | None]:
    """Return the rows of a video, and the coding of simulated rows if the file is lossy."""
    data = measured_of(read_recording(path, rows=ROWS).blocks)
    again = (lambda level: recoded(path, level, data.axis, ROWS)) if is_lossy(path) else None
    return data, again


OTHER = 10**6  # between the seeds of a case and of the simulation of its model


def given_back(found: Discovery, grid: GridPath, duration_s: float, seed: int, folder: Path) -> str:
    """Write a model, read it, simulate with it, and return the verdict on what comes out.

    Parameters
    ----------
    found : Discovery
    grid : GridPath
        Of the simulation.
    duration_s : float
    seed : int
        Of the case.
    folder : Path
        For the model file.
    """
    path = folder / "model.yaml"
    path.write_text(yaml.safe_dump(model_of(found, "a case").to_dict(), sort_keys=False))
    model = load_model(path)
    rows = simulate_rows(model, grid, duration_s, seed + OTHER, strips=found.last.data.strips)
    blocks = blocks_from_luminance(np.asarray(rows.level), rows.frame_time_s, Header())
    return discover(model, measured_of(list(blocks))).verdict


GIVEN_BACK = 4  # one model in so many


def tried(case: Case, grids: Path | None) -> dict[str, Any]:
    """Simulate a case, run the workflow on it, and judge the result.

    Parameters
    ----------
    case : Case
    grids : Path or None
        Folder of measured grids.

    Returns
    -------
    dict
        The record, of plain values.
    """
    made, back = drawn(case, grids), ""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "clip.mp4"
        if case.video:
            filmed(case, made, path)
        rows = None if case.video else _rows(case, made)

        def work() -> tuple[dict[str, Any], Discovery]:
            data, again = (measured_of(rows), None) if rows else sampled(path)
            found = discover(made.given, data, recoded=again)
            return discovery_json(found, ""), found

        answer, found, refused, cpu_s = answered(work)
        if found and answer["verdict"] == "explained" and case.seed % GIVEN_BACK == 0:
            back = given_back(found, made.grid, case.duration_s, case.seed, Path(folder))
    errors = {name: parameter_error(name, made.shown[name], answer) for name in made.hidden}
    return {
        **recorded(case, answer, refused, cpu_s),
        **drawn_facts(made),
        "codec": codec_of(case),
        "outcome": judged(case.kind, case.hidden, answer),
        "truth": made.hidden,
        "shown": made.shown,
        "told": [e["parameters"] for e in answer["effects"]],
        "relative_error": {k: v[0] for k, v in errors.items()},
        "error_over_stderr": {k: v[1] for k, v in errors.items()},
        "given_back": back,
        "idle_ratio": made.truth.shutter.idle_ratio,
        "flicker_ratio": made.truth.light.flicker_ratio,
    }


def drawn_facts(made: Drawn) -> dict[str, Any]:
    """Return camera, lamp and grid of a case for its record."""
    return {
        "frame_rate": str(made.truth.shutter.frame_rate),
        "nominal_hz": made.grid.nominal_hz,
        "lines": made.truth.shutter.rows,
        "strips": made.strips,
        "lamp": made.truth.light.lamp,
        "grid": made.grid_name,
    }


def _rows(case: Case, made: Drawn) -> list[RowBlock]:
    """Return the row means of a case, not encoded."""
    rows = simulate_rows(made.truth, made.grid, case.duration_s, case.seed, strips=made.strips)
    level = np.asarray(rows.level)
    for name in case.hidden:
        if name in OUTSIDE:
            rng = generator(case.seed, "outside")
            level = done_to(name, level, made.truth.shutter.frame_rate, rng)
    return list(blocks_from_luminance(level, rows.frame_time_s, Header()))

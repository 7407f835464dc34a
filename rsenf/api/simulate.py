"""Simulates a clip, as arrays, videos or a recording, with the truth beside it."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rsenf.api.shared import (
    PathLike,
    Progress,
    References,
    open_references,
    optional,
    read_only,
    silent,
)
from rsenf.bus.keys import camera_key, is_name
from rsenf.config.schemas import load_model
from rsenf.errors import UsageError
from rsenf.messages import Header
from rsenf.messages.schema import Float32Array, FloatArray
from rsenf.model import CaptureModel, Codec, GridPath, render_frames, simulate_rows, synthetic_grid
from rsenf.model.row_level import RowData
from rsenf.model.video_file import write_videos
from rsenf.record import Recorder
from rsenf.rows.stage import blocks_from_luminance
from rsenf.whole_file import whole_file

if TYPE_CHECKING:
    import xarray

ARRAYS, RECORDING = ".npz", ".mcap"
_TOLD = ("frames", "duration_s", "frame_rate_hz", "nominal_hz", "idle_ratio", "read_out_time_s",
         "clock_ppm", "reference_start_s", "seed", "notes")  # fmt: skip


def simulate(
    out: PathLike | None = None,
    *,
    duration_s: float = 60.0,
    seed: int = 1,
    model: CaptureModel | PathLike | None = None,
    size: tuple[int, int] | None = None,
    frame_rate: str | float | None = None,
    idle_ratio: float | None = None,
    lamp: str | None = None,
    clock_ppm: float | None = None,
    reference: References | None = None,
    start_s: float = 0.0,
    nominal_hz: float | None = None,
    strips: int = 1,
    site: str = "simulated",
    camera: str = "camera",
    encodings: Mapping[str, Codec] | None = None,
    progress: Progress = silent,
    **reading: Any,
) -> SimulateResult:
    """Film a lamp on a grid with a simulated rolling-shutter camera.

    Parameters
    ----------
    out : path, optional
        A video (``.mp4``, ``.mov``, ``.mkv``, ``.avi``, ``.webm``), or row means (``.npz``,
        ``.mcap``), with the truth in a ``.truth.json`` beside it; by default nothing is written.
    duration_s : float
        By the camera's clock.
    seed : int
        Of everything random.
    model : CaptureModel or path, optional
        Model of the capture, if not the default one.
    size : (int, int), optional
        Columns and rows; it and the next four override the model's.
    frame_rate : str or float, optional
        Such as 25 or "30000/1001".
    idle_ratio, clock_ppm : float, optional
    lamp : str, optional
        Such as led or halogen.
    reference : path, ``store:GRID``, Reference or array_like, optional
        The grid's frequency; drawn from the seed by default. ``**reading`` as for
        :func:`rsenf.verify`: ``step_s`` of an array.
    start_s : float
        Start of the clip on the grid's path.
    nominal_hz : float, optional
        50 or 60; by default that of the reference, or 50.
    strips : int
        Of each row, in row means.
    site, camera : str
        Of an ``.mcap`` recording.
    encodings : mapping of str to Codec, optional
        Several videos of one clip, ``X.<name>.mp4``; by default the model's own codec.
    progress : callable, optional
        Called with the seconds filmed.

    Raises
    ------
    UsageError
        If an argument, the model or the reference is invalid.
    RecordingError
        If a file can't be written.

    Examples
    --------
    >>> import rsenf
    >>> clip = rsenf.simulate(duration_s=3, seed=4, size=(64, 48), idle_ratio=0.25)
    >>> clip.rows.shape, clip.to_dict()["idle_ratio"], clip.enf_hz.shape
    ((90, 48, 1), 0.25, (3,))
    """
    path = Path(out) if out is not None else None
    rows = path is None or path.suffix in (ARRAYS, RECORDING)
    if rows and encodings:
        raise UsageError(f"{path}: row means aren't encoded", "encodings are for video")
    whole = (CaptureModel() if model is None else load_model(model)).changed(
        size=size, frame_rate=frame_rate, idle_ratio=idle_ratio, lamp=lamp, clock_ppm=clock_ppm
    )
    if reference is None:
        grid = synthetic_grid(seed, duration_s + 1, nominal_hz=nominal_hz or 50.0, start_s=start_s)
    else:
        (one,) = open_references(reference, nominal_hz=nominal_hz, **reading)
        grid = GridPath(np.asarray(one.freq_hz), one.step_s, start_s, one.nominal_hz)
    rate_hz = float(whole.shutter.frame_rate)

    def show(frames: int) -> None:
        progress(frames / rate_hz)

    if path and not rows:
        codecs = {"": whole.codec} if encodings is None else encodings
        return _filmed(path, whole, grid, duration_s, seed, codecs, show)
    for name in (site, camera):
        if not is_name(name):
            raise UsageError(f"{name!r} can't be a part of a topic", "use letters and digits")
    data = simulate_rows(whole, grid, duration_s, seed, strips=strips, progress=show)
    if path is None:
        return SimulateResult(truth=data.truth, out=None, data=data)
    with _truth_beside(path, data.truth, [(path.name, None)]) as truth:
        if path.suffix == ARRAYS:
            with whole_file(path) as part, part.open("wb") as file:
                np.savez(file, rows=data.level, frame_time_s=data.frame_time_s)
        else:
            _record(path, data, seed, site, camera)
    return SimulateResult(truth=truth, out=path, data=data)


def _filmed(
    out: Path,
    model: CaptureModel,
    grid: GridPath,
    duration_s: float,
    seed: int,
    codecs: Mapping[str, Codec],
    show: Callable[[int], None],
) -> SimulateResult:
    """Render once, encode all; a label becomes part of a file's name."""
    frames = render_frames(model, grid, duration_s, seed)
    paths = {
        out.with_suffix(f".{label}{out.suffix}") if label else out: codec
        for label, codec in codecs.items()
    }
    files = [(path.name, vars(codec)) for path, codec in paths.items()]
    with _truth_beside(out, frames.truth, files) as truth:
        write_videos(paths, frames, show)
    return SimulateResult(truth=truth, out=out, data=None)


def _record(out: Path, data: RowData, seed: int, site: str, camera: str) -> None:
    """Write row means as the row blocks of a camera."""
    info = {"run_id": f"simulated-{seed}", "site": site, "source": "rsenf simulate"}
    blocks = blocks_from_luminance(
        data.level,
        data.frame_time_s,
        Header(source=f"{site}/{camera}"),
        read_out_axis=data.truth["read_out_axis"],
    )
    with Recorder(out, run_info=info, clock_ns=time.time_ns, overwrite=True) as recorder:
        for block in blocks:
            recorder.write(camera_key(site, camera, "rows"), block)


@contextmanager
def _truth_beside(
    out: Path, truth: dict[str, Any], files: Sequence[tuple[str, dict[str, Any] | None]]
) -> Iterator[dict[str, Any]]:
    """Write the truth, which appears only when the clip is complete."""
    doc = truth | {"files": [{"name": name, "codec": codec} for name, codec in files]}
    with whole_file(out.with_suffix(".truth.json")) as part:
        part.write_text(json.dumps(doc, indent=1) + "\n", encoding="utf-8")
        yield doc


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class SimulateResult:
    """A simulated clip.

    Attributes
    ----------
    truth : dict
        Ground truth: what ``X.truth.json`` has.
    out : Path or None
        Where it was written.
    data : RowData or None
        Its row means; None for a video.
    """

    truth: dict[str, Any]
    out: Path | None
    data: RowData | None

    @property
    def rows(self) -> Float32Array:
        """Mean 8-bit levels, (frames, rows, strips)."""
        return read_only(self._row_data.level.view())

    @property
    def frame_time_s(self) -> FloatArray:
        """Start of each frame in s, (frames,), by the camera's clock."""
        return read_only(self._row_data.frame_time_s.view())

    @property
    def t_s(self) -> FloatArray:
        """Centres of the seconds of ``enf_hz``, from the first frame, in true seconds."""
        return np.array(self.truth["t_s"])

    @property
    def enf_hz(self) -> FloatArray:
        """The grid's true mean frequency in each second."""
        return np.array(self.truth["enf_hz"])

    @property
    def _row_data(self) -> RowData:
        if self.data is None:
            raise UsageError(
                f"{self.out} is a video: its rows weren't kept", "read it: rsenf.read_recording"
            )
        return self.data

    def to_dict(self) -> dict[str, Any]:
        """Return plain values: what ``rsenf simulate --json`` prints."""
        places: dict[str, Any] = {}
        if self.out:
            truth = str(self.out.with_suffix(".truth.json"))
            places = {"out": str(self.out), "files": self.truth["files"], "truth": truth}
        return places | {name: self.truth[name] for name in _TOLD}

    def to_xarray(self) -> xarray.DataArray:
        """Return the rows with the dimensions ``frame_time_s``, row and strip."""
        return optional("xarray").DataArray(
            self.rows,
            dims=("frame_time_s", "row", "strip"),
            coords={"frame_time_s": self.frame_time_s},
            name="level",
        )

    def __str__(self) -> str:
        truth = self.truth
        lines = [
            f"{truth['frames']} frames, {truth['duration_s']:.3f} s at {truth['frame_rate']} fps, "
            f"{truth['nominal_hz']:g} Hz grid, idle {truth['idle_ratio']:g}"
        ]
        if self.out:
            lines[0] = f"{', '.join(f['name'] for f in truth['files'])}: {lines[0]}"
            lines.append(f"{self.out.with_suffix('.truth.json')}: what is true of it")
        return "\n".join(lines)

    def __repr__(self) -> str:
        said, _, _ = str(self).partition("\n")
        return f"<SimulateResult: {said}>"

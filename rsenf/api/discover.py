"""Discovers effects that the capture model lacks of a recording, and adds them."""

from __future__ import annotations

import contextlib
import dataclasses
import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import ArrayLike, NDArray

from rsenf.api.recordings import Arrays, Begun, begun, identity_of, rows_of
from rsenf.api.shared import (
    PathLike,
    Progress,
    Recording,
    References,
    grids_of,
    open_references,
    opened,
    row_settings,
    silent,
)
from rsenf.config.schemas import load_model
from rsenf.discrepancy.clock_offset import (
    ClockOffsetDiscovery,
    beside_json,
    beside_model,
    beside_of,
    clip_of,
    clip_of_frame_means,
    discover_beside,
    holds_frame_means,
    joined,
)
from rsenf.discrepancy.fleet import check_camera, fit_to, without_series
from rsenf.discrepancy.measured import Measured, measured_of
from rsenf.discrepancy.result import discovery_json, files_of, model_of, sha256_of
from rsenf.discrepancy.start import PLAIN
from rsenf.discrepancy.verdict import discover as discover_by_rows
from rsenf.errors import InputError, UsageError
from rsenf.match.series import Grid
from rsenf.messages import RowBlock
from rsenf.messages.schema import Float32Array
from rsenf.model import CaptureModel
from rsenf.report.discovery import discovery_words
from rsenf.report.discovery_page import beside_page, discovery_page
from rsenf.rows.settings import RowsSettings
from rsenf.run.inputs import Input
from rsenf.run.simulated import is_lossy, recoded
from rsenf.whole_file import whole_folder

MODEL, RESULT, RESIDUALS, PAGE = "model.yaml", "discovery.json", "residuals.npz", "report.html"
STRIPS = 4  # of a video's rows: two from left to right, each in two that a codec codes separately
TIED = "a codec has tied rows together, and counts as a discrepancy (give the video it coded)"

Doing = Callable[[str], None]
Codec = Callable[[Float32Array], Float32Array]


def discover(
    recording: Recording,
    reference: References | None = None,
    *,
    out: PathLike | None = None,
    model: CaptureModel | PathLike | None = None,
    fits: CaptureModel | PathLike | None = None,
    frame_time_s: ArrayLike | None = None,
    frame_rate_hz: float | None = None,
    camera: str = "",
    reference_start: str | None = None,
    store: PathLike | None = None,
    nominal_hz: float | None = None,
    rows: RowsSettings | None = None,
    progress: Progress = silent,
    doing: Doing = silent,
    share: Progress = silent,
    **reading: Any,
) -> DiscoverResult:
    """Fit a capture model to a recording, and add the effects that explain where they differ.

    Parameters
    ----------
    recording, frame_time_s, frame_rate_hz, camera, progress
        As for :func:`rsenf.track`.
    reference, reference_start, store, **reading
        As for :func:`rsenf.verify`; with a reference the camera's clock is tested too.
    out : path, optional
        Folder for the model, the report and the residuals; checkpoints of a video are kept beside
        it until all is done. By default nothing is written.
    model : CaptureModel or path, optional
        Initial model; by default a lamp without harmonics.
    fits : CaptureModel or path, optional
        Model of a camera, from ``rsenf batch discover --one-camera``: whether the recording fits it
        is said under ``camera``.
    nominal_hz : float, optional
        50 or 60; found from the data when not given.
    rows : RowsSettings, optional
        Its ``strips`` are always 4.
    doing : callable, optional
        Called with a description of each step.
    share : callable, optional
        Called with the share of that step that is done, where it is known.

    Raises
    ------
    InputError
        If there are no rows, too few seconds, or no flicker to fit a model to.
    UsageError
        For a folder that holds anything else, or an invalid model or reference.

    Examples
    --------
    >>> import rsenf
    >>> from rsenf.model import CaptureModel
    >>> still = CaptureModel().changed(size=(64, 48), lamp="tone")
    >>> clip = rsenf.simulate(model=still, duration_s=30, seed=2, frame_rate=25)
    >>> rsenf.discover(clip.rows, frame_time_s=clip.frame_time_s).verdict
    'no_discrepancy'
    """
    folder = Path(out) if out is not None else None
    if folder:
        check_out(folder)
    first, known, grid = discover_start(
        model, fits, reference, start=reference_start, store=store, assumed_hz=nominal_hz, **reading
    )

    def step(text: str, done: float = 0.0) -> None:
        if text:
            doing(text)
        share(done)

    source = opened(recording, frame_time_s, frame_rate_hz, camera)
    settings = dataclasses.replace(row_settings(rows), strips=STRIPS)
    model_out = str(folder / MODEL) if folder else ""
    with begun(folder, identity_of(source, camera, settings)) as kept:
        blocks, loss = rows_of(source, settings, kept, progress)
        with _named(source):
            if kept.found:
                doing(f"going on from what {kept.folder} has of a run that was stopped")
            if grid and holds_frame_means(blocks):
                found = _by_frame_means(
                    source, first, blocks, grid, nominal_hz, model_out, doing, known
                )
            else:
                data = measured_of(blocks, nominal_hz)
                codec = _codec_of(source, settings, kept, data.axis)
                found = _by_rows(source, first, data, codec, grid, model_out, step, known)
            found = dataclasses.replace(found, loss=loss)
            if folder:
                doing("writing the report")
                found.write(folder)
    return found


def check_out(folder: Path) -> None:
    """Refuse to replace anything but an earlier result whose effect files are as written.

    Raises
    ------
    UsageError
        If the folder holds anything else, or isn't a folder.
    """
    if folder.exists() and not folder.is_dir():
        raise UsageError(f"--out {folder}: not a folder", "name a new one")
    there = {p.name for p in folder.iterdir()} if folder.exists() else set()
    with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
        made = json.loads((folder / RESULT).read_bytes())["files"]
        text = {n: (folder / n).read_text("utf-8") for n in there & set(made)}
        there -= {n for n in text if made[n] == sha256_of(text[n])}
    if others := there - {MODEL, RESULT, RESIDUALS, PAGE}:
        problem = f"--out {folder}: {min(others)} is of no earlier result, or was edited"
        raise UsageError(problem, "name a new or an empty folder")


def discover_start(
    model: CaptureModel | PathLike | None,
    fits: CaptureModel | PathLike | None,
    reference: References | None,
    **how: Any,
) -> tuple[CaptureModel, CaptureModel | None, Grid | None]:
    """Return the initial model, and the camera's and the reference, if any.

    Raises
    ------
    UsageError
        If one of them is invalid.
    """
    known = None if fits is None else load_model(fits)
    if known:
        check_camera(known)
    grid = None if reference is None else grids_of(open_references(reference, **how))[0]
    return PLAIN if model is None else load_model(model), known, grid


@contextlib.contextmanager
def _named(source: Input) -> Iterator[None]:
    """Prefix errors of the input with the recording's name."""
    try:
        yield
    except InputError as error:
        raise type(error)(f"{source.called}: {error.message}", error.hint) from error


def _codec_of(source: Input, settings: RowsSettings, run: Begun, axis: str) -> Codec | None:
    """Return a function that passes rows through the codec of a video, if that is lossy."""
    path = source.path
    if path is None or source.begins_with != "frames" or not is_lossy(path):
        return None

    def through(level: Float32Array) -> Float32Array:
        def make() -> Arrays:
            return {"level": recoded(path, level, axis, settings)}

        what = f"recoded {axis} {level.shape} ".encode() + level.tobytes()
        return np.asarray(run.kept(what, make)["level"], np.float32)

    return through


def _by_rows(
    source: Input,
    model: CaptureModel,
    data: Measured,
    codec: Codec | None,
    grid: Grid | None,
    model_out: str,
    step: Callable[..., None],
    known: CaptureModel | None,
) -> DiscoverResult:
    """Discover from rows, and from a reference if there is one; compare with a known camera."""
    # Refuse a reference of another time before the long computation.
    laid = beside_of(clip_of(data), grid) if grid else None
    # Even a codec too weak to tie rows together may exceed any effect.
    found = discover_by_rows(model, data, step, codec, beyond_catalogue=True)
    files = files_of(found, source.name)
    doc, extended = discovery_json(found, model_out, files), model_of(found, source.name)
    residuals: dict[str, NDArray[Any]] = {
        "frame_time_s": data.time_s,
        "before": found.first.residual.astype(np.float16),
        "after": found.last.residual.astype(np.float16),
    }
    beside = discover_beside(extended, laid, step) if laid else None
    extended = beside_model(beside, source.name) if beside else extended
    doc |= {"camera": fit_to(known, without_series(extended))} if known else {}
    page = discovery_page(found, doc, source.name, extended, beside)
    if beside:
        doc, residuals = joined(doc, beside_json(beside, "")), residuals | _residuals_of(beside)
    note = TIED if data.coded and not codec else ""
    return _result(source, doc, extended, page, residuals, note, files)


def _by_frame_means(
    source: Input,
    model: CaptureModel,
    blocks: list[RowBlock],
    grid: Grid,
    nominal_hz: float | None,
    model_out: str,
    doing: Doing,
    known: CaptureModel | None,
) -> DiscoverResult:
    """Discover from frame means and a reference."""
    doing("looking for the recording in the reference")
    laid = beside_of(clip_of_frame_means(blocks, nominal_hz or grid.nominal_hz), grid)
    found = discover_beside(model, laid, doing)
    doc, extended = beside_json(found, model_out), beside_model(found, source.name)
    doc |= {"camera": fit_to(known, without_series(extended))} if known else {}
    page = beside_page(found, doc, source.name, extended)
    return _result(source, doc, extended, page, _residuals_of(found))


def _residuals_of(found: ClockOffsetDiscovery) -> dict[str, NDArray[Any]]:
    """Return the ENF's residuals before and after, with their times."""
    return {
        "enf_time_s": found.beside.t_s,
        "enf_before_hz": found.first.residual_hz,
        "enf_after_hz": found.last.residual_hz,
    }


def _result(
    source: Input,
    doc: dict[str, Any],
    model: CaptureModel,
    page: str,
    residuals: dict[str, NDArray[Any]],
    note: str = "",
    files: dict[str, str] | None = None,
) -> DiscoverResult:
    return DiscoverResult(
        recording=source.called,
        **{name: doc[name] for name in ("verdict", "effects", "gap", "unexplained")},
        document=doc, model=model, page=page, residuals=residuals, note=note, files=files or {},
    )  # fmt: skip


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class DiscoverResult:
    """Effects that a model was found to lack.

    Attributes
    ----------
    verdict : {'no_discrepancy', 'explained', 'unexplained'}
    effects : list of dict
        Those that were added, with parameters and their errors.
    gap : dict
        Systematic residual between data and model, before and after, relative to the flicker's
        power.
    unexplained : dict or None
        Residual that no effect of the catalogue explains, and where it is.
    document : dict
        The whole result, as plain values.
    model : CaptureModel
        The extended one: give it to :func:`rsenf.simulate`.
    page : str
        The report, HTML.
    residuals : dict of ndarray
        Residuals before and after.
    files : dict of str
        Effect files of what no catalogue has.
    note, loss : str
        A remark, and what could not be read; may be empty.
    """

    recording: str
    verdict: str
    effects: list[dict[str, Any]]
    gap: dict[str, Any]
    unexplained: dict[str, Any] | None
    document: dict[str, Any]
    model: CaptureModel
    page: str
    residuals: dict[str, NDArray[Any]]
    files: dict[str, str] = dataclasses.field(default_factory=dict)
    note: str = ""
    loss: str = ""

    @property
    def of_camera(self) -> dict[str, Any]:
        """What :func:`rsenf.discrepancy.fleet.camera_of` takes of it."""
        return without_series(self.model)

    def to_dict(self) -> dict[str, Any]:
        """Return plain values: what ``rsenf discover --json`` prints."""
        return self.document

    def write(self, out: Path) -> None:
        """Write all of it into a folder, or nothing.

        Raises
        ------
        UsageError, RecordingError
            If the folder holds anything but an earlier result; if it can't be written.
        """
        check_out(out)
        out.parent.mkdir(parents=True, exist_ok=True)
        with whole_folder(out) as folder:
            (folder / MODEL).write_text(yaml.safe_dump(self.model.to_dict(), sort_keys=False))
            (folder / RESULT).write_text(
                json.dumps(self.document, indent=2, allow_nan=False) + "\n"
            )
            for name, text in {PAGE: self.page, **self.files}.items():
                (folder / name).write_text(text, encoding="utf-8")
            np.savez_compressed(folder / RESIDUALS, allow_pickle=False, **self.residuals)

    def __str__(self) -> str:
        return discovery_words(self.document)

    def __repr__(self) -> str:
        return f"<DiscoverResult of {self.recording}: {self.verdict}>"

"""Reads the rows of a recording as arrays; and keeps checkpoints of a long run on one.

A part that takes long is a function of the run's inputs; its answer is cached beside the result
under a hash of all that it depends on, and reused only for the very same inputs and versions. An
unreadable one is computed again.
"""

from __future__ import annotations

import contextlib
import hashlib
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rsenf import __version__
from rsenf.api.shared import Progress, Recording, opened, optional, read_only, row_settings, silent
from rsenf.errors import InputError, RecordingError
from rsenf.messages import RowBlock, decode, encode
from rsenf.messages.schema import Float32Array, FloatArray
from rsenf.rows.settings import RowsSettings
from rsenf.run.inline import analyse
from rsenf.run.inputs import Input
from rsenf.whole_file import read_arrays, whole_file

if TYPE_CHECKING:
    import xarray

FORMAT = 1  # changes when the answer to the same key does
Arrays = dict[str, NDArray[np.generic]]


def read_recording(
    recording: Recording,
    *,
    frame_time_s: ArrayLike | None = None,
    frame_rate_hz: float | None = None,
    camera: str = "",
    begin: str = "rows",
    rows: RowsSettings | None = None,
    progress: Progress = silent,
) -> RecordedRows:
    """Read the rows of a recording, the input of all analyses.

    The result can be given to each of them in place of the recording: a video is then decoded
    once, and the results are the same.

    Parameters
    ----------
    recording, frame_time_s, frame_rate_hz, camera, progress
        As for :func:`rsenf.track`.
    begin : {'rows', 'frames'}
        What to use of an ``.mcap`` recording: its rows, or its video again.
    rows : RowsSettings, optional
        Such as the number of strips of a video's rows.

    Raises
    ------
    UsageError
        If there is no such file, or an argument is invalid.
    InputError
        If the recording holds nothing that can be analysed.

    Examples
    --------
    >>> import numpy as np
    >>> import rsenf
    >>> held = rsenf.read_recording(np.full((90, 48), 100.0), frame_rate_hz=30.0)
    >>> held.rows.shape, float(held.frame_time_s[30])
    ((90, 48, 1), 1.0)
    """
    source = opened(recording, frame_time_s, frame_rate_hz, camera, begin)
    blocks: list[RowBlock] = []

    def tap(topic: str, message: Any) -> None:
        if topic == "rows":
            blocks.append(message)

    analysis = analyse(source, rows=row_settings(rows), progress=progress, tap=tap)
    return RecordedRows(
        name=source.name,
        path=source.path,
        tells_arrival=source.tells_arrival,
        duration_s=analysis.seconds,
        blocks=tuple(blocks),
        lost=analysis.loss,
        notes=tuple(source.warnings),
    )


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class RecordedRows(Input):
    """Rows of a recording.

    Attributes
    ----------
    blocks : tuple of RowBlock
        All of them.
    lost : str
        What could not be read, in one line; may be empty.
    notes : tuple of str
        Remarks on the input.
    """

    name: str
    path: Path | None
    tells_arrival: bool
    duration_s: float | None
    blocks: tuple[RowBlock, ...]
    lost: str
    notes: tuple[str, ...]

    def messages(self) -> Iterator[RowBlock]:
        """Yield the blocks."""
        return iter(self.blocks)

    @property
    def loss(self) -> str:
        """What could not be read, in one line; may be empty."""
        return self.lost

    @property
    def warnings(self) -> list[str]:
        """Remarks on the input for a result, one line each."""
        return list(self.notes)

    @property
    def stretch(self) -> list[RowBlock]:
        """Blocks of the first epoch: until the source restarted, if it did."""
        epoch = self.blocks[0].header.epoch if self.blocks else 0
        return [block for block in self.blocks if block.header.epoch == epoch]

    @property
    def rows(self) -> Float32Array:
        """Mean 8-bit levels of the first epoch, (frames, rows, strips)."""
        levels = [block.level for block in self.stretch]
        return read_only(np.concatenate(levels) if levels else np.empty((0, 0, 0), np.float32))

    @property
    def frame_time_s(self) -> FloatArray:
        """Start of each of their frames in s, (frames,), by the stream's clock."""
        times_ns = [block.frame_pts_ns for block in self.stretch]
        return read_only(np.concatenate(times_ns) / 1e9 if times_ns else np.empty(0))

    @property
    def read_out_axis(self) -> str:
        """``rows``, ``columns`` for a rotated camera, or ``frame`` for frame means."""
        return self.blocks[0].read_out_axis if self.blocks else "rows"

    def to_xarray(self) -> xarray.DataArray:
        """Return the rows with the dimensions ``frame_time_s``, row and strip."""
        return optional("xarray").DataArray(
            self.rows,
            dims=("frame_time_s", "row", "strip"),
            coords={"frame_time_s": self.frame_time_s},
            name="level",
            attrs={"read_out_axis": self.read_out_axis, "recording": self.called},
        )

    def __repr__(self) -> str:
        frames, rows, strips = self.rows.shape
        return f"<RecordedRows of {self.called}: {frames} frames, {rows} rows, {strips} strips>"


class Begun:
    """Cached answers of one run.

    Parameters
    ----------
    folder : Path or None
        Created when there is something to keep; without, nothing is kept.
    of : str
        What all answers depend on: the input, and how it is treated.
    """

    def __init__(self, folder: Path | None, of: str) -> None:
        self.folder, self.of = folder, of
        self.found = False  # whether an answer of an earlier run was used

    def kept(self, what: bytes, make: Callable[[], Arrays]) -> Arrays:
        """Return a cached answer, or compute and cache one.

        Parameters
        ----------
        what : bytes
            Key of the answer: all else that it depends on.
        make : callable
            Computes the arrays.
        """
        if self.folder is None:
            return make()
        of = f"{FORMAT} {__version__} {version('av')} {self.of} ".encode()
        path = self.folder / f"{hashlib.sha256(of + what).hexdigest()[:24]}.npz"
        try:
            arrays = read_arrays(path)
            self.found = True
        except ValueError:
            arrays = make()
            with contextlib.suppress(OSError, RecordingError):  # no room: not kept
                self.folder.mkdir(parents=True, exist_ok=True)
                with whole_file(path) as part:
                    np.savez(part, allow_pickle=False, **arrays)
        return arrays


@contextlib.contextmanager
def begun(out: Path | None, of: str) -> Iterator[Begun]:
    """Keep checkpoints beside a run's output until it is written, or the input proves unusable.

    Parameters
    ----------
    out : Path or None
        File or folder that the run is to write; nothing is kept without.
    of : str
        What all answers depend on; nothing is kept when empty.
    """
    folder = out.parent / f".{out.name}.begun" if out and of else None
    try:
        yield Begun(folder, of)
    except InputError:
        _forget(folder)
        raise
    _forget(folder)


def _forget(folder: Path | None) -> None:
    if folder:
        shutil.rmtree(folder, ignore_errors=True)


def identity_of(source: Input, camera: str, settings: RowsSettings) -> str:
    """Return what distinguishes a recording, and how it is sampled, from any other."""
    path = source.path
    if path is None:
        return ""
    there = path.stat()
    return f"{path.resolve()} {(there.st_size, there.st_mtime_ns)} {camera} {settings}"


def rows_of(
    source: Input, settings: RowsSettings, run: Begun, progress: Progress
) -> tuple[list[RowBlock], str]:
    """Return the rows of the recording's first epoch, and what could not be read."""
    if source.begins_with != "frames":  # rows are read quickly
        held = read_recording(source, rows=settings, progress=progress)
        return held.stretch, held.loss

    def read() -> Arrays:
        held = read_recording(source, rows=settings, progress=progress)
        coded = [encode(block) for block in held.stretch]
        return {
            "bytes": np.frombuffer(b"".join(coded), np.uint8),
            "ends": np.cumsum([len(one) for one in coded], dtype=np.int64),
            "loss": np.array(held.loss),
        }

    kept = run.kept(b"rows", read)
    coded, begin, blocks = kept["bytes"].tobytes(), 0, []
    for end in kept["ends"].tolist():
        blocks.append(decode(RowBlock, coded[begin:end]))
        begin = end
    return blocks, str(kept["loss"])

"""Recordings as inputs of the one-process commands: video, MCAP, or arrays of luminance."""

from __future__ import annotations

import time
import zipfile
from abc import ABC, abstractmethod
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsenf.errors import InputError, UsageError
from rsenf.messages import Frame, Header, Mark, RowBlock

MCAP_MAGIC = b"\x89MCAP"


class Input(ABC):
    """A recording, opened.

    Attributes
    ----------
    name : str
        What to call it.
    duration_s : float or None
        How long it is, as far as it says so itself.
    begins_with : str
        'frames' or 'rows': which stage its messages are for.
    """

    name: str
    duration_s: float | None = None
    begins_with: str = "rows"

    @abstractmethod
    def messages(self) -> Iterator[Any]:
        """Yield frames or row blocks, without an END mark."""

    @property
    def loss(self) -> str:
        """What could not be read, in one line; empty when all was."""
        return ""

    @property
    def warnings(self) -> list[str]:
        """What a result should say about its input, one line each."""
        return []


def open_input_file(path: str | Path, *, camera: str = "", source: str = "") -> Input:
    """Open a recording by what it is, not by what it is called.

    Parameters
    ----------
    path : path
        Video, ``.mcap`` or ``.npz``.
    camera : str, optional
        Which camera of an MCAP recording with several.
    source : str, optional
        What its messages say they come from; ``file/<name>`` unless given.

    Raises
    ------
    UsageError
        When there is no such file.
    InputError
        When it holds nothing that can be analysed.
    """
    path = Path(path)
    if not path.is_file():
        what = "is a folder" if path.is_dir() else "no such file"
        raise UsageError(f"{path}: {what}")
    with path.open("rb") as file:
        start = file.read(8)
    if start.startswith(MCAP_MAGIC):
        return RecordedRows(path, camera)
    if start.startswith(b"PK") and path.suffix == ".npz":
        return Luminance(path, source or f"file/{path.stem}")
    return Video(path, source or f"file/{path.stem}")


class Video(Input):
    """A video file, decoded."""

    begins_with = "frames"

    def __init__(self, path: Path, source: str) -> None:
        from rsenf.decode.source import open_source
        from rsenf.decode.spec import SourceSpec

        self.name = path.name
        self._source = open_source(
            SourceSpec(url=str(path), kind="file"),
            source=source,
            run_id="",
            clock_ns=time.time_ns,
        )
        self.duration_s = self._source.info.duration_s

    def messages(self) -> Iterator[Any]:
        """Yield its frames."""
        with self._source as source:
            for item in source:
                if isinstance(item, Frame):
                    yield item

    @property
    def loss(self) -> str:
        """What could not be decoded."""
        return self._source.loss

    @property
    def warnings(self) -> list[str]:
        """What the container left open."""
        return self._source.warnings


class RecordedRows(Input):
    """Row blocks of one camera of an MCAP recording."""

    def __init__(self, path: Path, camera: str) -> None:
        from rsenf.record.reader import open_recording

        self.name = path.name
        self._recording = open_recording(path)
        topics = [t for t in self._recording.topics if t.endswith("/rows")]
        wanted = [t for t in topics if not camera or t.split("/")[-2] == camera]
        if len(wanted) != 1:
            names = ", ".join(t.split("/")[-2] for t in topics) or "none"
            raise InputError(
                f"{path}: {len(wanted)} cameras with row blocks fit (there are: {names})",
                "choose one with --camera" if wanted else "was 'rows' recorded?",
            )
        self._topic = wanted[0]

    def messages(self) -> Iterator[Any]:
        """Yield its row blocks."""
        for _, message, _ in self._recording.messages([self._topic]):
            if message.header.mark == Mark.DATA:
                yield message

    @property
    def loss(self) -> str:
        """What the file lacks."""
        return str(self._recording.loss) if self._recording.loss else ""


class Luminance(Input):
    """Luminance that was sampled elsewhere, in an ``.npz`` file.

    Either ``rows`` (frames × rows, or frames × rows × strips) with ``frame_time_s`` (frames,), or
    ``luminance`` (frames,) with ``frame_rate_hz``.
    """

    def __init__(self, path: Path, source: str) -> None:
        self.name, self._source = path.name, source
        try:
            with np.load(path, allow_pickle=False) as arrays:
                held = {k: arrays[k] for k in arrays.files if k in _ARRAYS}
        except (OSError, ValueError, KeyError, zipfile.BadZipFile) as exc:
            raise InputError(f"{path}: not an .npz that can be read ({exc})") from exc
        self._level, self._time_s, self._axis = _luminance(path, held)
        self.duration_s = float(self._time_s[-1] - self._time_s[0])

    def messages(self) -> Iterator[RowBlock]:
        """Cut the arrays into row blocks."""
        from rsenf.rows.luminance import blocks_from_luminance

        header = Header(source=self._source)
        return blocks_from_luminance(self._level, self._time_s, header, read_out_axis=self._axis)


_ARRAYS = ("rows", "frame_time_s", "luminance", "frame_rate_hz")


def _luminance(
    path: Path, held: dict[str, NDArray[Any]]
) -> tuple[NDArray[Any], NDArray[np.float64], str]:
    """Return level (frames, rows, strips), frame times and read-out axis of checked arrays."""
    if "rows" in held and "frame_time_s" in held:
        level, axis = held["rows"], "rows"
        level = level[:, :, None] if level.ndim == 2 else level
        time_s = np.asarray(held["frame_time_s"], np.float64)
    elif "luminance" in held and "frame_rate_hz" in held:
        level, axis = held["luminance"].reshape(-1, 1, 1), "frame"
        rate_hz = float(held["frame_rate_hz"])
        if not rate_hz > 0:
            raise InputError(f"{path}: frame_rate_hz is {rate_hz}")
        time_s = np.arange(len(level)) / rate_hz
    else:
        raise InputError(
            f"{path}: holds {', '.join(held) or 'none of the arrays needed'}",
            "needed: 'rows' with 'frame_time_s', or 'luminance' with 'frame_rate_hz'",
        )
    if level.ndim != 3 or not level.size or time_s.shape != level.shape[:1]:
        raise InputError(
            f"{path}: shapes {level.shape} and {time_s.shape} are not (frames, rows, strips) and "
            "(frames,)"
        )
    if not (np.isfinite(level).all() and np.isfinite(time_s).all()):
        raise InputError(f"{path}: holds values that are not finite")
    if len(time_s) > 1 and not (np.diff(time_s) > 0).all():
        raise InputError(f"{path}: frame_time_s does not increase throughout")
    return level, time_s, axis

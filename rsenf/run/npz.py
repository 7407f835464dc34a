"""Luminance sampled by another program, as an input: arrays, or an ``.npz`` file of them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rsenf.errors import InputError
from rsenf.messages import Header, RateBasis, RowBlock
from rsenf.rows.stage import blocks_from_luminance
from rsenf.run.inputs import Input, timed
from rsenf.whole_file import read_arrays

ARRAYS = "arrays"  # name of an input without a file
_NAMES = ("rows", "frame_time_s", "luminance", "frame_rate_hz")
_NEEDED = (
    "needed: 'rows' (frames × rows, or frames × rows × strips) or 'luminance' (frames), "
    "with 'frame_rate_hz', or rows with 'frame_time_s' (frames)"
)


class Luminance(Input):
    """Arrays of luminance as an input.

    Parameters
    ----------
    held : mapping of str to array_like
        Either ``rows`` (frames × rows, or frames × rows × strips) with ``frame_time_s`` (frames,)
        or ``frame_rate_hz``, or ``luminance`` (frames,) with ``frame_rate_hz``.
    header : Header
        Template of the message headers: their source, and where frame times come from.
    path : Path, optional
        File that held the arrays.

    Raises
    ------
    InputError
        When the arrays' names, shapes or values are wrong.
    """

    def __init__(
        self, held: Mapping[str, ArrayLike], header: Header, path: Path | None = None
    ) -> None:
        self.name, self.path, self._header = path.name if path else ARRAYS, path, header
        arrays = {name: np.asarray(array) for name, array in held.items()}
        self._level, self._time_s, self._axis = _luminance(str(path or ARRAYS), arrays)
        self.duration_s = float(self._time_s[-1] - self._time_s[0])

    def messages(self) -> Iterator[RowBlock]:
        """Cut the arrays into row blocks."""
        return blocks_from_luminance(
            self._level, self._time_s, self._header, read_out_axis=self._axis
        )


def read_npz(path: Path, source: str, frame_rate_hz: float | None = None) -> Luminance:
    """Read luminance from an ``.npz`` file.

    Parameters
    ----------
    path : Path
    source : str
        ``source`` of the message headers.
    frame_rate_hz : float, optional
        Constant frame rate, for arrays without ``frame_time_s``.

    Raises
    ------
    InputError
        When the file can't be read, or the arrays' names, shapes or values are wrong.
    UsageError
        When a frame rate is given though the file has frame times.
    """
    try:
        held = read_arrays(path, _NAMES)
    except ValueError as exc:
        raise InputError(f"{path} {exc}", "write it again") from exc
    basis = RateBasis.STAMPED if {"rows", "frame_time_s"} <= held.keys() else RateBasis.DECLARED
    if frame_rate_hz is not None:
        if basis is RateBasis.STAMPED:
            raise timed(path)
        held["frame_rate_hz"], basis = np.array(frame_rate_hz), RateBasis.GIVEN
    return Luminance(held, Header(source=source, rate_basis=basis), path)


def _luminance(
    where: str, held: dict[str, NDArray[Any]]
) -> tuple[NDArray[Any], NDArray[np.float64], str]:
    """Check the arrays; return level (frames, rows, strips), frame times (s), read-out axis."""
    for name, array in held.items():
        if array.dtype.kind not in "fiu":
            raise InputError(f"{where}: '{name}' holds {array.dtype}, not numbers", _NEEDED)
    if "rows" in held and held.keys() & {"frame_time_s", "frame_rate_hz"}:
        level, axis, least, most = held["rows"], "rows", 2, 3
        if "frame_time_s" in held:
            time_s = held["frame_time_s"].astype(np.float64)
        else:
            time_s = np.arange(len(np.atleast_1d(level))) / _rate_hz(where, held["frame_rate_hz"])
    elif {"luminance", "frame_rate_hz"} <= held.keys():
        level, axis, least, most = held["luminance"], "frame", 1, 1
        time_s = np.arange(level.size) / _rate_hz(where, held["frame_rate_hz"])
    else:
        raise InputError(f"{where} holds {', '.join(held) or 'nothing of use'}", _NEEDED)
    if not (least <= level.ndim <= most and level.size and time_s.shape == level.shape[:1]):
        raise InputError(f"{where}: shapes {level.shape} and {time_s.shape} don't fit", _NEEDED)
    if not (np.isfinite(level).all() and np.isfinite(time_s).all()):
        raise InputError(f"{where} holds values that are not finite", "leave such frames out")
    if not (np.diff(time_s) > 0).all():
        raise InputError(f"{where}: frame_time_s does not rise throughout", "sort its frames")
    return level.reshape(level.shape + (1,) * (3 - level.ndim)), time_s, axis


def _rate_hz(where: str, rate_hz: NDArray[Any]) -> float:
    if rate_hz.size != 1 or not 0 < rate_hz.item() < np.inf:
        raise InputError(f"{where}: frame_rate_hz is {rate_hz}", "one number above 0 is needed")
    return float(rate_hz.item())

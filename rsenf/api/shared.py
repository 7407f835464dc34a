"""What the analyses share: inputs, references, settings of the stages, base class of results."""

from __future__ import annotations

import dataclasses
import importlib
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rsenf.errors import UsageError
from rsenf.match.series import Grid
from rsenf.match.stage import tracker_for
from rsenf.messages import Header, RateBasis
from rsenf.reference import Reference, open_reference, reference_of
from rsenf.reference.open import utc_ns
from rsenf.reference.readings import ReadOptions
from rsenf.rows.settings import AUTO, RowsSettings
from rsenf.run.inline import Analysis
from rsenf.run.inputs import ARRAYS, Input, Luminance, open_input_file
from rsenf.track import METHODS, TrackSettings

if TYPE_CHECKING:
    import pandas

PathLike: TypeAlias = str | os.PathLike[str]
Recording: TypeAlias = PathLike | Input | ArrayLike
Progress: TypeAlias = Callable[[float], None]
ASIDE = {"json": False}  # metadata of result fields that aren't in its JSON
References: TypeAlias = PathLike | Reference | ArrayLike | Sequence[PathLike | Reference]


def silent(progress: Any) -> None:
    """Ignore progress."""


def opened(
    recording: Recording,
    frame_time_s: ArrayLike | None = None,
    frame_rate_hz: float | None = None,
    camera: str = "",
    begin: str = "rows",
) -> Input:
    """Open the input of an analysis.

    Parameters
    ----------
    recording : path, Input or array_like
        Video, ``.mcap`` recording or ``.npz``; a result of
        :func:`rsenf.run.inputs.open_input_file`; or luminance: (frames,), (frames, rows) or
        (frames, rows, strips).
    frame_time_s : array_like (frames,), optional
        For rows: start of each frame.
    frame_rate_hz : float, optional
        For arrays with regular frames; for a file, in place of missing or wrong times.
    camera, begin : str
        For a path, as for :func:`rsenf.run.inputs.open_input_file`.

    Raises
    ------
    UsageError
        If there is no such file, arrays lack their times, or a recording has its own.
    InputError
        If it holds nothing that can be analysed.
    """
    if isinstance(recording, Input | str | os.PathLike):
        is_open = isinstance(recording, Input)
        if frame_time_s is not None or (is_open and frame_rate_hz is not None):
            raise UsageError("a recording has times of its own", "give times with arrays only")
        if isinstance(recording, Input):
            return recording
        return open_input_file(
            Path(recording), camera=camera, begin=begin, frame_rate_hz=frame_rate_hz
        )
    held: dict[str, ArrayLike]
    if frame_time_s is not None and frame_rate_hz is None:
        held, basis = {"rows": recording, "frame_time_s": frame_time_s}, RateBasis.STAMPED
    elif frame_rate_hz is not None and frame_time_s is None:
        level = np.atleast_1d(recording)
        name, basis = "rows" if level.ndim > 1 else "luminance", RateBasis.GIVEN
        held = {name: level, "frame_rate_hz": frame_rate_hz}
    else:
        raise UsageError("arrays need their times", "give either frame_time_s or frame_rate_hz")
    return Luminance(held, Header(source=f"file/{ARRAYS}", rate_basis=basis))


def track_settings(
    given: TrackSettings | Mapping[str, Any] | None = None,
    *,
    matcher: str = "",
    nominal_hz: float | None = None,
) -> TrackSettings:
    """Return checked settings of the tracker.

    Parameters
    ----------
    given : TrackSettings or mapping, optional
        All of them, or those that differ from the default; a value of None is the default.
    matcher : str, optional
        Matcher that is to compare the estimates.
    nominal_hz : float, optional
        Nominal grid frequency, unless the settings give it.

    Raises
    ------
    UsageError
        If the method doesn't exist, doesn't suit the matcher, or doesn't use a setting.
    """
    if isinstance(given, TrackSettings):
        asked = changed(given, TrackSettings(given.method)) | {"method": given.method}
    else:
        asked = {name: value for name, value in (given or {}).items() if value is not None}
    needed = tracker_for(matcher)
    method = asked.setdefault("method", needed or TrackSettings.method)
    METHODS.find(method)
    if needed and method != needed:
        raise UsageError(
            f"{matcher} compares the hypotheses of the ENF method {needed}, not {method}",
            "name no other ENF method",
        )
    settings = TrackSettings(**{"nominal_hz": nominal_hz, **asked})
    METHODS.find(method).check(settings)
    return settings


def changed(settings: Any, usual: Any) -> dict[str, Any]:
    """Return the fields of settings that differ from those of others of the same class."""
    names = [f.name for f in dataclasses.fields(settings)]
    return {n: v for n in names if (v := getattr(settings, n)) != getattr(usual, n)}


def row_settings(given: RowsSettings | None, track: TrackSettings | None = None) -> RowsSettings:
    """Return settings of the rows, with those that the tracker needs."""
    rows = given or RowsSettings(read_out_axis=AUTO)
    return dataclasses.replace(rows, **METHODS.find(track.method).rows_needed) if track else rows


def json_fields(result: Any) -> list[dataclasses.Field[Any]]:
    """Return the fields of a result class that are keys of its JSON."""
    return [f for f in dataclasses.fields(result) if f.metadata.get("json", True)]


class Plain:
    """Base class of all results: a dataclass whose fields are the keys of its JSON."""

    def to_dict(self) -> dict[str, Any]:
        """Return plain values: what the command line prints with ``--json``."""
        return {f.name: getattr(self, f.name) for f in json_fields(type(self))}


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Result(Plain):
    """Base class of results of one recording; ``str(result)`` is what the command line prints.

    Attributes
    ----------
    recording : str
        Name of the recording.
    analysis : Analysis
        The messages of the stages.
    """

    recording: str = field(metadata=ASIDE)
    analysis: Analysis = field(metadata=ASIDE)

    @property
    def loss(self) -> str:
        """What of the recording could not be read, in one line; may be empty."""
        return self.analysis.loss

    @property
    def remarks(self) -> list[str]:
        """The warnings, but for what could not be read."""
        return [line for line in self.to_dict()["warnings"] if line != self.loss]

    def __repr__(self) -> str:
        said, _, _ = str(self).partition("\n")
        return f"<{type(self).__name__} of {self.recording}: {said}>"


def read_only(array: NDArray[Any]) -> NDArray[Any]:
    """Return an array that can't be written to."""
    array.flags.writeable = False
    return array


def table(columns: Mapping[str, Any], index: str) -> pandas.DataFrame:
    """Return columns as a pandas DataFrame."""
    return optional("pandas").DataFrame(columns).set_index(index)


def optional(package: str) -> Any:
    """Import an optional package.

    Raises
    ------
    UsageError
        If it isn't installed.
    """
    try:
        return importlib.import_module(package)
    except ImportError as exc:
        raise UsageError(f"{package} is not installed", f"pip install 'rsenf[{package}]'") from exc


def open_references(
    references: References,
    *,
    start: str | None = None,
    store: PathLike | None = None,
    **reading: Any,
) -> list[Reference]:
    """Open one reference or several; equal names get numbers.

    Parameters
    ----------
    references : path, ``store:GRID``, Reference, array_like, or sequence of the first three
        An array is of frequencies in Hz, one each ``step_s``, NaN in gaps.
    start : str, optional
        Start of an array, ISO 8601, in UTC unless it has a zone; unknown by default.
    store : path, optional
        Folder of ``store:GRID``.
    **reading
        As for :class:`rsenf.reference.readings.ReadOptions`: ``step_s``, which arrays need,
        ``timezone``, ``time_format``, ``time_column``, ``column``, ``stamp`` ….

    Raises
    ------
    UsageError
        If there is no such file or grid, or an argument is invalid.
    """
    options = ReadOptions(**reading)
    named: Sequence[PathLike | Reference]
    if isinstance(references, str | os.PathLike | Reference):
        named = [references]
    elif isinstance(references, list | tuple) and any(
        isinstance(one, str | os.PathLike | Reference) for one in references
    ):
        named = references
    elif options.step_s is None:
        raise UsageError("an array is no reference without its step", "give step_s, in seconds")
    else:
        begin_ns = utc_ns(start, "start of the reference") if start is not None else 0
        values = cast("ArrayLike", references)
        named = [
            reference_of(
                values, options.step_s, start_utc_ns=begin_ns, nominal_hz=options.nominal_hz
            )
        ]
    opened: list[Reference] = []
    names: set[str] = set()
    for one in named:
        reference = one if isinstance(one, Reference) else open_reference(
            os.fspath(one), store=store, **reading
        )  # fmt: skip
        name, number = reference.grid, 2
        while name in names:
            name, number = f"{reference.grid} ({number})", number + 1
        names.add(name)
        opened.append(dataclasses.replace(reference, grid=name))
    return opened


def grids_of(references: Sequence[Reference]) -> list[Grid]:
    """Convert references to the form that matchers take."""
    # A stored one's samples are read on demand: matchers request slices.
    return [
        Grid(r.grid, r.nominal_hz, r.t0_ns, r.step_s, r.freq_hz, r.zone_unknown) for r in references
    ]


def nominal_of(references: Sequence[Reference]) -> float | None:
    """Nominal frequency of all of them; None if they differ."""
    found = {r.nominal_hz for r in references}
    return found.pop() if len(found) == 1 else None

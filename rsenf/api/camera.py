"""Store of known cameras with their read-out times, and identification of a recording's camera.

The store is one file, ``cameras.json`` in its folder, written whole or not at all.
"""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from rsenf.api.idle import IdleResult
from rsenf.api.shared import PathLike, Plain
from rsenf.errors import InputError, UsageError
from rsenf.idle.compare import SAME_MODEL_RATIO, Known, Mode, ReadOutTime, known_modes, log10_lr
from rsenf.reference.open import file_sha256
from rsenf.reference.store.folder import default_store
from rsenf.report.camera import cameras_words, identification_json, identification_words, known_json
from rsenf.whole_file import whole_file

FILE, VERSION = "cameras.json", 1


def add_camera(
    name: str,
    *found: IdleResult,
    store: PathLike | None = None,
    crop: str = "",
    clock_ppm: float | None = None,
) -> Cameras:
    """Add recordings to a known camera; a file that is already there replaces itself.

    Parameters
    ----------
    name : str
    *found : IdleResult
        Results of :func:`rsenf.idle`, one per recording.
    store : path, optional
        Folder; by default ``$RSENF_STORE``, or the folder of the user's data.
    crop : str
        Crop of the mode if known, such as "stabilised": another crop is another mode.
    clock_ppm : float, optional
        Clock error of the camera, as of :func:`rsenf.verify`. It is stored, but not compared.

    Raises
    ------
    InputError
        If a recording gives no read-out time; then nothing is added.
    UsageError
        If a recording is another camera's, or the name is empty.

    Examples
    --------
    >>> import rsenf, tempfile
    >>> clip = rsenf.simulate(duration_s=20, seed=3, size=(64, 96), idle_ratio=0.3)
    >>> found = rsenf.idle(clip.rows, frame_time_s=clip.frame_time_s)
    >>> with tempfile.TemporaryDirectory() as store:
    ...     rsenf.add_camera("phone", found, store=store).names
    ['phone']
    """
    if not name.strip():
        raise UsageError("a camera without a name", "any words")
    folder = Path(store or default_store())
    cameras, new = _read(folder), [_reading(one, crop, clock_ppm) for one in found]
    files = {r.sha256: r.recording for r in new if r.sha256}
    for other, readings in cameras.items():
        for reading in readings:
            if other != name and reading.sha256 in files:
                raise UsageError(f"{files[reading.sha256]} is {other}'s in the store {folder}")
    kept = [r for r in cameras.get(name, []) if r.sha256 not in files]
    cameras[name] = [*kept, *new]
    plain = {n: [dataclasses.asdict(r) for r in readings] for n, readings in cameras.items()}
    folder.mkdir(parents=True, exist_ok=True)
    with whole_file(folder / FILE) as part:
        text = json.dumps({"version": VERSION, "cameras": plain}, indent=1)
        part.write_text(text + "\n", encoding="utf-8")
    return list_cameras(folder)


def list_cameras(store: PathLike | None = None) -> Cameras:
    """Return the known cameras, each in its modes.

    Parameters
    ----------
    store : path, optional
        As for :func:`add_camera`.

    Examples
    --------
    >>> import rsenf
    >>> rsenf.list_cameras("an/empty/store").names
    []
    """
    folder = Path(store or default_store())
    known = [mode for n, readings in _read(folder).items() for mode in known_modes(n, readings)]
    return Cameras(store=str(folder), known=tuple(known))


def identify_camera(
    found: IdleResult,
    *,
    store: PathLike | None = None,
    crop: str = "",
    same_model_ratio: float = SAME_MODEL_RATIO,
) -> Identification:
    """Compute the likelihood ratio of each known camera in a recording's mode.

    It weighs "this camera took it" against "another camera of the relevant population took it".

    Parameters
    ----------
    found : IdleResult
        Result of :func:`rsenf.idle` for the recording.
    store, crop
        As for :func:`add_camera`.
    same_model_ratio : float
        Share of the relevant population that is of the same model as the known camera: no
        likelihood ratio exceeds its inverse.

    Raises
    ------
    UsageError
        If the share isn't from 0 to below 1.

    Examples
    --------
    >>> import rsenf, tempfile
    >>> clips = [rsenf.simulate(duration_s=20, size=(64, 96), idle_ratio=r) for r in (0.1, 0.4)]
    >>> a, b = (rsenf.idle(clip.rows, frame_time_s=clip.frame_time_s) for clip in clips)
    >>> with tempfile.TemporaryDirectory() as store:
    ...     known = rsenf.add_camera("phone", a, store=store)
    ...     rsenf.identify_camera(b, store=store).verdict
    'different'
    """
    if not 0.0 <= same_model_ratio < 1.0:
        raise UsageError(f"a share of {same_model_ratio:g}", "from 0 to below 1")
    cameras = list_cameras(store)
    reading = _reading(found, crop, None) if found.verdict == "estimated" else None
    weighed: list[tuple[Known, float]] = []
    known_in: list[str] = []
    for known in cameras.known:
        if reading is None or not known.mode.may_be(reading.mode):
            continue
        others = tuple(r for r in known.readings if not r.sha256 or r.sha256 != reading.sha256)
        known_in += [known.name] * (len(others) < len(known.readings))
        if others:
            kept = dataclasses.replace(known, readings=others)
            weighed.append((kept, log10_lr(kept, reading, same_model_ratio)))
    weighed.sort(key=lambda one: -one[1])
    why_none = found.reason or found.verdict
    doc = identification_json(reading, why_none, weighed, known_in, same_model_ratio)
    return Identification(
        recording=found.recording, store=cameras.store, **doc, warnings=found.warnings
    )


def _reading(found: IdleResult, crop: str, clock_ppm: float | None) -> ReadOutTime:
    analysis, path = found.analysis, Path(found.recording)
    estimate = analysis.idle
    if found.verdict != "estimated":
        raise InputError(
            f"{found.recording} gives no read-out time: {found.reason or found.verdict}",
            "another recording of the camera, of a wall in mains light",
        )
    return ReadOutTime(
        recording=found.recording,
        sha256=file_sha256(path) if path.is_file() else "",
        mode=Mode(
            frame_rate_hz=estimate.frame_rate_hz,
            lines=analysis.lines,
            across_px=analysis.across_px,
            crop=crop,
        ),
        direction=estimate.direction,
        read_out_time_s=estimate.read_out_time_s,
        read_out_time_std_s=estimate.read_out_time_std_s,
        clock_ppm=clock_ppm,
    )


def _read(folder: Path) -> dict[str, list[ReadOutTime]]:
    path = folder / FILE
    if not path.exists():
        return {}
    try:
        held = json.loads(path.read_text(encoding="utf-8"))
        if held["version"] != VERSION:
            raise ValueError(f"version {held['version']!r}, not {VERSION}")
        return TypeAdapter(dict[str, list[ReadOutTime]]).validate_python(held["cameras"])
    except (OSError, ValueError, TypeError, KeyError, RecursionError) as exc:
        why = str(exc)
        if isinstance(exc, ValidationError):
            first = exc.errors()[0]
            why = f"{'.'.join(map(str, first['loc']))}: {first['msg']}"
        raise InputError(f"{path} is no store of cameras: {why}", "move it away") from exc


@dataclass(frozen=True, eq=False, kw_only=True)
class Cameras:
    """The known cameras, each in its modes."""

    store: str
    known: tuple[Known, ...]

    @property
    def names(self) -> list[str]:
        """Names of the cameras."""
        return list(dict.fromkeys(known.name for known in self.known))

    def to_dict(self) -> dict[str, Any]:
        """Return plain values: what the command line prints with ``--json``."""
        return {"store": self.store, "cameras": [known_json(known) for known in self.known]}

    def __str__(self) -> str:
        return cameras_words(self.store, self.known)


@dataclass(frozen=True, eq=False, kw_only=True)
class Identification(Plain):
    """Which of the known cameras took a recording, as far as its read-out time shows.

    Attributes
    ----------
    verdict : {'compatible', 'different', 'undecidable'}
        Whether one of them may have taken it, none has, or it is undecidable.
    cameras : list of dict
        The known ones in this mode, the likeliest first: what is known of each, ``log10_lr`` of it
        against another camera of the relevant population, ``verbal`` and ``verdict``.
    log10_odds : float or None
        Odds of the first against all others and an unknown one: if the camera is as likely known
        as not, and all known ones are equally likely.
    prior : str
        The relevant population that is assumed.
    caveats : list of str
        What it doesn't prove.
    """

    recording: str
    store: str
    verdict: str
    reason: str | None
    mode: dict[str, Any] | None
    read_out_time_s: float | None
    read_out_time_std_s: float | None
    cameras: list[dict[str, Any]]
    log10_odds: float | None
    same_model_ratio: float
    prior: str
    caveats: list[str]
    warnings: list[str]

    def __str__(self) -> str:
        return identification_words(self.to_dict())

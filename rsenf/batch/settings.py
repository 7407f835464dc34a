"""The settings of a batch, checked before any long work, and their fingerprint."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rsenf import __version__
from rsenf.api.discover import discover_start
from rsenf.api.idle import idle_settings
from rsenf.api.shared import Opened, open_references, track_settings
from rsenf.api.verify import check_verify
from rsenf.model import load_effects
from rsenf.reference.open import STORE, utc_ns


@dataclass(frozen=True)
class Settings:
    """The settings for every recording of a batch.

    Parameters
    ----------
    analysis : str
        Name of one of the functions of :mod:`rsenf`.
    options : mapping
        Its arguments, except for the recording and the reference.
    references : tuple of str
        Files, or ``store:GRID``. All paths are absolute once checked.
    reading : mapping
        Arguments of :func:`rsenf.api.shared.open_references`.
    effects : tuple of Path
        Files of effects to add to the catalogue.
    begin : str
        Topic of an ``.mcap`` recording to start from.
    camera : str
        Camera of a recording with several.
    frame_rate_hz : float, optional
        Frame rate to use instead of missing or wrong frame times.
    out : str
        Folder of the batch.
    threads : int
        Threads that decode a video.
    fingerprint : str
        Hash of everything that results depend on, apart from the recordings.
    version : str
        Of rsenf.
    """

    analysis: str
    options: Mapping[str, Any] = field(compare=False)
    references: tuple[str, ...] = ()
    reading: Mapping[str, Any] = field(default_factory=dict, compare=False)
    effects: tuple[Path, ...] = ()
    begin: str = "rows"
    camera: str = ""
    frame_rate_hz: float | None = None
    out: str = "."
    threads: int = 0
    fingerprint: str = ""
    version: str = __version__

    def displayed(self) -> dict[str, Any]:
        """Return the settings that aren't the default, for display."""
        given: dict[str, Any] = {"reference": list(self.references), "effects": list(self.effects)}
        given |= {"begin": self.begin, "camera": self.camera}
        given |= {"frame_rate_hz": self.frame_rate_hz, **self.reading}
        for name, value in self.options.items():
            given |= _changed(value) if dataclasses.is_dataclass(value) else {name: value}
        return {name: value for name, value in given.items() if value not in (None, "", False, [])}


def checked(settings: Settings) -> Settings:
    """Return settings with absolute paths and their fingerprint.

    Raises
    ------
    UsageError
        If a setting is invalid, once here instead of for every recording.
    """
    options = {name: _absolute(value) for name, value in settings.options.items()}
    reading = {name: value for name, value in settings.reading.items() if value is not None}
    if "store" in reading:
        reading["store"] = os.path.abspath(reading["store"])
    settings = dataclasses.replace(
        settings,
        options=options,
        references=tuple(map(_absolute_reference, settings.references)),
        reading=reading,
        effects=tuple(path.absolute() for path in settings.effects),
        out=os.path.abspath(settings.out),
    )
    _check(settings)
    references = open_references(settings.references, **reading) if settings.references else []
    identity = {name: _plain(value) for name, value in options.items()} | {
        "reference": [_content(reference) for reference in references],
        "reading": {name: value for name, value in reading.items() if name != "store"},
        "effects": [_plain(path) for path in settings.effects],
        "begin": [settings.begin, settings.camera, settings.frame_rate_hz],
    }
    text = json.dumps([settings.analysis, __version__, identity], sort_keys=True)
    fingerprint = hashlib.sha256(text.encode()).hexdigest()[:16]
    return dataclasses.replace(settings, fingerprint=fingerprint)


def _check(settings: Settings) -> None:
    """Refuse settings that would be wrong for every recording."""
    options = settings.options
    if settings.analysis == "track":
        track_settings(options.get("settings"))
    elif settings.analysis == "idle":
        idle_settings(options["settings"])
    elif settings.analysis == "verify":
        if options.get("start"):
            utc_ns(options["start"], "start")
        check_verify(options["method"], options.get("track"))
    else:
        for path in settings.effects:
            load_effects(path)
        discover_start(options.get("model"), None)


def _changed(value: Any) -> dict[str, Any]:
    """Return those of a stage's settings that aren't the default."""
    plain = type(value)()
    names = [f.name for f in dataclasses.fields(value)]
    return {n: getattr(value, n) for n in names if getattr(value, n) != getattr(plain, n)}


def _absolute(value: Any) -> Any:
    return value.absolute() if isinstance(value, Path) else value


def _absolute_reference(spec: str) -> str:
    return spec if spec.startswith(STORE) else os.path.abspath(spec)


def _plain(value: Any) -> Any:
    """Return a setting as plain values; for a file, the hash of its content."""
    if isinstance(value, Path):
        return hashlib.sha256(value.read_bytes()).hexdigest()
    return dataclasses.asdict(value) if dataclasses.is_dataclass(value) else value  # type: ignore[arg-type]  # of an instance


def _content(reference: Opened) -> Sequence[Any]:
    """Return what identifies the content of a reference, which changes with an import."""
    span = (reference.t0_ns, reference.step_s, int(reference.freq_hz.size))
    return (reference.grid, reference.nominal_hz, reference.sha256, *span)

"""File names of an archive: ``site/camera/day/time.mcap``, all in UTC.

References have ``reference`` in place of the camera, health messages ``@nodes``.
"""

from __future__ import annotations

import re
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

from rsenf.timebase import NS_PER_S

_DAY, _TIME = "%Y-%m-%d", "%H%M%S"
_NAME = re.compile(r"@?[A-Za-z0-9][A-Za-z0-9_.-]{0,63}")
_FILE = re.compile(r"(\d{4}-\d\d-\d\d)/(\d{6})\.(\d{6})Z(?:-\d+)?(\.alarm)?\.mcap")


class Camera(NamedTuple):
    """A camera of a site, which corresponds to a folder."""

    site: str
    name: str

    def __str__(self) -> str:
        return f"{self.site}/{self.name}"


class ArchivedFile(NamedTuple):
    """A file, as far as its name tells."""

    start_ns: int  # time of its creation, by its host's clock
    camera: Camera
    of_alarm: bool
    path: Path


def camera_of(topic: str) -> Camera | None:
    """Return the camera of a topic ``rsenf/<site>/<camera>/…``; None if it is no valid folder.

    A bus may carry any key: one with ``..`` would lead out of the archive.

    Examples
    --------
    >>> camera_of("rsenf/lab/cam1/rows"), camera_of("rsenf/../cam1/rows")
    (Camera(site='lab', name='cam1'), None)
    """
    parts = topic.split("/")
    if len(parts) < 4 or not all(_NAME.fullmatch(part) for part in parts[1:3]):
        return None
    return Camera(*parts[1:3])


def day_of(time_ns: int) -> str:
    """Return the name of a day's folder.

    Examples
    --------
    >>> day_of(1_768_435_200_000_000_000)
    '2026-01-15'
    """
    return datetime.fromtimestamp(time_ns // NS_PER_S, UTC).strftime(_DAY)


def new_path(root: Path, camera: Camera, now_ns: int, *, of_alarm: bool = False) -> Path:
    """Return an unused name for a file that begins now, and make its folder.

    Parameters
    ----------
    root : Path
        Folder of the archive.
    camera : Camera
    now_ns : int
        UTC since 1970.
    of_alarm : bool
        Whether the file records an alarm only.

    Raises
    ------
    OSError
        When the folder can't be made.
    """
    folder = root / camera.site / camera.name / day_of(now_ns)
    folder.mkdir(parents=True, exist_ok=True)
    moment = datetime.fromtimestamp(now_ns // NS_PER_S, UTC).strftime(_TIME)
    stem, end = f"{moment}.{now_ns % NS_PER_S // 1000:06d}Z", ".alarm.mcap" if of_alarm else ".mcap"
    path, number = folder / f"{stem}{end}", 1
    while path.exists():
        path, number = folder / f"{stem}-{number}{end}", number + 1
    return path


def archived_files(root: Path) -> list[ArchivedFile]:
    """Return all files of an archive, oldest first; other files are ignored."""
    return sorted(filter(None, map(_read_name, root.glob("*/*/*/*.mcap"))))


def _read_name(path: Path) -> ArchivedFile | None:
    found = _FILE.fullmatch(f"{path.parent.name}/{path.name}")
    if found is None:
        return None
    day, moment, micros, alarm = found.groups()
    try:
        begun = datetime.strptime(f"{day} {moment}", f"{_DAY} {_TIME}").replace(tzinfo=UTC)
    except ValueError:
        return None
    start_ns = int(begun.timestamp()) * NS_PER_S + int(micros) * 1000
    camera = Camera(path.parts[-4], path.parts[-3])
    return ArchivedFile(start_ns, camera, alarm is not None, path)

"""Where the files of an archive lie: ``site/camera/day/time.mcap``, all in UTC.

A grid's reference goes by the camera's name ``reference``, the nodes' health by ``@nodes``.
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
    """A camera of a site; the folder of its files."""

    site: str
    name: str

    def __str__(self) -> str:
        return f"{self.site}/{self.name}"


class ArchivedFile(NamedTuple):
    """A file by its name alone."""

    start_ns: int  # when it was begun, by the clock of its host
    camera: Camera
    of_alarm: bool
    path: Path


def camera_of(topic: str) -> Camera | None:
    """Camera that a topic ``rsenf/<site>/<camera>/…`` belongs to; None where no folder can be it.

    A bus may carry any key: one with ``..`` would lead out of the archive.
    """
    parts = topic.split("/")
    if len(parts) < 4 or not all(_NAME.fullmatch(part) for part in parts[1:3]):
        return None
    return Camera(*parts[1:3])


def day_of(time_ns: int) -> str:
    """Name of a day's folder."""
    return datetime.fromtimestamp(time_ns // NS_PER_S, UTC).strftime(_DAY)


def new_path(root: Path, camera: Camera, now_ns: int, *, of_alarm: bool = False) -> Path:
    """Name a file that is begun now, and make its folder. No other file has that name.

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
    """All files of an archive, the oldest first; whatever else lies there is left out."""
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

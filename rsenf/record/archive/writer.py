"""Writes messages to an archive: separate files for each camera, with rotation and retention.

The oldest files are deleted, by age and disk share, except those of alarms.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, NamedTuple

from rsenf.errors import RecordingError, UsageError, reason_of
from rsenf.messages import Alarm, Header
from rsenf.record.archive.alarms import AlarmSpan, add_alarm, alarms_of
from rsenf.record.archive.camera_files import AlarmFiles, CameraFiles
from rsenf.record.archive.layout import ArchivedFile, Camera, archived_files, camera_of, new_path
from rsenf.record.limits import (
    AlarmSettings,
    DiskLimits,
    Retention,
    Rotation,
    Usage,
    disk_usage,
    low_bytes,
)
from rsenf.record.output import is_held
from rsenf.record.sequence import Continuity, Timeline
from rsenf.record.writer import Recorder, continuity_after
from rsenf.timebase import nanoseconds

KEEP_EVERY_NS = 60 * 10**9
# Names in place of the camera in topics of references and nodes.
_NO_CAMERA = ("reference", "@nodes")


class ArchiveRecorder:
    """A recording split into files by site, camera and day. Not thread-safe.

    Parameters
    ----------
    root : path
        Folder of the archive; created if necessary.
    run_info : mapping
        As for :class:`rsenf.record.Recorder`; written to each file.
    clock_ns : callable
        Wall clock, UTC since 1970, in ns.
    rotation, retention, alarms : Rotation, Retention, AlarmSettings
    disk : DiskLimits
        When the disk counts as nearly full.
    warn : callable
        Called with a text for each problem that doesn't stop the recording.
    flush_every_s, fsync, compress
        As for :class:`rsenf.record.Recorder`.
    resumed : bool
        Whether another process has just died that recorded the same: what the files of the last
        minutes hold isn't recorded again.

    Attributes
    ----------
    refused : int
        Messages with keys of no valid camera.

    Raises
    ------
    UsageError
        When ``root`` is no folder.
    RecordingError
        When nothing can be written there.
    """

    def __init__(
        self,
        root: str | Path,
        *,
        run_info: Mapping[str, Any],
        clock_ns: Callable[[], int],
        rotation: Rotation,
        retention: Retention,
        alarms: AlarmSettings,
        disk: DiskLimits = DiskLimits(),  # noqa: B008  # frozen
        warn: Callable[[str], None] = lambda text: None,
        flush_every_s: float = 0.5,
        fsync: bool = True,
        compress: bool = True,
        resumed: bool = False,
    ) -> None:
        self.path = Path(root)
        self._run_info, self._clock_ns = dict(run_info), clock_ns
        self._rotation, self._alarms = rotation, alarms
        self._file_options = {"flush_every_s": flush_every_s, "fsync": fsync, "compress": compress}
        self._keeper = Keeper(self.path, retention, clock_ns, limits=disk, warn=warn)
        self._kept_ns, self._warn, self.refused = clock_ns(), warn, 0
        self._cameras: dict[Camera, CameraFiles] = {}
        self._filmed: set[Camera] = set()  # cameras with any message but alarms
        self._noted: dict[tuple[Camera, str], AlarmSpan] = {}
        self._make_folder()
        self._keep()
        self._before = self._recent() if resumed else {}

    def __enter__(self) -> ArchiveRecorder:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    @property
    def resumed(self) -> dict[str, Header]:
        """As :attr:`rsenf.record.Recorder.resumed`; empty where only alarms are recorded."""
        of = () if self._alarms.only else self._before.values()
        return {topic: header for camera in of for topic, header in camera.resumed.items()}

    def write_encoded(self, topic: str, cls: type[Any], payload: bytes, header: Header) -> bool:
        """Record a message, as :meth:`rsenf.record.Recorder.write_encoded`.

        Returns
        -------
        bool
            Whether it was recorded: False for duplicates, and while waiting for an alarm.
        """
        camera = camera_of(topic)
        if camera is None:
            if not self.refused:
                self._warn(f"{topic[:200]!r} is no camera's key: not recorded, nor others like it")
            self.refused += 1
            return False
        if cls is not Alarm:
            self._filmed.add(camera)
        files = self._cameras.get(camera)
        if files is None:
            files = self._cameras[camera] = self._files_of(camera)
        return files.write_encoded(topic, cls, payload, header)

    def update_run_info(self, changed: Mapping[str, Any]) -> None:
        """Change what later files tell of the run; the open ones keep what they tell."""
        self._run_info.update(changed)

    def add_metadata(self, name: str, values: Mapping[str, Any]) -> None:
        """Add a metadata record to the open files, and to later ones."""
        self._run_info.update({f"{name}.{key}": value for key, value in values.items()})
        for files in self._cameras.values():
            if files.recorder is not None:
                files.recorder.add_metadata(name, values)

    def alarm(self, topic: str | None, why: str) -> None:
        """Exempt the time around now from retention, and record it if only alarms are recorded.

        Parameters
        ----------
        topic : str or None
            Topic of the alarm, which then applies to its camera. None, or a topic of no camera,
            applies to all cameras.
        why : str
            Reason in words.

        Raises
        ------
        RecordingError
            When the alarm can't be stored.
        """
        alarmed = camera_of(topic) if topic else None
        of_all = alarmed not in self._filmed or alarmed.name in _NO_CAMERA
        for camera, files in self._cameras.items():
            if of_all or camera == alarmed:
                self._note(camera, why)
                if isinstance(files, AlarmFiles):
                    files.alarm()

    def _note(self, camera: Camera, why: str) -> None:
        """Store an alarm's span, extended so that a lasting alarm adds few spans."""
        now_ns, alarms = self._clock_ns(), self._alarms
        from_ns, after_ns = now_ns - nanoseconds(alarms.before_s), nanoseconds(alarms.after_s)
        noted = self._noted.get((camera, why))
        if noted is not None and noted.from_ns <= from_ns and now_ns + after_ns <= noted.to_ns:
            return
        span = self._noted[camera, why] = AlarmSpan(from_ns, now_ns + 2 * after_ns, why)
        try:
            add_alarm(self.path, camera, span)
        except OSError as exc:
            raise _cannot(self.path, exc) from exc

    def tick(self) -> None:
        """Flush, rotate and delete files, each when due. To be called often."""
        for files in self._cameras.values():
            files.tick()
        if not 0 <= self._clock_ns() - self._kept_ns < KEEP_EVERY_NS:
            self._keep()

    def flush(self) -> None:
        """Write all pending messages."""
        for files in self._cameras.values():
            files.flush()

    def close(self) -> None:
        """Close all files, even if closing one of them fails."""
        with ExitStack() as closing:
            for files in self._cameras.values():
                closing.callback(files.end_file)
        self._cameras.clear()

    def _files_of(self, camera: Camera) -> CameraFiles:
        def begin(continuity: Continuity) -> Recorder:
            try:
                now_ns = self._clock_ns()
                path = new_path(self.path, camera, now_ns, of_alarm=self._alarms.only)
            except OSError as exc:
                raise _cannot(self.path, exc) from exc
            return Recorder(
                path,
                run_info=self._run_info,
                clock_ns=self._clock_ns,
                continuity=continuity,
                **self._file_options,  # type: ignore[arg-type]  # as named above
            )

        if self._alarms.only:
            return AlarmFiles(begin, self._rotation, self._clock_ns, self._alarms)
        first = self._before.get(camera) or Continuity(Timeline(self._clock_ns))
        return CameraFiles(begin, self._rotation, self._clock_ns, first)

    def _recent(self) -> dict[Camera, Continuity]:
        """Return the state of each camera after its latest files."""
        found: dict[Camera, list[Path]] = {}
        for file in archived_files(self.path):
            found.setdefault(file.camera, []).append(file.path)
        return {camera: continuity_after(f, self._clock_ns) for camera, f in found.items()}

    def _make_folder(self) -> None:
        try:
            self.path.mkdir(parents=True, exist_ok=True)
        except FileExistsError as exc:
            raise UsageError(f"{self.path}: this is no folder", "name a folder") from exc
        except OSError as exc:
            raise _cannot(self.path, exc) from exc

    def _keep(self) -> None:
        self._kept_ns = self._clock_ns()
        self._keeper.apply()


def _cannot(root: Path, exc: OSError) -> RecordingError:
    reason = reason_of(exc)
    return RecordingError(
        f"{exc.filename or root}: recording stopped, {reason}", "check the folder, rights and space"
    )


DAY_S = 86_400
_ROOM = 1.5  # free space to keep, as a multiple of the warning limit: avoids the warning
_ALWAYS = AlarmSpan(0, 2**63, "alarms that can't be read")


class _Aged(NamedTuple):
    file: ArchivedFile
    size_bytes: int
    last_ns: int  # time of its last change


class Keeper:
    """Applies the rules; never deletes a file being written, nor one that overlaps with an alarm.

    Parameters
    ----------
    root : Path
        Folder of the archive.
    rules : Retention
    clock_ns : callable
        Wall clock, UTC since 1970, in ns.
    limits : DiskLimits
        When the disk counts as nearly full.
    usage : callable
        Returns size and free space of the disk.
    warn : callable
        Called with a text, once for each file that can't be deleted or read. It stays; no other
        file is deleted in its place.
    """

    def __init__(
        self,
        root: Path,
        rules: Retention,
        clock_ns: Callable[[], int],
        *,
        limits: DiskLimits = DiskLimits(),  # noqa: B008  # frozen
        usage: Callable[[Path], Usage] = disk_usage,
        warn: Callable[[str], None] = lambda text: None,
    ) -> None:
        self._root, self._rules, self._clock_ns, self._usage = root, rules, clock_ns, usage
        self._limits, self._warn, self._warned = limits, warn, set[str]()

    def apply(self) -> list[Path]:
        """Delete the files that the rules no longer permit; return them, oldest first."""
        files = [aged for aged in map(_age, archived_files(self._root)) if aged is not None]
        too_many = self._too_many(sum(aged.size_bytes for aged in files))
        alarms = {c: self._alarms_of(c) for c in {aged.file.camera for aged in files}}
        days = self._rules.days
        oldest_ns = 0 if days is None else self._clock_ns() - nanoseconds(days * DAY_S)
        gone = []
        for aged in files:
            due = too_many > 0 or aged.last_ns < oldest_ns
            if due and not self._stays(aged, alarms) and self._delete(aged.file.path):
                too_many -= aged.size_bytes
                gone.append(aged.file.path)
        for folder in {path.parent for path in gone}:
            with suppress(OSError):
                folder.rmdir()  # succeeds for an empty day
        return gone

    def _too_many(self, held_bytes: int) -> float:
        """Return the bytes above the archive's share, or missing from the free space to keep."""
        if self._rules.disk_share is None:
            return 0.0
        total, free = self._usage(self._root)
        lacking = _ROOM * low_bytes(self._limits, total) - free
        return max(held_bytes - self._rules.disk_share * total, lacking)

    def _alarms_of(self, camera: Camera) -> list[AlarmSpan]:
        try:
            return alarms_of(self._root, camera)
        except OSError as exc:
            self._tell(exc)
            return [_ALWAYS]

    def _stays(self, aged: _Aged, alarms: dict[Camera, list[AlarmSpan]]) -> bool:
        spans = alarms[aged.file.camera]
        if any(span.covers(aged.file.start_ns, aged.last_ns) for span in spans):
            return True
        try:
            return is_held(aged.file.path)
        except FileNotFoundError:
            return False
        except OSError as exc:
            self._tell(exc)
            return True

    def _delete(self, path: Path) -> bool:
        try:
            path.unlink(missing_ok=True)
        except OSError as exc:
            self._tell(exc)
            return False
        return True

    def _tell(self, exc: OSError) -> None:
        if str(exc.filename) not in self._warned:
            self._warned.add(str(exc.filename))
            reason = reason_of(exc)
            self._warn(f"{exc.filename}: {reason}; it stays in the archive")


def _age(file: ArchivedFile) -> _Aged | None:
    try:
        found = file.path.stat()
    except FileNotFoundError:  # deleted meanwhile by another process
        return None
    return _Aged(file, found.st_size, found.st_mtime_ns)

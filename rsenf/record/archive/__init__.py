"""An archive: recordings by site, camera and day, and an index of what there is.

Writing: ``layout`` (names), ``camera_files`` (one file after the other), ``ring`` and
``alarm_files`` (the minutes about an alarm), ``alarms`` (what is kept for them), ``retention``,
``writer`` (all of these). Asking: ``spans``, ``summary`` (one file), ``index`` (all, cached) and
``holdings`` (what there is of a camera, and where the gaps are).
"""

from rsenf.record.archive.writer import ArchiveRecorder

__all__ = ["ArchiveRecorder"]

"""An archive: recordings by site, camera and day, with rotation, retention and an index.

Writing: ``layout`` (file names), ``camera_files`` (rotation, alarms), ``retention``, and
``writer``, which uses all of these. Reading: ``index`` (summaries of all files), ``holdings``
(coverage and gaps).
"""

from rsenf.record.archive.writer import ArchiveRecorder

__all__ = ["ArchiveRecorder"]

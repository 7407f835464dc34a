"""The report on a recording's time: a page, its numbers as JSON, its pictures, in one folder."""

from __future__ import annotations

from rsenf.report.recording_time.case import Case, RecordingFacts, ReferenceFacts
from rsenf.report.recording_time.folder import check_folder
from rsenf.report.recording_time.moment import moment_of_report
from rsenf.report.recording_time.write import write_report

__all__ = [
    "Case",
    "RecordingFacts",
    "ReferenceFacts",
    "check_folder",
    "moment_of_report",
    "write_report",
]

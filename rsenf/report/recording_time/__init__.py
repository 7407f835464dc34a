"""The forensic report on the time of a recording: HTML page, JSON and pictures, in one folder.

In: a :class:`Case` (verdict, estimates, reference, files, settings). Out: ``report.html``,
``report.json``, ``result.json`` and PNG files. It follows the ENFSI Guideline for Evaluative
Reporting in Forensic Science (2015): propositions, likelihood ratios, conditions.

Read ``words`` and ``document`` (report.json), which is filled from ``words`` and ``evidence``; then
``pictures``, ``page`` (its sections) and ``write`` (the folder).
"""

from __future__ import annotations

from rsenf.report.recording_time.words import Case, RecordingFacts, ReferenceFacts
from rsenf.report.recording_time.write import check_folder, moment_of_report, write_report

__all__ = [
    "Case",
    "RecordingFacts",
    "ReferenceFacts",
    "check_folder",
    "moment_of_report",
    "write_report",
]

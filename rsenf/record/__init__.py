"""Recordings: messages to MCAP files and back, with examination and recovery of damaged files.

In: messages by key. Out: an MCAP file (https://mcap.dev/spec), and its messages in order.

Read ``writer`` and ``reader`` first. Files, from the bytes up: ``container`` (records), ``index``
(chunks and summary section), ``scan`` (skips damage) and ``summary`` (contents), ``output`` (the
file being written), and ``growing`` (a file with all of these). Messages to records: ``topics``
(channels and schemas), ``sequence`` (numbers and log times). ``provenance`` says what made a file,
``limits`` how large it may become. ``examine`` diagnoses a file, ``recover`` copies what is intact.
``archive`` holds many files by site, camera and day; ``export`` writes tables and sound.
"""

from rsenf.record.growing import Finished, close_truncated
from rsenf.record.provenance import input_facts
from rsenf.record.reader import Loss, Recording, open_recording
from rsenf.record.topics import Topic
from rsenf.record.writer import Recorder

__all__ = [
    "Finished",
    "Loss",
    "Recorder",
    "Recording",
    "Topic",
    "close_truncated",
    "input_facts",
    "open_recording",
]
